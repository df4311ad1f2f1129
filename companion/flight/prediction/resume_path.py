"""The path that the autopilot flies if the pilot hands back now, and whether it is safe.

A pilot reads that a handback is safe, and hands back some seconds later. Until then the aircraft flies on in
the present flight mode. Therefore a handback is called safe only if it is safe from each place that the
aircraft reaches in the next seconds, and if it meets nothing on the way there.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from companion.flight.prediction.mode_tracks import ModeTracks, state_on
from companion.flight.prediction.return_path import STEP_S
from companion.flight.state.flight_state import FlightState
from companion.flight.takeover.start_prediction import list_track
from companion.frames import FloatArray
from companion.types.events import MissionCurrent
from companion.types.state import Ownship

CHECKED_S = 45.0  # The resume path is checked this far; by then a new plan is flown.
LASTING_S = 10.0  # A handback is called safe if it stays so for this time.
LOOK_S = 2.5  # Handbacks are simulated at moments this far apart in that time.


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
    wrong = state.rules.checker.check_track(seen, state.rules.checker.limits.margin_m)
    if wrong:
        text = f"NOT safe: {wrong[0].detail} {wrong[0].value:.0f}"
        return ResumePath(False, text, wrong[0].in_short, seen)
    return ResumePath(True, f"safe, to item {current.sequence}", "", seen)


def lasting_resume_path(
    state: FlightState, current: MissionCurrent | None, ownship: Ownship, tracks: ModeTracks
) -> ResumePath:
    """Return the resume path from here; it is safe only if it stays so for the next seconds.

    Parameters
    ----------
    state, current, ownship
        Same as in :func:`resume_path`.
    tracks : ModeTracks
        What the aircraft flies until it is handed back.
    """
    now = resume_path(state, current, ownship)
    if not now.is_safe:
        return now
    rows = round(LASTING_S / STEP_S)
    margin = state.rules.checker.limits.margin_m
    for track in tracks.positions_enu_m:
        wrong = state.rules.checker.check_track(track[: rows + 1], margin, may_come_back=True)
        near = next((entry for entry in wrong if entry.rule == "clearance"), None)
        if near is not None:
            text = f"NOT safe: {near.detail} {near.value:.0f} in {STEP_S * near.row:.0f} s"
            return replace(now, is_safe=False, text=text, wrong=near.in_short)
        for row in range(round(LOOK_S / STEP_S), rows + 1, round(LOOK_S / STEP_S)):
            later = resume_path(state, current, state_on(track, row, ownship))
            if not later.is_safe:
                text = later.text.replace("NOT safe", f"NOT safe in {STEP_S * row:.0f} s", 1)
                return replace(now, is_safe=False, text=text, wrong=later.wrong)
    return now
