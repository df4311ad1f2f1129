"""``make intercepted``: flights with a man in the middle of the link, who drops, delays, repeats and forges.

Both ways, at moments and in kinds drawn from a seed. With a key he must cause nothing that the service did
not check: each mission that the autopilot holds is judged as under the torture's faults, its mode and the
parameters of both stay. Without one he may cause what SECURITY.md says, and no more: what is counted.
"""

import argparse
import asyncio
import json
import random
import sys
import tempfile
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config.parameters.pilot_parameters import ENABLE
from companion.link.messages.codec import signer_of
from companion.link.wire.signing import Timestamps
from companion.types.events import Dialect
from sim.faults import LinkFaults, Schedule
from tests.support.sitl_harness import is_changing
from tests.torture.harness import TortureHarness, flown

DURATION_S = 40.0
KEY, OTHER_KEY = bytes(range(32)), bytes(32)
EPOCH_S = 1_790_000_000.0
SIGNED_TIME = int((EPOCH_S - 1_420_070_400) * 100_000)
QUIET_S = 3.0  # the attack begins when the service has taken over
VEHICLE, STATION, SERVICE, STRANGER = (1, 1), (255, 190), (1, 195), (66, 1)
KEPT = 400  # frames that may be repeated
PX4_MISSION = 4 << 24 | 4 << 16
# What the service says to the autopilot that changes anything, besides missions.
SAID_ONLY = {
    "MISSION_COUNT",
    "MISSION_ITEM_INT",
    "MISSION_WRITE_PARTIAL_LIST",
    "MISSION_SET_CURRENT",
    "COMMAND_LONG",
}


ITS_COUNT = "MIS_TOTAL"  # a parameter that ArduPlane keeps itself: how long its list is
ITS_PARAMETERS = (b"WP_RADIUS", b"NAVL1_PERIOD", b"FENCE_RADIUS", b"NAV_ACC_RAD")


def _vehicle(chance):
    place = (-353_632_610 + chance.randint(-90_000, 90_000), 1_491_652_300 + chance.randint(-90_000, 90_000))
    return mavlink.MAVLink_adsb_vehicle_message(
        chance.randrange(99), *place, 0, 684_000, 0, chance.randrange(3_000), 0, b"F", 18, 0, 0x0F, 0
    )


def _position(chance, boot_ms):
    east, north = chance.randint(-30_000, 30_000), chance.randint(-30_000, 30_000)
    return mavlink.MAVLink_global_position_int_message(
        boot_ms, -353_632_610 + north, 1_491_652_300 + east, 684_000, chance.randint(60, 160) * 1_000,
        chance.randint(-2_500, 2_500), chance.randint(-2_500, 2_500), 0, 0,
    )  # fmt: skip


def _items(chance):
    place = (-353_632_610 + chance.randint(-90_000, 90_000), 1_491_652_300 + chance.randint(-90_000, 90_000))
    return mavlink.MAVLink_mission_item_int_message(
        1, chance.choice((1, 195)), chance.randrange(30), 3, chance.choice((16, 17, 21, 189)), 0, 1,
        0.0, 0.0, 0.0, 0.0, *place, 100.0, chance.choice((0, 0, 1)),
    )  # fmt: skip


