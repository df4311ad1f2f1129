"""Frames as others send them, made with pymavlink."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink


def packed(message, system=1, component=1, *, version=2, sequence=0):
    writer = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    writer.seq = sequence
    return bytes(message.pack(writer, force_mavlink1=version == 1))


def heartbeat(system=1, component=1, *, kind=1, autopilot=3, base_mode=217, custom_mode=10):
    return packed(
        mavlink.MAVLink_heartbeat_message(kind, autopilot, base_mode, custom_mode, 4, 3), system, component
    )


def position(
    boot_ms=1_000,
    system=1,
    *,
    lat=-353_632_610,
    lon=1_491_652_300,
    alt=684_000,
    above=100_000,
    vx=100,
    vy=2_000,
    vz=-50,
):
    message = mavlink.MAVLink_global_position_int_message(boot_ms, lat, lon, alt, above, vx, vy, vz, 9_000)
    return packed(message, system)


def adsb(system=200, component=156, **changes):
    fields = {
        "ICAO_address": 0xD70001,
        "lat": -353_600_000,
        "lon": 1_491_600_000,
        "altitude_type": 0,
        "altitude": 600_000,
        "heading": 9_000,
        "hor_velocity": 1_000,
        "ver_velocity": 0,
        "callsign": b"CAR1",
        "emitter_type": 18,
        "tslc": 1,
        "flags": 0x0F,
        "squawk": 0,
    }
    return packed(mavlink.MAVLink_adsb_vehicle_message(**fields | changes), system, component)
