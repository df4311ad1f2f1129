"""A flight as it is reported: what was flown, decided and uploaded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from companion.frames import FloatArray
from companion.types.encounter import Encounter
from companion.types.mission import MissionItem
from companion.types.plan import Plan


@dataclass(frozen=True, slots=True)
class Decision:
    """One line of the decision table.

    ``plan_ms`` is the computing time of the plan behind it, ``track_to_mission_ms`` the time from the
    newest track to the mission that answers it being flown. ``why`` has the numbers that led to it, and
    ``told`` is what the pilot read, '' if nothing.
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
    """A mission that was flown: ``positions_enu_m`` (K, 3) are its waypoints [m]."""

    stamp_s: float
    positions_enu_m: FloatArray
    reason: str


@dataclass(frozen=True, slots=True)
class PlanRecord:
    """A plan as it was made.

    Parameters
    ----------
    number : int
        Counts the plans of a flight from 1.
    occasion : str
        Why it was made now.
    purpose : str
        ``plan``, or ``least threat`` in an emergency.
    start : mapping
        Where it begins, and from where the aircraft was when it was made.
    plan : Plan
        The planner's answer.
    asked : int
        How often the search asked whether to stop.
    is_stopped : bool
        Whether it was told to: a wall clock decided, not the iteration budget.
    due_s, seen_s : float
        Clock readings at which it was found to be due, and at which the world that it was made in was
        seen [s].
    begun_s, took_s : float
        Clock reading at which the plan was begun, and how long it took by the same clock [s].
    plan_ms : float
        Time that the computer took [ms].
    is_broken_off : bool
        Whether a surprise made it useless before it was made.
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
    """A mission handed to the autopilot: how that ended, and when it began and ended by the clock.

    ``waypoints_enu_m`` (K, 3) are its waypoints [m].
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
    """Everything a report shows.

    Parameters
    ----------
    flown : ndarray, shape (N, 7)
        Time [s], east, north, up [m], course and climb angle [rad], speed [m/s].
    dt_paths, dt_tracks : tuple of ndarray, shape (M, 3)
        Time [s], east, north [m] of each moving threat: as it was, and as it was tracked.
    missions : tuple of UploadedMission
        Missions that were uploaded, in order.
    decisions : tuple of Decision
        Decisions of the flight, in order.
    threat : ndarray, shape (N, 2)
        Time [s] and threat level along the flight.
    plan_ms : tuple of float
        Computing time of every plan [ms].
    summary : dict
        Figures that are shown as a table.
    epoch_s : float, optional
        UTC at time 0 [s].
    note : str
        What is to be known of where the record comes from.
    begin_s : float, optional
        What counts as 00:00 [s]; left out, the first of the flown path.
    encounters : tuple of Encounter
        What each threat was to it, by the paths that are known best.
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