# To the service: kinds by name, each with who it says it is from.
TO_SERVICE = {
    "heartbeat": lambda c, ms: (
        VEHICLE,
        mavlink.MAVLink_heartbeat_message(
            1, c.choice((3, 12)), c.choice((89, 217)), c.choice((10, 5, 11, PX4_MISSION)), 4, 3
        ),
    ),
    "position": lambda c, ms: (VEHICLE, _position(c, ms)),
    "current item": lambda c, ms: (
        VEHICLE,
        mavlink.MAVLink_mission_current_message(c.randrange(30), c.randrange(30), c.randrange(6), 1),
    ),
    "acknowledgement": lambda c, ms: (
        VEHICLE,
        mavlink.MAVLink_mission_ack_message(1, 195, c.choice((0, 0, 1, 13, 15))),
    ),
    "command accepted": lambda c, ms: (VEHICLE, mavlink.MAVLink_command_ack_message(c.choice((224, 176)), 0)),
    "question": lambda c, ms: (VEHICLE, mavlink.MAVLink_mission_request_int_message(1, 195, c.randrange(30))),
    "count": lambda c, ms: (
        VEHICLE,
        mavlink.MAVLink_mission_count_message(1, 195, c.randrange(30), c.choice((0, 1))),
    ),
    "item": lambda c, ms: (VEHICLE, _items(c)),
    "autopilot's parameter": lambda c, ms: (
        VEHICLE,
        mavlink.MAVLink_param_value_message(c.choice(ITS_PARAMETERS), c.uniform(0.0, 900.0), 9, 900, 1),
    ),
    "parameter": lambda c, ms: (
        c.choice((STATION, STRANGER)),
        mavlink.MAVLink_param_set_message(1, 195, ENABLE.encode(), float(c.randrange(2)), 9),
    ),
    "vehicle": lambda c, ms: (STRANGER, _vehicle(c)),
    "key": lambda c, ms: (STATION, mavlink.MAVLink_setup_signing_message(1, 195, list(OTHER_KEY), 0)),
    "mode": lambda c, ms: (STATION, mavlink.MAVLink_command_long_message(1, 195, 176, 0, 1, 11, *[0.0] * 5)),
}
# To the autopilot, under the service's or a station's ids; only where it believes signed frames alone.
TO_AUTOPILOT = {
    "mode": lambda c: (
        STATION,
        mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, c.choice((5, 11, 12)), *[0.0] * 5),
    ),
    "count": lambda c: (SERVICE, mavlink.MAVLink_mission_count_message(1, 1, c.randrange(1, 9))),
    "item": lambda c: (SERVICE, _items(c)),
    "clear": lambda c: (SERVICE, mavlink.MAVLink_mission_clear_all_message(1, 1)),
    "current": lambda c: (SERVICE, mavlink.MAVLink_mission_set_current_message(1, 1, c.randrange(30))),
    "parameter": lambda c: (STATION, mavlink.MAVLink_param_set_message(1, 1, b"WP_RADIUS", 5.0, 9)),
}


class Interceptor:
    """Sits in a harness's link.

    ``counts`` tells what was done, by kind.
    """

    def __init__(self, harness, seed, *, is_signed):
        self.counts = Counter()
        self._harness = harness
        self._chance = random.Random(seed)
        self._is_signed = is_signed
        self._kept = {True: [], False: []}
        self._mavs = {}
        self._boot_ms = 10_000_000
        # Each flight has kinds of its own, and a rate [Hz]; now and then all of them.
        names = sorted(TO_SERVICE)
        self.kinds = (
            names if self._chance.random() < 0.2 else self._chance.sample(names, self._chance.randint(1, 4))
        )
        self._rate_hz = self._chance.choice((0.5, 2.0, 10.0, 50.0))
        harness.link.faults = LinkFaults(
            loss=self._chance.choice((0.0, 0.1, 0.3)), duplication=self._chance.choice((0.0, 0.3)),
            corruption=self._chance.choice((0.0, 0.05)), jitter_s=self._chance.choice((0.0, 0.0, 0.1, 1.0)),
        )  # fmt: skip
        harness.link.watch = self.seen

    def seen(self, frame, is_from_client):
        """Keep a frame, to be sent again, and let it pass, mostly."""
        kept = self._kept[is_from_client]
        kept.append(frame)
        if len(kept) > KEPT:
            kept.pop(self._chance.randrange(KEPT))
        return self._harness.now_s < QUIET_S or self._chance.random() > 0.02

    def act(self):
        """What he does in one step of 20 ms."""
        if self._harness.now_s < QUIET_S or self._chance.random() > 0.02 * self._rate_hz:
            return
        what = self._chance.random()
        if what < 0.25:
            self._repeat()
        elif what < 0.4 and self._is_signed:
            self._forge_to_autopilot()
        else:
            self._forge_to_service()

    def _repeat(self):
        is_from_client = self._chance.random() < 0.5
        kept = self._kept[is_from_client]
        if kept and (self._is_signed or not is_from_client):
            self.counts["repeated"] += 1
            self._put(is_from_client, self._chance.choice(kept))

    def _put(self, is_to_autopilot, frame):
        if is_to_autopilot:
            self._harness.simulator.receive(frame)
        else:
            self._harness.app.link.receive(frame)

    def _forge_to_service(self):
        name = self._chance.choice(self.kinds)
        self._boot_ms += 100
        source, message = TO_SERVICE[name](self._chance, self._boot_ms)
        self.counts[name] += 1
        self._put(False, self._packed(message, source))

    def _forge_to_autopilot(self):
        name = self._chance.choice(sorted(TO_AUTOPILOT))
        source, message = TO_AUTOPILOT[name](self._chance)
        self.counts[f"to autopilot: {name}"] += 1
        self._put(True, self._packed(message, source))

    def _packed(self, message, source):
        """Unsigned, with another key, or with the signature of a frame that was seen."""
        mav = self._mavs.setdefault(
            source, mavlink.MAVLink(None, srcSystem=source[0], srcComponent=source[1])
        )
        how = self._chance.randrange(3) if self._is_signed else 0
        mav.signing.secret_key, mav.signing.sign_outgoing = OTHER_KEY, how > 0
        mav.signing.timestamp = SIGNED_TIME + int(1e5 * self._harness.now_s) + self._chance.randrange(10**7)
        frame = bytes(message.pack(mav))
        borrowed = [kept for kept in self._kept[False][-20:] if kept[0] == 0xFD and kept[2] & 1]
        if how == 2 and borrowed:
            frame = frame[:-13] + self._chance.choice(borrowed)[-13:]
        return frame


