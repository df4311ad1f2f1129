"""The ground as the autopilot stores or measures it against a flat map, 600 m above the sea."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from companion.flight.monitors import ground_watch
from companion.flight.monitors.ground_watch import GroundWatch
from companion.flight.state.flight_phase import FlightPhase
from companion.flight.state.flight_state import StateOwner
from companion.types.events import GroundReported
from companion.types.mavlink_enums import LandedState
from companion.types.pilot_texts import pilot_message
from tests.flight.construction.test_cycle import OPEN, begun, state

SECTION = "terrain: {{generated: {{kind: hills, relief_m: 1}}, home_tolerance_m: 20, item_frame: {0}}}\n"
HERE = (-35.363261, 149.16523)


def flat(latitude_deg, longitude_deg):
    """600 m, and unknown in the far north."""
    return np.where(latitude_deg > -30.0, np.nan, 600.0 + 0.0 * longitude_deg)


class Watched:
    """A watch over an aircraft 100 m above the origin, which is 584 m above the sea."""

    def __init__(self, monkeypatch, *, frame="amsl", is_airborne=True):
        monkeypatch.setattr(ground_watch, "served_heights_of", lambda mission: flat)
        made = begun(SECTION.format(frame), OPEN.replace("dimension: 2", "dimension: 3"))
        landed = LandedState.IN_AIR if is_airborne else LandedState.ON_GROUND
        phase = FlightPhase(0.0, is_armed=is_airborne, has_flown=is_airborne, landed_state=landed)
        self.here, self.said = state(east=50.0, up=100.0), []
        world = SimpleNamespace(ownship=SimpleNamespace(state=lambda _: self.here))
        announcer = SimpleNamespace(decide=self._decide)
        self._watch = GroundWatch(StateOwner(replace(made, phase=phase)), world, announcer)

    def _decide(self, kind, text, *, tell, why=None, about="", **values):
        assert kind.value == "ground"
        self.said.append(pilot_message(tell, about, **values).text)

    def observe(self, *reports):
        for report in reports:
            self._watch.observe(report)


def stored(altitude_m, *, seconds=6, first_s=0, spacing_m=100.0, place=HERE):
    return [
        GroundReported(float(first_s + n), "autopilot", altitude_m, None, place, spacing_m, 4, 200)
        for n in range(seconds)
    ]


def measured(distance_m, seconds=6):
    return [GroundReported(float(n), "range finder", None, distance_m) for n in range(seconds)]


@pytest.mark.parametrize(
    ("reports", "text"),
    [
        (stored(619.0), ""),
        (stored(581.0), ""),
        (stored(640.0), "GROUND differs: autopilot 640 m, map 600 m"),
        (stored(560.0), "GROUND differs: autopilot 560 m, map 600 m"),
        (measured(84.0), ""),  # The aircraft is 684 m above the sea.
        (measured(44.0), "GROUND differs: range finder 640 m, map 600 m"),
        ([GroundReported(float(n), "estimator", 1625.0) for n in range(6)],
         "GROUND differs: estimator 1625 m, map 600 m"),
        (stored(640.0, place=(-20.0, 149.0)), ""),  # Beyond the map.
    ],
)  # fmt: skip
def test_a_difference_beyond_the_tolerance_is_told_once_with_both_heights(monkeypatch, reports, text):
    watched = Watched(monkeypatch)
    watched.observe(*reports, *(replace(report, stamp_s=report.stamp_s + 100.0) for report in reports))
    assert watched.said == ([text] if text else [])
    assert all(len(said) <= 50 for said in watched.said)


def test_a_short_difference_is_not_told(monkeypatch):
    watched = Watched(monkeypatch)
    watched.observe(*stored(640.0, seconds=3), *stored(600.0, first_s=3, seconds=1))
    watched.observe(*stored(640.0, first_s=4, seconds=3), *stored(640.0, first_s=30, seconds=3))
    assert watched.said == []
    watched.observe(*stored(640.0, first_s=33, seconds=1))
    assert len(watched.said) == 1


def test_a_range_finder_is_compared_in_level_flight_only(monkeypatch):
    banked, parked = Watched(monkeypatch), Watched(monkeypatch, is_airborne=False)
    banked.here = replace(banked.here, bank_rad=0.3)
    for watched in (banked, parked):
        watched.observe(*measured(44.0))
        assert watched.said == []
    banked.here = None
    banked.observe(*measured(44.0))
    assert banked.said == []


def test_missing_heights_are_told_where_waypoints_need_them(monkeypatch):
    missing = stored(0.0, seconds=12, spacing_m=0.0)
    for frame, is_airborne, is_told in (
        ("terrain", True, True), ("amsl", True, False), ("terrain", False, False),
    ):  # fmt: skip
        watched = Watched(monkeypatch, frame=frame, is_airborne=is_airborne)
        watched.observe(*missing[:10])
        assert watched.said == []
        watched.observe(*missing[10:])
        assert watched.said == (["GROUND unknown to the autopilot, waypoints need it"] if is_told else [])
