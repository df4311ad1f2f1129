"""The status of the service in one message a second, for pages and recordings. No decision depends on it."""

from __future__ import annotations

import numpy as np

from companion.flight.construction.loiter_circles import place_of
from companion.flight.prediction.return_words import return_in_words
from companion.flight.tasks.composition import Composition
from companion.mission.operator import Operator

_DIGITS = 1  # Positions are rounded to decimetres.


class PilotStatus:
    """Summarises the service.

    Parameters
    ----------
    parts : Composition
        The parts of the service.
    """

    def __init__(self, parts: Composition) -> None:
        self._parts = parts
        self._operator: Operator | None = None
        self._places: list[list[float]] = []

    def message(self, *, is_received: bool, is_warm: bool) -> dict[str, object]:
        """Return the message ``/standing``.

        Parameters
        ----------
        is_received : bool
            Whether a heartbeat was received recently.
        is_warm : bool
            Whether every kernel is compiled.
        """
        parts, state = self._parts, self._parts.flight.state
        replanning, found = parts.replanning, parts.departure.other_modes.resume
        current, emergency = replanning.handover.reader.current, replanning.emergency
        watch = parts.departure.other_modes.return_watch
        handback: dict[str, object] = {}
        if found is not None:
            places = np.round(found.positions_enu_m[::4], _DIGITS)
            handback = {"is_safe": found.is_safe, "text": found.text, "way_enu_m": places}
        gliding = parts.departure.glide.status()
        return {
            **({"glide": gliding} if gliding else {}),
            "mode": state.mode.name.lower(),
            "autopilot_mode": state.autopilot_mode,
            "is_heard": is_received,
            "is_warm": is_warm,
            "is_armed": state.phase.is_armed,
            "is_airborne": state.phase.is_airborne,
            "is_recording": parts.recorder.is_recording,
            "is_in_trouble": replanning.is_in_trouble(),
            "emergency": None if emergency is None else emergency.value,
            "goals": [[*goal.position_enu_m, goal.acceptance_radius_m] for goal in state.goals],
            "next_goal": state.num_done,
            "item": None if current is None else current.sequence,
            "num_items": len(state.mission_list.stored),
            "handback": handback,
            "returns": {
                "is_safe": watch.is_safe,
                "text": return_in_words(state),
                "way_enu_m": np.round(watch.track_enu_m[::8], _DIGITS),
            },
            "operator_enu_m": self._operator_places(),
            "team": replanning.team.status(),
        }

    def _operator_places(self) -> list[list[float]]:
        """Return the positions of the operator's items [m], computed again if the list changes."""
        state = self._parts.flight.state
        operator = state.mission_list.operator
        if operator is not self._operator:
            self._operator = operator
            items = () if operator is None else operator.items[operator.first :]
            found = (place_of(state, item) for item in items)
            self._places = [np.round(place, _DIGITS).tolist() for place in found if place is not None]
        return self._places
