"""A flight as reported: the flown path, the decisions and the uploaded missions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from companion.frames import FloatArray
from companion.types.encounter import Encounter
from companion.types.mission import MissionItem
from companion.types.plan import Plan


@dataclass(frozen=True, slots=True)
class Decision:
    """One line of the decision table.

    ``plan_ms`` is the computing time of the plan that led to it. ``track_to_mission_ms`` is the time from the
    newest track until the mission that reacts to it is flown. ``why`` holds the values that led to it, and
    ``told`` is the text sent to the pilot, '' if none.
    """

    stamp_s: float
    kind: str
    text: str
    plan_ms: float | None = None
    track_to_mission_ms: float | None = None
    why: Mapping[str, object] = field(default_factory=dict)
    told: str = ""


@dataclass(frozen=True, slots=True)
class UploadedMission:
    """A flown mission; ``positions_enu_m`` (K, 3) are its waypoints [m]."""

    stamp_s: float
    positions_enu_m: FloatArray
    reason: str


@dataclass(frozen=True, slots=True)
class PlanRecord:
    """A plan and how it was made.

    Parameters
    ----------
    number : int
        Number of the plan in the flight, from 1.
    occasion : str
        Why the plan was made at this time.
    purpose : str
        ``plan``, or ``least threat`` in an emergency.
    start : mapping
        Start of the plan, and the position of the aircraft when it was made.
    plan : Plan
        The planner's answer.
    asked : int
        How often the search asked whether to stop.
    is_stopped : bool
        True if the wall clock stopped the search, not the iteration budget.
    due_s, seen_s : float
        Clock readings at which the plan was found to be due, and of its snapshot of the world [s].
    begun_s, took_s : float
        Clock reading at which the plan was begun, and its duration on the same clock [s].
    plan_ms : float
        Computing time [ms].
    is_broken_off : bool
        True if a surprise made it useless before it was finished.
    """

    number: int
    occasion: str
    purpose: str
    start: Mapping[str, object]
    plan: Plan
    asked: int
    is_stopped: bool
    due_s: float
    seen_s: float
    begun_s: float
    took_s: float
    plan_ms: float
    is_broken_off: bool = False


@dataclass(frozen=True, slots=True)
class SwapRecord:
    """A mission transfer to the autopilot: its result, and its start and end on the clock.

    ``waypoints_enu_m`` (K, 3) are the waypoints of the mission [m].
    """

    outcome: str
    reason: str
    begun_s: float
    ended_s: float
    plan_number: int
    items: tuple[MissionItem, ...]
    waypoints_enu_m: FloatArray


@dataclass(frozen=True, slots=True)
class FlightRecord:
    """All data of a report.

    Parameters
    ----------
    flown : ndarray, shape (N, 7)
        Time [s], east, north, up [m], course and climb angle [rad], speed [m/s].
    dt_paths, dt_tracks : tuple of ndarray, shape (M, 3)
        Time [s], east, north [m] of each moving threat: true, and as tracked.
    missions : tuple of UploadedMission
        Uploaded missions, in order.
    decisions : tuple of Decision
        Decisions of the flight, in order.
    threat : ndarray, shape (N, 2)
        Time [s] and threat level along the flight.
    plan_ms : tuple of float
        Computing time of every plan [ms].
    summary : dict
        Values shown as a table.
    epoch_s : float, optional
        UTC at time 0 [s].
    note : str
        Remark on the source of the record.
    begin_s : float, optional
        Time shown as 00:00 [s]; by default that of the first row of ``flown``.
    encounters : tuple of Encounter
        Encounter with each threat, by the most accurate paths known.
    energy : ndarray, shape (N, 3)
        Time [s], energy left, and energy that the way home and the reserve need, nan if not known [Wh].
    """

    flown: FloatArray
    dt_paths: tuple[FloatArray, ...]
    dt_tracks: tuple[FloatArray, ...]
    missions: tuple[UploadedMission, ...]
    decisions: tuple[Decision, ...]
    threat: FloatArray
    plan_ms: tuple[float, ...]
    summary: dict[str, float | int | bool | str]
    epoch_s: float | None = None
    note: str = ""
    begin_s: float | None = None
    encounters: tuple[Encounter, ...] = ()
    energy: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
