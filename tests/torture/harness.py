"""Flights under faults, and the judge: what the autopilot holds, flown from where the aircraft is.

The judge knows nothing of the service. At every step it takes the point the autopilot steers for, which
may be a copy of an item that is stored no more, and the items that would be flown after it. They are flown
from the aircraft's place, bank and wind under the autopilot's guidance, turns and circle included, and
``companion.assurance.checker`` says whether that track meets anything or leaves the bounds, and whether
the mission ends in a loiter.
"""

import asyncio
import math
from dataclasses import dataclass, field, replace

import numpy as np

from companion.assurance.checker import Checker
from companion.clock import ManualClock
from companion.config import load_mission, mission_from_text
from companion.config.compose import check_limits_of, vehicle_of
from companion.errors import RecordError
from companion.flight.state.checkpoint import Checkpoint
from companion.flight.state.modes import Mode
from companion.flight.tasks.app import stop
from companion.frames import equivalent_airspeed, speed_made_good
from companion.link.wire.memory_transport import MemoryTransport
from companion.types.events import Dialect
from companion.types.mission import Command
from companion.types.state import Ownship
from companion.world.vehicle.guidance import default_guidance, track_of_legs
from sim.faults import FaultKind, FaultyLink, LinkFaults, OtherUploader, Schedule, random_schedule
from tests.sim.client import CONFIGS, PLAIN
from tests.support.sitl_harness import SitlHarness
from tests.support.timed_link import TimedLink

DURATION_S = 45.0
NARROW_S = 75.0  # into the trap and the labyrinth
BEYOND_M = 30.0  # of the bounds, which are planned to and not walls: a turn may pass them by so much
CIRCLED_S = 20.0  # of the loiter at the end
STEP_S = 0.5
SPEED_NEAR_M_S = 2.0  # which is no other speed
SLOWS_M_S2 = 1.0  # at least: 37 to 25 m/s in nine seconds
LOITERS = frozenset({17, 18, 19, 31})
CORNERS = "[[{1}, {2}], [{3}, {2}], [{3}, {4}], [{1}, {4}]]"
BLOCK = "  - {{name: {0}, polygon_enu_m: " + CORNERS + ", base_m: 0, top_m: 300}}\n"
# Short horizons, so that missions are replaced often; gates that no straight line passes.
WORLD = (
    PLAIN.replace("time_horizon_s: 15", "time_horizon_s: 8, swap_gain: 0.0, max_iterations: 8000").replace(
        "bounds: {east_m: [-6000, 6000], north_m: [-6000, 6000]",
        "bounds: {east_m: [-600, 2600], north_m: [-900, 1400]",
    )
    + "simulation: {wind_speed_m_s: 3, wind_from_deg: 240, turbulence: light}\n"
    + "obstacles:\n"
    + BLOCK.format("south", 600, -700, 660, 60)
    + BLOCK.format("north", 1150, 420, 1210, 1300)
)
MISSION = mission_from_text(WORLD, "torture.yaml")
NARROW = {name: load_mission(CONFIGS / f"{name}.yaml") for name in ("paper-2d", "paper-3d")}
WORLDS = {"gates": (MISSION, DURATION_S), **{name: (made, NARROW_S) for name, made in NARROW.items()}}
MISSION_MODE = {Dialect.ARDUPILOT: "AUTO", Dialect.PX4: "MISSION"}


@dataclass
class Verdict:
    """What the judge saw of a flight."""

    violations: list = field(default_factory=list)
    num_judged: int = 0
    num_swaps: int = 0
    num_plans: int = 0
    mode: str = ""
    collision: bool = False
    rejected: int = 0
    arrived: bool = False


