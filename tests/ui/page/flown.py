"""A flight told to a feed by a recorder, message by message, without flying."""

import numpy as np

from companion.config.load import mission_from_text, text_of
from companion.recording.recorder import About, Recorder
from companion.types.path import Path
from companion.types.plan import Measures, Plan, PlanStatus, PursuitRisk, SearchTrace
from companion.types.record import PlanRecord, SwapRecord
from companion.types.state import Ownship
from companion.types.threat import TrackState
from tests.ui.reports.flights import mission, snapshot_of

EPOCH_S = 1_767_225_600.0


def ownship(stamp_s, east=100.0, north=750.0, up=120.0):
    return Ownship(
        stamp_s=stamp_s, position_enu_m=(east, north, up), course_rad=1.5, flight_path_angle_rad=0.0,
        airspeed_m_s=25.0, ground_speed_m_s=26.0, wind_enu_m_s=(1.0, 0.0), position_std_m=(2.0, 3.0),
    )  # fmt: skip


def track(stamp_s, identity="icao:D70001", east=1500.0, *, flies_on=False):
    return TrackState(
        stamp_s=stamp_s, identity=identity, position_enu_m=(east, 300.0, 0.0),
        velocity_enu_m_s=(-5.0, 0.0, 0.0), covariance=np.diag([9.0, 1.0, 16.0, 1.0]), speed_max_m_s=20.0,
        max_threat_radius_m=250.0, turn_radius_m=15.0, is_airborne=False, observed_s=stamp_s,
        flies_on=flies_on,
    )  # fmt: skip


def path(stamp_s, num_rows=60):
    times = stamp_s + np.arange(num_rows, dtype=float)
    places = np.column_stack(
        [100.0 + 25.0 * np.arange(num_rows), np.full(num_rows, 750.0), np.full(num_rows, 120.0)]
    )
    covariances = np.broadcast_to(np.diag([9.0, 4.0, 1.0]), (num_rows, 3, 3))
    zeros = np.zeros(num_rows)
    return Path(
        times, places, np.full(num_rows, np.pi / 2), zeros, np.full(num_rows, 25.0), covariances,
        np.ones(num_rows), zeros,
    )  # fmt: skip


def plan(number, stamp_s, num_edges=50, *, first_s=float("inf"), flown_first_s=None):
    """A plan whose tree is a fan of so many edges."""
    angles = np.linspace(0.0, 6.0, num_edges)
    nodes = np.column_stack(
        [100.0 + 600.0 * np.cos(angles), 750.0 + 600.0 * np.sin(angles), np.full(num_edges, 120.0)]
    )
    trace = SearchTrace(
        tree_enu_m=np.vstack([[100.0, 750.0, 120.0], nodes]),
        tree_parents=np.concatenate([[-1], np.zeros(num_edges, dtype=np.int64)]),
        sub_goals_enu_m=np.array([[700.0, 750.0, 120.0]]),
    )
    flown = None if flown_first_s is None else PursuitRisk(flown_first_s, 1.0)
    made = Plan(
        PlanStatus.EXACT, path(stamp_s), Measures(path_cost=100.0), 1, "safe-rrt", number, trace,
        pursuit=PursuitRisk(first_s), flown_pursuit=flown,
    )  # fmt: skip
    return PlanRecord(
        number, "the mission is flown", "plan", {}, made, 1, False, stamp_s, stamp_s, stamp_s, 0.1, 90.0
    )


def swap(number, stamp_s):
    places = np.array([[100.0, 750.0, 120.0], [900.0, 1000.0, 120.0], [1900.0, 750.0, 120.0]])
    return SwapRecord("flown", "item 3 of 5", stamp_s, stamp_s + 0.5, number, (), places)


class Told:
    """A recorder in memory, whom somebody listens to.

    Parameters
    ----------
    listener : callable
        Told every message.
    folder : Path or None
        Where it is recorded, too.
    more : str
        More sections of its mission file.
    """

    def __init__(self, listener, folder=None, more=""):
        self.mission = mission_from_text(text_of(mission()) + more, "made-up.yaml") if more else mission()
        self.recorder = Recorder(folder, EPOCH_S, About(self.mission, 1, text_of(self.mission)))
        self.recorder.listen(listener)
        self.world = snapshot_of(self.mission)
        self.recorder.begin(0.0)

    def state(self, stamp_s, east=100.0, level=0.0, **more):
        self.recorder.state(stamp_s, ownship(stamp_s, east), (track(stamp_s, **more),), level)

    def standing(self, stamp_s, mode="active", **more):
        told = {
            "mode": mode, "autopilot_mode": "AUTO", "is_heard": True, "is_warm": True, "is_armed": True,
            "is_airborne": True, "is_recording": True, "is_in_trouble": False, "emergency": None,
            "goals": [[1900.0, 750.0, 120.0, 60.0]], "next_goal": 0, "item": 3, "num_items": 5,
            "handback": {}, "operator_enu_m": [], "returns": {},
        }  # fmt: skip
        self.recorder.standing(stamp_s, told | more)
        self.recorder.link(
            stamp_s, {"mode": "planning", "dialect": "ardupilot", "counters": {}, "missing_streams": []}
        )

    def plan(self, number, stamp_s, **more):
        self.recorder.plan(stamp_s, plan(number, stamp_s, **more), self.world)

    def swap(self, number, stamp_s):
        self.recorder.swap(stamp_s, swap(number, stamp_s))

    def fly(self, seconds, east=100.0):
        """A flight of so many seconds, planned and handed over at its beginning."""
        self.plan(1, 0.0)
        self.swap(1, 0.5)
        self.recorder.decide(
            0.5, "swap", "first plan, cost 100.0; item 3 of 5", 90.0, why={"occasion": "the mission is flown"}
        )
        for tick in range(5 * seconds):
            self.state(0.2 * tick, east + 5.0 * tick)
        self.standing(float(seconds))


def recorded(folder, level=0.0):
    """The file of ten seconds with a track, and at 12 s the aircraft alone, at a threat level."""
    told = Told(lambda *_: None, folder)
    told.fly(10)
    told.recorder.decide(10.0, "emergency", "loiter")
    told.recorder.state(12.0, ownship(12.0, 595.0), (), level)
    told.recorder.close()
    return folder / "flight.mcap"
