"""Reports about a frame's origin, written in metres."""

from __future__ import annotations

from companion.frames import LocalFrame
from companion.types.events import Emitter, TrackReport

FRAME = LocalFrame(latitude_deg=-35.363261, longitude_deg=149.165230, altitude_amsl_m=584.0)


def report(
    stamp_s,
    east_m=0.0,
    north_m=0.0,
    *,
    identity="icao:00ABCD",
    emitter=Emitter.GROUND,
    velocity=None,
    std=None,
    up_m=0.0,
):
    latitude, longitude, altitude = FRAME.global_from_local(east_m, north_m, up_m)
    return TrackReport(
        stamp_s=stamp_s,
        source="ADSB_VEHICLE 200/156",
        identity=identity,
        emitter=emitter,
        latitude_deg=latitude,
        longitude_deg=longitude,
        altitude_amsl_m=altitude,
        velocity_enu_m_s=velocity,
        position_std_m=std,
    )
