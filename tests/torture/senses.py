"""Campaign of what the service goes by going wrong.

Positions that stop or jump, air data or attitude that never come, tracks that are late, rare, noisy or of
nothing. Whole flights, judged by the simulator's truth, and by whether the pilot was told in time.
"""

import asyncio
import itertools
from collections import Counter

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import load_mission
from companion.types.events import Dialect
from sim.faults import Schedule
from tests.sim.client import CONFIGS
from tests.torture.campaigns import outcome
from tests.torture.harness import NARROW, TortureHarness, flown

POSITION, ATTITUDE = mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, mavlink.MAVLINK_MSG_ID_ATTITUDE
AIR = mavlink.MAVLINK_MSG_ID_VFR_HUD
TOLD_S = 2.0
ARMED_S = 2.5  # heard to be armed by then
UNTIL_S = 160.0
TOLD_EVERY = 25
JUMP_M, JUMPED_S = 40.0, 20.0
WORLDS = {**NARROW, "first-flight": load_mission(CONFIGS / "first-flight.yaml")}


class Sense:
    """One fault of one flight.

    ``begin_s`` and ``lasts_s`` bound it; ``told`` is what the pilot has to hear, '' where nothing.
    """

    told = ""

    def __init__(self, harness, random):
        self.harness, self.random = harness, random
        self.begin_s, self.lasts_s = float(random.uniform(8.0, 60.0)), UNTIL_S
        self.install()

    def is_on(self):
        return self.begin_s <= self.harness.now_s < self.begin_s + self.lasts_s

    def install(self):
        """Hook it in."""

    def step(self):
        """After each 20 ms."""


class Silence(Sense):
    """A message that does not come."""

    message_id = POSITION
    told = "no position"

    def install(self):
        self.harness.link.watch = self.passes

    def passes(self, frame, is_from_client):
        is_lost = int.from_bytes(frame[7:10], "little") == self.message_id and self.is_on()
        return is_from_client or not is_lost


class Outage(Silence):
    """Positions stop for 5, 30 or 120 s."""

    def install(self):
        super().install()
        self.lasts_s = float(self.random.choice([5.0, 30.0, 120.0]))


class NoAttitude(Silence):
    message_id, told = ATTITUDE, "no attitude"

    def install(self):
        super().install()
        self.begin_s = 0.0


class NoAirspeed(NoAttitude):
    message_id, told = AIR, "no airspeed"


class Jump(Sense):
    """The position the autopilot flies by jumps aside for 20 s."""

    told = "position: it jumped"

    def install(self):
        self.lasts_s = JUMPED_S
        course = float(self.random.uniform(0.0, 2.0 * np.pi))
        self.aside_m = JUMP_M * np.cos(course), JUMP_M * np.sin(course)

    def step(self):
        sensors = self.harness.simulator.autopilot.flight.sensors
        sensors.displace(*(self.aside_m if self.is_on() else (0.0, 0.0)))


class Tracks(Sense):
    """Reports of others, changed on their way to the links."""

    def install(self):
        self.begin_s = 0.0
        self.held = []
        self.autopilot = self.harness.simulator.autopilot
        self.relay, self.autopilot.relay_traffic = self.autopilot.relay_traffic, self.take


class LateTracks(Tracks):
    def take(self, report, source):
        self.held.append((self.harness.now_s + 5.0, report, source))

    def step(self):
        while self.held and self.held[0][0] <= self.harness.now_s:
            self.relay(*self.held.pop(0)[1:])


class RareTracks(Tracks):
    def take(self, report, source):
        self.held.append(report)
        if len(self.held) % 5 == 1:
            self.relay(report, source)


class NoisyTracks(Tracks):
    def take(self, report, source):
        north, east = 50.0 * self.random.standard_normal(2)
        report.lat += round(north / 111_320.0 * 1e7)
        report.lon += round(east / (111_320.0 * np.cos(np.radians(report.lat * 1e-7))) * 1e7)
        self.relay(report, source)