class Judge:
    """Watches one simulator."""

    def __init__(self, simulator, dialect, mission):
        self._autopilot = simulator.autopilot
        self._now = lambda: simulator.now_s
        self._dialect = dialect
        self._guidance = default_guidance(flies_by=dialect.flies_by, vehicle=vehicle_of(mission))
        limits = check_limits_of(mission)
        east0, east1, north0, north1, low, high = limits.bounds
        wider = (east0 - BEYOND_M, east1 + BEYOND_M, north0 - BEYOND_M, north1 + BEYOND_M, low, high)
        # The aircraft itself is somewhere on its way, in the middle of a turn perhaps, blown aside.
        self._checker = Checker(
            mission.obstacle_list, replace(limits, bounds=wider, margin_m=0.0, altitude_tolerance_m=40.0)
        )
        self._ground_m = mission.origin.altitude_amsl_m
        self._seen = None
        self._next_s = 0.0
        self.is_ours = False

    def look(self, now_s, verdict):
        autopilot = self._autopilot
        if autopilot.mode != MISSION_MODE[self._dialect]:
            verdict.violations.append((now_s, f"mode {autopilot.mode}"))
            return
        now = (autopilot.mission_revision, autopilot.current_sequence, autopilot.telemetry.target)
        if now == self._seen and now_s < self._next_s:
            return
        self._seen, self._next_s = now, now_s + 0.5
        verdict.num_judged += 1
        targets, circle = self._way()
        if circle is None:
            verdict.violations.append((now_s, "the mission does not end in a loiter (ending)"))
            return
        for track in self._tracks(targets, circle):
            bad = self._checker.check_track(track, 0.0)
            if bad:
                verdict.violations.append((now_s, str(bad[0]), autopilot.current_sequence))
                return

    def _way(self):
        """Places flown from here on, and the circle at the end; landings are the operator's."""
        autopilot, items = self._autopilot, self._autopilot.mission_items
        steering, target = autopilot.flight.steering, autopilot.telemetry.target
        if hasattr(steering, "radius_m"):
            return [], (np.array(target), steering.direction * steering.radius_m)
        places = [target]
        for item in items[autopilot.current_sequence + 1 :]:
            if item.command == Command.NAV_WAYPOINT:
                places.append(autopilot._position(item))
            elif item.command in LOITERS:
                return places, (np.array(autopilot._position(item)), item.parameters[2] or 0.0)
            elif item.command in (Command.DO_LAND_START, Command.NAV_LAND, Command.DO_JUMP):
                return places, (np.array(places[-1]), 0.0)
        return places, None

    def _commanded(self):
        """Behind how many of the targets the mission commands an airspeed next, and which, true [m/s].

        That which is commanded already, and behind none, where no other is until the circle.
        """
        autopilot, passed, commanded = self._autopilot, 1, None
        for item in autopilot.mission_items[autopilot.current_sequence + 1 :]:
            if item.command in LOITERS:
                break
            if item.command == Command.DO_CHANGE_SPEED and item.parameters[1] > 0.0:
                commanded = item.parameters[1]
                break
            passed += item.command == Command.NAV_WAYPOINT
        if commanded is None:
            passed, commanded = 0, autopilot.flight.airspeed_m_s
        return passed, commanded / equivalent_airspeed(1.0, self._ground_m + autopilot.flight.estimate.up_m)

    def _tracks(self, targets, circle):
        """Tracks (K, 3) over them from the aircraft's place [m]: at its speed, and at that to come.

        At its own it flies to the item that commands less, and while it slows down; else all the way. What is
        more it has behind the item that commands it, and all at once; what is less from here.
        """
        estimate, steering = self._autopilot.flight.estimate, self._autopilot.flight.steering
        velocity = (estimate.velocity_east_m_s, estimate.velocity_north_m_s)
        here = Ownship(
            self._now(), (estimate.east_m, estimate.north_m, estimate.up_m),
            math.atan2(*velocity) % (2.0 * math.pi), 0.0, estimate.true_airspeed_m_s, math.hypot(*velocity),
            (estimate.wind_east_m_s, estimate.wind_north_m_s), bank_rad=estimate.bank_rad,
        )  # fmt: skip
        before = (*steering.start, steering.start_height_m) if targets else here.position_enu_m
        (behind, then), now = self._commanded(), estimate.true_airspeed_m_s
        track = self._track(here, before, targets, circle)
        at_item = int(np.searchsorted(track.reached, behind))
        if now - then > SPEED_NEAR_M_S and targets:
            yield track.positions_enu_m[: at_item + 2 + int((now - then) / (SLOWS_M_S2 * STEP_S))]
        else:
            yield track.positions_enu_m
        if not targets or abs(now - then) <= SPEED_NEAR_M_S:
            return
        if then < now or behind == 0 or at_item == len(track):
            yield self._track(at_speed(here, then), before, targets, circle).positions_enu_m
            return
        there = replace(
            here, position_enu_m=tuple(track.positions_enu_m[at_item]),
            course_rad=float(track.courses_rad[at_item]), bank_rad=float(track.banks_rad[at_item]),
        )  # fmt: skip
        rest = self._track(at_speed(there, then), targets[behind - 1], targets[behind:], circle)
        yield np.vstack([track.positions_enu_m[:at_item], rest.positions_enu_m])

    def _track(self, ownship, before, targets, circle):
        """What is flown over them, and on round the circle, on the leg from a place ``before`` them."""
        here = ownship.position_enu_m
        length = sum(map(math.dist, [here, *targets[:-1]], targets)) if targets else 0.0
        return track_of_legs(
            self._guidance, ownship, np.array(targets or np.empty((0, 3))), before_enu_m=np.array(before),
            loiter=circle, ends_s=length / max(ownship.ground_speed_m_s, 10.0) + CIRCLED_S, step_s=STEP_S,
        )  # fmt: skip


def at_speed(ownship, airspeed_m_s):
    """The aircraft on its course at another true airspeed [m/s], as fast over the ground as it then is."""
    speed = speed_made_good(ownship.course_rad, airspeed_m_s, ownship.wind_enu_m_s)
    return replace(ownship, airspeed_m_s=airspeed_m_s, ground_speed_m_s=speed)