def intercepted(seed, *, is_signed):
    """One flight; what he did, and what became of it."""
    dialect = list(Dialect)[seed % 2]
    with tempfile.TemporaryDirectory() as folder:
        harness = TortureHarness(dialect, seed, Schedule(), Path(folder))
        harness.link._schedule = None  # the faults are the man's
        if is_signed:
            harness.simulator._channel.use_signing(KEY, 1, SIGNED_TIME)
            harness.signer = signer_of(KEY, 2, Timestamps(None, lambda: EPOCH_S + harness.now_s))
        man = Interceptor(harness, seed, is_signed=is_signed)
        parameters = harness.simulator.autopilot.parameters
        before = {name: parameters[name] for name in parameters.names if name != ITS_COUNT}
        act = harness.act

        def acting(inner):
            man.act()
            act(inner)

        harness.act = acting
        verdict = asyncio.run(flown(harness, DURATION_S))
        after = {name: parameters[name] for name in before}
    said = {message.get_type() for _, message in harness.heard if is_changing(message)}
    app = harness.app
    return {
        "seed": seed,
        "dialect": dialect.value,
        "kinds": man.kinds,
        "forged": dict(man.counts),
        "violations": [list(map(str, entry)) for entry in verdict.violations[:3]],
        "collision": bool(verdict.collision),
        "swaps": verdict.num_swaps,
        "mode": harness.simulator.autopilot.mode,
        "parameters": dict(app._parameters.values_set),
        "autopilot_parameters_changed": before != after,
        "said": sorted(said - SAID_ONLY),
        "contradictions": harness.texts("link"),
    }


def causes(found, *, is_signed):
    """What he caused that he must not."""
    wrong = []
    if found["said"]:
        wrong.append(f"the service said {found['said']}")
    if is_signed:
        wrong += [f"violation {entry}" for entry in found["violations"]]
        wrong += ["collision"] * found["collision"] + ["parameter"] * bool(found["parameters"])
    return wrong + ["autopilot's parameter"] * found["autopilot_parameters_changed"]


def flight_of(task):
    """One flight, as a process of its own runs it."""
    seed, is_signed = task
    return intercepted(seed, is_signed=is_signed)


def main():
    """Fly, print the counts, and fail where he caused what he must not."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-n", type=int, default=500)
    parser.add_argument("--unsigned", action="store_true")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=1)
    arguments = parser.parse_args()
    is_signed, caused, forged = not arguments.unsigned, Counter(), Counter()
    tasks = [(seed, is_signed) for seed in range(arguments.first_seed, arguments.first_seed + arguments.n)]
    swaps, failures, by_kind = 0, [], Counter()
    with ProcessPoolExecutor(arguments.jobs, mp_context=get_context("spawn")) as pool:
        for found in pool.map(flight_of, tasks):
            forged.update(found["forged"])
            swaps += found["swaps"]
            caused["flights"] += 1
            for name in ("collision", "violations", "parameters", "contradictions"):
                caused[name] += bool(found[name])
            if found["collision"] or found["violations"]:
                by_kind.update(found["kinds"])
            wrong = causes(found, is_signed=is_signed)
            if wrong:
                failures.append({"seed": found["seed"], "wrong": wrong, "kinds": found["kinds"]})
                sys.stderr.write(f"{failures[-1]}\n")
    told = {
        "signed": is_signed, "swaps": swaps, "flights with": caused, "forged and repeated": forged,
        "kinds in flights with a violation": by_kind, "failures": failures,
    }  # fmt: skip
    sys.stdout.write(json.dumps(told, indent=1) + "\n")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