class Phantoms(Tracks):
    """Vehicles that are not there, each seen for a few seconds, about the aircraft."""

    numbers = itertools.count(0xA00000)

    def install(self):
        super().install()
        self.next_s, self.left = 5.0, []

    def take(self, report, source):
        self.relay(report, source)

    def step(self):
        if self.harness.now_s < self.next_s:
            return
        self.next_s += 1.0
        estimate = self.autopilot.flight.estimate
        if self.random.random() < 0.3:
            away = 600.0 * self.random.standard_normal(2)
            self.left.append([next(self.numbers), estimate.east_m + away[0], estimate.north_m + away[1], 4])
        for entry in self.left:
            entry[3] -= 1
            latitude, longitude = self.autopilot.projection.degrees(*entry[1:3])
            report = mavlink.MAVLink_adsb_vehicle_message(
                entry[0], round(latitude * 1e7), round(longitude * 1e7), 0, 584_000, 0, 0, 0, b"GHOST",
                mavlink.ADSB_EMITTER_TYPE_SERVICE_SURFACE, 0, 63, 0,
            )  # fmt: skip
            self.relay(report, (200, mavlink.MAV_COMP_ID_ADSB))
        self.left = [entry for entry in self.left if entry[3] > 0]


SENSES = (Outage, NoAttitude, NoAirspeed, Jump, LateTracks, RareTracks, NoisyTracks, Phantoms)


def kind_of(number):
    """The sort of fault of a flight."""
    return SENSES[number % len(SENSES)]


def sensed_flight(number, planning=None):
    """A flight by its number, with other values in its mission's ``planning`` if any are given.

    What its fault was, how it ended, how long the pilot waited to be told [s], and how near it came to
    anything [m].
    """
    kind = kind_of(number)
    dialect = list(Dialect)[number // len(SENSES) % len(Dialect)]
    world = list(WORLDS)[number // (len(SENSES) * len(Dialect)) % len(WORLDS)]
    mission = WORLDS[world]
    if planning is not None:
        mission = mission.model_copy(update={"planning": mission.planning.model_copy(update=planning)})
    harness = TortureHarness(dialect, number, Schedule(), mission=mission)
    harness.judge.look = lambda now_s, verdict: None  # by the truth alone
    fault = kind(harness, np.random.default_rng(number))
    harness.act = lambda _deck: fault.step()
    verdict = asyncio.run(flown(harness, UNTIL_S))
    due_s = max(fault.begin_s, ARMED_S)
    waited_s = 0.0
    if fault.told and harness.now_s > due_s + TOLD_S:
        told = (
            entry.stamp_s - due_s
            for entry in harness.recorder.decisions
            if entry.kind == "stale" and entry.text.startswith(fault.told) and entry.stamp_s > fault.begin_s
        )
        waited_s = next(told, np.inf)
    nearest_m = harness.simulator.truth.min_obstacle_clearance_m
    return f"{kind.__name__} {dialect.value} {world}", outcome(harness, verdict), waited_s, nearest_m


def run_senses(numbers, say, pool, planning=None):
    """Flights with a fault each, by their missions or with other planning; how many hit, or were not told."""
    ends, late, near, bad = {}, Counter(), {}, 0
    flights = pool.map(sensed_flight, numbers, [planning] * len(numbers))
    for count, (number, (what, how, waited_s, nearest_m)) in enumerate(zip(numbers, flights, strict=True), 1):
        if count % TOLD_EVERY == 0:
            say(f"  {count} of {len(numbers)}, {bad} bad")
        kind = what.split()[0]
        ends.setdefault(kind, Counter())[how] += 1
        late[kind] = max(late[kind], waited_s)
        near.setdefault(kind, []).append(nearest_m)
        if how == "collision" or waited_s > TOLD_S:
            bad += 1
            say(f"  {number}, {what}: {how}, told after {waited_s:.1f} s")
    for kind, counts in ends.items():
        tenth, half = np.quantile(near[kind], [0.1, 0.5])
        say(
            f"{kind}: {dict(counts)}, told after {late[kind]:.1f} s at most; nearest to anything "
            f"{min(near[kind]):.1f} m, of a tenth {tenth:.1f} m, of half {half:.1f} m"
        )
    return bad