class TortureHarness(SitlHarness):
    """A harness over a faulty link, with transfers on simulated time."""

    def __init__(self, dialect, seed, schedule, folder=None, mission=MISSION):
        super().__init__(mission, seed=seed, dialect=dialect, folder=folder)
        self.dialect = dialect
        self.schedule = schedule
        self.link_kind = TimedLink
        self.link = FaultyLink(self.simulator, LinkFaults(), seed=seed, schedule=schedule)
        self.flight.wire = self.link
        self.flight.turn_timeout_s = 0.05
        self.checkpoint = None if folder is None else Checkpoint(folder / "flight")
        self.verdict = Verdict()
        self.judge = Judge(self.simulator, dialect, mission)
        self._pending = list(schedule.events)
        self._uploaders = []
        self._jump_s = 0.0

    def act(self, _deck):
        """Let happen what is due, then judge."""
        while self._pending and self._pending[0].begin_s <= self.now_s:
            self._happen(self._pending.pop(0))
        for uploader in self._uploaders:
            uploader.step()
        if all(uploader.verdict is not None for uploader in self._uploaders):
            self.judge.look(self.now_s, self.verdict)

    def _happen(self, event):
        kind = event.kind
        if kind is FaultKind.REBOOT:
            self.simulator.reboot()
        elif kind is FaultKind.UPLOADER:
            self._uploaders.append(OtherUploader(self.simulator, self.simulator.autopilot.mission_items))
        elif kind is FaultKind.KILL:
            self.is_killed = True
        elif kind is FaultKind.CLOCK_JUMP:
            self._jump_s += event.amount
        elif kind is FaultKind.DISK_FULL:
            self.recorder._tlog = FullDisk()

    def jumped(self, clock):
        """A clock that runs ahead by what has been jumped."""
        advance = clock.advance_to
        clock.advance_to = lambda now_s: advance(now_s + self._jump_s)
        return clock


class FullDisk:
    """A tlog on a disk without room."""

    def write(self, _time_s, _raw):
        raise RecordError("no space left on device")

    def close(self):
        raise RecordError("no space left on device")


async def flown(harness, duration_s=DURATION_S):
    """Fly a harness to an instant, or to the goal."""
    clock = harness.jumped(ManualClock())
    ours, theirs = MemoryTransport.pair()
    theirs.set_receiver(harness._receive)
    await theirs.open()
    running = harness._started(ours, clock)
    try:
        while harness.now_s < duration_s:
            await harness.flight._step(clock, theirs, running)
            harness.act(harness)
            if harness.app.mode is Mode.ARRIVED or harness.simulator.truth.collision:
                break
            if harness.is_killed:
                harness.is_killed = False
                running.cancel()
                await asyncio.gather(running, return_exceptions=True)
                running = harness._started(ours, clock)
    finally:
        await stop(running)
        harness.recorder.close()
    verdict = harness.verdict
    verdict.num_swaps = harness.app.num_swaps
    verdict.num_plans = len(harness.recorder.plan_ms)
    verdict.mode = harness.app.mode.name
    verdict.collision = harness.simulator.truth.collision
    verdict.rejected = harness.recorder.num_rejected
    verdict.arrived = harness.app.mode is Mode.ARRIVED
    return verdict


def fly(dialect, seed, schedule, watch=None, duration_s=DURATION_S, mission=MISSION):
    """One flight under a schedule; ``watch`` sees, and may stop, each frame."""
    harness = TortureHarness(dialect, seed, schedule, mission=mission)
    if watch is not None:
        harness.link.watch = watch(harness)
    return asyncio.run(flown(harness, duration_s)), harness


# A PX4 that reboots holds, and an ArduPlane is bereft of its mission by whoever uploads another: both
# have tests of their own, and no service can help either.
KINDS = {
    Dialect.ARDUPILOT: tuple(kind for kind in FaultKind if kind is not FaultKind.UPLOADER),
    Dialect.PX4: tuple(kind for kind in FaultKind if kind is not FaultKind.REBOOT),
}


def random_flight(dialect, seed, world="gates"):
    """A flight under a random schedule, in one of the worlds."""
    mission, duration_s = WORLDS[world]
    schedule = random_schedule(seed, duration_s, KINDS[dialect])
    return fly(dialect, seed, schedule, duration_s=duration_s, mission=mission)


TRANSFER = frozenset({38, 39, 40, 41, 43, 44, 45, 47, 51, 73})
COMMANDS = frozenset({76, 77})
SET_CURRENT = 224


def broken_after(number, silent_s):
    """Watcher that cuts the link, both ways, after so many messages of the exchange with missions."""

    def made(harness):
        state = {"count": 0, "until": None}
        harness.exchange = state

        def watch(frame, _is_from_client):
            now = harness.now_s
            if state["until"] is not None and now < state["until"]:
                return False
            message_id = int.from_bytes(frame[7:10], "little")
            is_command = message_id in COMMANDS and SET_CURRENT.to_bytes(2, "little") in frame[10:42]
            if message_id in TRANSFER or is_command:
                state["count"] += 1
                if state["count"] == number:
                    state["until"] = now + silent_s
            return True

        return watch

    return made


def num_messages(dialect, duration_s=DURATION_S):
    """Messages of the exchange in a flight without faults."""
    _, harness = fly(dialect, 1, Schedule(), broken_after(-1, 0.0), duration_s)
    return harness.exchange["count"]
