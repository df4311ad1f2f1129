"""What the autopilot flies if the pilot hands back now, and whether that is safe."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from companion.flight.state.flight_state import FlightState
from companion.flight.takeover.start_prediction import list_track
from companion.frames import FloatArray
from companion.types.events import MissionCurrent
from companion.types.state import Ownship

CHECKED_S = 45.0  # The resume path is checked this far; by then a new plan is flown.
MARGIN_SHARE = 0.5  # The resume path keeps this share of clearance_min_m.


@dataclass(frozen=True, slots=True)
class ResumePath:
    """The path that the autopilot flies when the mission mode is selected again.

    Parameters
    ----------
    is_safe : bool
        Whether the path is clear of everything.
    text : str
        The item that is flown to, or what is wrong.
    wrong : str
        What is wrong, as the pilot reads it; '' if nothing.
    positions_enu_m : ndarray, shape (N, 3)
        The first 45 s of the path, as far as known [m].
    """

    is_safe: bool
    text: str
    wrong: str = ""
    positions_enu_m: FloatArray = field(default_factory=lambda: np.empty((0, 3)), compare=False, repr=False)


def resume_path(state: FlightState, current: MissionCurrent | None, ownship: Ownship) -> ResumePath:
    """Predict and check the path from here to the item that is resumed.

    Parameters
    ----------
    state : FlightState
        Mission file and list.
    current : MissionCurrent or None
        The item that the autopilot resumes.
    ownship : Ownship
        The aircraft now.
    """
    track = None if current is None else list_track(state, current, ownship, is_direct=True)
    if track is None or current is None:
        return ResumePath(False, "NOT safe: it is not known what is flown", "mission not known")
    seen = track.positions_enu_m[track.times_s <= CHECKED_S]
    wrong = state.rules.checker.check_track(
        seen, MARGIN_SHARE * float(state.mission.planning.clearance_min_m)
    )
    if wrong:
        text = f"NOT safe: {wrong[0].detail} {wrong[0].value:.0f}"
        return ResumePath(False, text, wrong[0].in_short, seen)
    return ResumePath(True, f"safe, to item {current.sequence}", "", seen)
