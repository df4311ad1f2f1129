"""A flight as it is reported: what was flown, decided and uploaded."""

from __future__ import annotations

from dataclasses import dataclass

from companion.frames import FloatArray


@dataclass(frozen=True, slots=True)
class Decision:
    """One line of the decision table.

    ``plan_ms`` is the computing time of the plan behind it, ``track_to_mission_ms`` the time from the
    newest track to the mission that answers it being flown.
    """

    stamp_s: float
    kind: str
    text: str
    plan_ms: float | None = None
    track_to_mission_ms: float | None = None


@dataclass(frozen=True, slots=True)
class UploadedMission:
    """A mission that was flown: ``positions_enu_m`` (K, 3) are its waypoints [m]."""

    stamp_s: float
    positions_enu_m: FloatArray
    reason: str


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
        In order.
    decisions : tuple of Decision
        In order.
    threat : ndarray, shape (N, 2)
        Time [s] and threat level along the flight.
    plan_ms : tuple of float
        Computing time of every plan [ms].
    summary : dict
        Shown as a table.
    """

    flown: FloatArray
    dt_paths: tuple[FloatArray, ...]
    dt_tracks: tuple[FloatArray, ...]
    missions: tuple[UploadedMission, ...]
    decisions: tuple[Decision, ...]
    threat: FloatArray
    plan_ms: tuple[float, ...]
    summary: dict[str, float | int | bool | str]
