"""``make garbage``: floods of the worst known sort, one after the other, beside a flight in real time.

For each parser the bytes that cost it most, a megabyte a second; of each message that the service answers,
ten thousand a second. Everything from addresses and systems that are none of the vehicle's.
"""

import argparse
import itertools
import json
import statistics
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.hostile.real_time import FRAMES_A_DATAGRAM, Bench, datagrams
from tests.sim.client import PLAIN

BYTES_PER_S, MESSAGES_PER_S = 1_000_000, 10_000
DATAGRAM = 1_000
GAP_MAX_S, LATE_MAX_S, STOP_MAX_S = 1.2, 0.2, 2.0
GROWTH_MAX_MIB = 20.0
SETTLED_S = 30.0  # from then on memory counts
# Headers standing in each other, so that each byte may begin a frame; with a length that reaches far.
PATTERNS = {
    "headers of MAVLink 1": bytes([0xFE, 0xFE, 0xD1, 0xFE]),
    "magic bytes": b"\xfe",
    "headers of MAVLink 2": bytes([0xFD, 0xFD, 0x00, 0x00]),
    "signed headers": bytes([0xFD, 0xFF, 0x01, 0xFD, 0x01, 0x00]),
    "unknown messages": bytes([0xFD, 0x01, 0x00, 0x00, 0x01, 0x4D, 0x01, 0x60, 0xEA, 0x00, 0x09, 0x00, 0x00]),
}
MESSAGES = {
    "PING": lambda n: mavlink.MAVLink_ping_message(n, n % 2**32, 0, 0),
    "COMMAND_LONG": lambda n: mavlink.MAVLink_command_long_message(1, 195, 512, 0, 148, *[0.0] * 6),
    "COMMAND_INT": lambda n: mavlink.MAVLink_command_int_message(1, 195, 0, 16, 0, 0, *[0.0] * 4, 0, 0, 0.0),
    "PARAM_REQUEST_LIST": lambda n: mavlink.MAVLink_param_request_list_message(1, 195),
    "PARAM_REQUEST_READ": lambda n: mavlink.MAVLink_param_request_read_message(1, 195, b"", n % 5),
    "PARAM_SET": lambda n: mavlink.MAVLink_param_set_message(1, 195, b"SRRT_ENABLE", float(n % 2), 9),
    "MISSION_REQUEST_LIST": lambda n: mavlink.MAVLink_mission_request_list_message(1, 195),
    "MISSION_COUNT": lambda n: mavlink.MAVLink_mission_count_message(1, 195, n % 700),
    "HEARTBEAT": lambda n: mavlink.MAVLink_heartbeat_message(1, 3, 217, 10, 4, 3),
    "ADSB_VEHICLE": lambda n: mavlink.MAVLink_adsb_vehicle_message(
        n % 2**24, -353_632_610 + n % 90_000, 1_491_652_300, 0, 684_000, 0, 2_000, 0, b"F", 3, 0, 0x0F, 0
    ),
}
OF_MANY = ("PING", "PARAM_SET", "ADSB_VEHICLE")
# Goals to and fro, a good ten minutes of flight.
PLACES = [
    (east if row % 2 == 0 else -east, north)
    for row, north in enumerate(range(-3_000, 3_000, 1_000))
    for east in (-1_000, 0, 1_000)
]
ROUTE = (
    PLAIN.replace("name: plain", "name: garbage")
    .replace("start: {east_m: 0, north_m: 0", "start: {east_m: -2000, north_m: -3000")
    .replace(
        "  - {east_m: 1750, north_m: 750, up_m: 100}\n",
        "".join(f"  - {{east_m: {east}, north_m: {north}, up_m: 100}}\n" for east, north in PLACES),
    )
    + "dynamic_threats:\n"
    + "  - {name: car, east_m: 0, north_m: -3000, speed_m_s: 15, max_threat_radius_m: 200}\n"
)


def of_many(message_of, number=1_000):
    """Endless datagrams, each from another system and component in turn."""
    ids = ((1 + index % 250, 2 + index // 250) for index in range(number))
    senders = [datagrams(message_of, system=system, component=component) for system, component in ids]
    return (next(sender) for sender in itertools.cycle(senders))


def phases():
    """Name, endless datagrams, and how many of them a second."""
    for name, pattern in PATTERNS.items():
        whole = (pattern * DATAGRAM)[:DATAGRAM]
        yield name, itertools.repeat(whole), BYTES_PER_S // DATAGRAM
    for name, message_of in MESSAGES.items():
        yield name, datagrams(message_of), MESSAGES_PER_S // FRAMES_A_DATAGRAM
    for name in OF_MANY:
        yield f"{name} of 1,000 sources", of_many(MESSAGES[name]), MESSAGES_PER_S // FRAMES_A_DATAGRAM


def flooded(folder, seconds):
    """Fly, flood, stop; what was seen."""
    mission = Path(folder) / "garbage.yaml"
    mission.write_text(ROUTE, encoding="utf-8")
    told, memory = [], []
    with Bench(Path(folder) / "flights", mission) as bench:
        attacker, plan = bench.attacker(), list(phases())
        each_s = seconds / len(plan)
        for number, (name, portions, rate_hz) in enumerate(plan):
            began = time.monotonic()
            is_last = number == len(plan) - 1
            if is_last:  # under which it has to stop
                stopping = threading.Timer(each_s - 1.0, bench.stop)
                stopping.start()
            sent = attacker.flood(portions, rate_hz, began + each_s)
            ended = time.monotonic() - (3.0 if is_last else 0.0)
            gap_s = max(bench.heard.gaps_s(began, ended))
            if not is_last:
                memory.append((time.monotonic() - bench.begun_s, bench.memory_mib()))
            told.append({"flood": name, "sent_per_s": round(sent / each_s), "gap_s": round(gap_s, 3)})
            sys.stderr.write(f"{told[-1]}\n")
        stopping.join()
        late = bench.lateness_s()
        held = [value for at, value in memory if at >= SETTLED_S]
        return {
            "floods": told,
            "heartbeat_gap_max_s": max(entry["gap_s"] for entry in told),
            "plans": len(late),
            "plan_late_median_s": round(statistics.median(late), 3) if late else None,
            "plan_late_max_s": round(max(late), 3) if late else None,
            "memory_mib": [round(value, 1) for value in held],
            "stopped_in_s": round(bench.ended_in_s, 2),
            "exit_code": bench.exit_code,
            "said": dict(Counter(text for _, text in bench.heard.texts).most_common(20)),
            "decided": dict(Counter(kind for kind, _ in bench.decisions())),
        }


def faults_of(found):
    """What is not as it must be."""
    held = found["memory_mib"]
    checks = {
        "a heartbeat came late": found["heartbeat_gap_max_s"] >= GAP_MAX_S,
        "no plan was made": found["plans"] == 0,
        "a plan was begun late": found["plans"] and found["plan_late_max_s"] > LATE_MAX_S,
        "memory grew": len(held) > 1 and held[-1] - held[0] > GROWTH_MAX_MIB,
        "SIGTERM was obeyed late": found["stopped_in_s"] > STOP_MAX_S,
        "it did not end in order": found["exit_code"] != 0,
    }
    return [name for name, is_so in checks.items() if is_so]


def main():
    """Flood, print what was seen, and fail where the service fell short."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = flooded(folder, arguments.seconds)
    found["faults"] = faults_of(found)
    sys.stdout.write(json.dumps(found, indent=1) + "\n")
    return 1 if found["faults"] else 0


if __name__ == "__main__":
    sys.exit(main())
