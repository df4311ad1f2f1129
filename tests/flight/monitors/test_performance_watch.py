"""An aircraft off its path: each kind of deviation, by hand on a straight path, and how long it lasts."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from companion.flight.monitors.performance_watch import LASTS_S, PerformanceWatch
from companion.flight.state.flight_phase import FlightPhase
from companion.flight.state.flight_state import StateOwner
from companion.flight.state.modes import Mode
from companion.mission.list_layout import new_banks
from companion.types.mavlink_enums import LandedState, MavFrame
from companion.types.mission import Command, Mission, MissionItem
from tests.flight.construction.test_cycle import OPEN, begun, flying, state, straight

# The path leads east at 25 m/s and 100 m.
KINDS = [
    (state(east=50.0), ""),
    (state(east=50.0, north=59.0), ""),
    (state(east=50.0, north=-61.0), "61 m beside its path"),
    (state(east=50.0, up=124.0), ""),
    (state(east=50.0, up=74.0), "26 m below its path"),
    (state(east=50.0, up=126.0), "26 m above its path"),
    (state(east=50.0, speed=17.0), "17 m/s over ground, not 25"),
    (state(east=50.0, speed=18.0), ""),
    # In a wind that is known to 1 m/s an aircraft is slow below 0.7 · 25 − 1 = 16.5 m/s.
    (replace(state(east=50.0, speed=17.0), wind_std_m_s=1.0), ""),
    (replace(state(east=50.0, speed=16.0), wind_std_m_s=1.0), "16 m/s over ground, not 25"),
]


class Watched:
    """A watch over an aircraft that is where the test says."""

    def __init__(self, mode=Mode.ACTIVE):
        made = replace(begun(text=OPEN.replace("dimension: 2", "dimension: 3")), mode=mode)
        made = replace(
            flying(made, straight()),
            phase=FlightPhase(0.0, is_armed=True, has_flown=True, landed_state=LandedState.IN_AIR),
        )
        self.said, self.here = [], None
        announcer = SimpleNamespace(decide=lambda kind, text, **_: self.said.append((kind.value, text)))
        world = SimpleNamespace(ownship=SimpleNamespace(state=lambda _: self.here))
        self.flight = StateOwner(made)
        self.watch = PerformanceWatch(self.flight, world, announcer)

    def end_in_circle(self, centre_m, radius_m, row):
        """Have the flown mission end in a circle, and the aircraft past a row of its path."""
        now, frame = self.flight.state, self.flight.state.mission.frame
        latitude, longitude, _ = frame.global_from_local(*centre_m)
        circle = MissionItem(
            0, Command.NAV_LOITER_UNLIM, MavFrame.GLOBAL_RELATIVE_ALT_INT, (0.0, 0.0, radius_m, None),
            round(1e7 * latitude), round(1e7 * longitude), centre_m[2],
        )  # fmt: skip
        made = replace(
            now, flown=replace(now.flown, mission=Mission((circle,), 1, 1), row=row),
            mission_list=replace(
                now.mission_list, layout=new_banks((circle,)), home_amsl_m=frame.altitude_amsl_m
            ),
        )  # fmt: skip
        self.flight.apply(lambda _: made)

    def look(self, here, *, until_s, from_s=0.0):
        self.here = here
        return [self.watch.look(0.5 * half) for half in range(int(2 * from_s), int(2 * until_s) + 1)]


@pytest.mark.parametrize(("here", "words"), KINDS)
def test_each_kind_is_announced_once_and_makes_a_plan_due(here, words):
    watched = Watched()
    due = watched.look(here, until_s=10.0)
    assert watched.said == ([("off path", words)] if words else [])
    assert sum(due) == bool(words)


def test_a_deviation_counts_only_if_it_lasts():
    watched = Watched()
    watched.look(state(east=50.0, north=80.0), until_s=LASTS_S - 0.5)
    watched.look(state(east=50.0), from_s=LASTS_S, until_s=20.0)
    assert watched.said == []


def test_while_somebody_else_flies_the_path_is_not_kept():
    watched = Watched(Mode.SUSPENDED)
    assert not any(watched.look(state(east=50.0, north=500.0), until_s=10.0))
    assert watched.said == []


@pytest.mark.parametrize(
    ("east", "north", "row", "words"),
    [
        (1500.0, 200.0, 58, []),  # On the circle of 100 m to the left of the path's end.
        (1500.0, 255.0, 58, []),
        (1500.0, 265.0, 58, ["265 m beside its path"]),
        (750.0, 100.0, 29, ["100 m beside its path"]),
    ],
)
def test_an_aircraft_in_the_circle_at_the_end_of_its_mission_is_on_its_path(east, north, row, words):
    watched = Watched()
    watched.end_in_circle((1500.0, 100.0, 100.0), 100.0, row)
    watched.look(state(east=east, north=north), until_s=10.0)
    assert [text for _, text in watched.said] == words


def test_another_deviation_is_announced_again():
    watched = Watched()
    watched.look(state(east=50.0, north=80.0), until_s=10.0)
    watched.look(state(east=50.0), from_s=10.5, until_s=15.0)
    watched.look(state(east=50.0, up=60.0), from_s=15.5, until_s=25.0)
    assert [text for _, text in watched.said] == ["80 m beside its path", "40 m below its path"]
