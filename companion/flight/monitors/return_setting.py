"""Set the autopilot's parameter for a return to launch, where the mission file allows it."""

from __future__ import annotations

import math

from companion.clock import Clock
from companion.errors import CompanionError
from companion.flight.construction.way_on import BY_MISSION
from companion.flight.messages.announcer import Announcer
from companion.flight.state.decision import DecisionKind
from companion.flight.state.flight_state import FlightState, StateOwner
from companion.link.missions.autopilot_link import AutopilotLink
from companion.types.state import BY_RETURN_PATH, LANDING_AT_ONCE

AGAIN_S = 30.0  # Time between two attempts.


def return_kind_to_set(state: FlightState) -> float | None:
    """Return the value with which returns follow checked paths; None if nothing is to be set.

    An ArduPlane has RTL_AUTOLAND 2 in all versions. A PX4 without a landing in its mission would fly its
    mission backwards with RTL_TYPE 2. The parameter of an armed aircraft is left alone.

    Parameters
    ----------
    state : FlightState
        The mission file, the operator's list, and the autopilot's parameters.
    """
    operator, kind = state.mission_list.operator, state.settings.return_kind
    if not state.mission.authority.set_return or state.phase.is_armed or operator is None or kind is None:
        return None
    if state.flies_by:
        return None if kind in (LANDING_AT_ONCE, BY_RETURN_PATH) else LANDING_AT_ONCE
    return BY_MISSION if operator.has_landing and kind != BY_MISSION else None


class ReturnSetting:
    """Sets RTL_AUTOLAND or RTL_TYPE before the flight.

    Parameters
    ----------
    flight : StateOwner
        The mission file, the operator's list, and the autopilot's parameters.
    link : AutopilotLink
        The link to the autopilot.
    announcer : Announcer
        Informs the pilot.
    clock : Clock
        The service's clock.
    """

    def __init__(self, flight: StateOwner, link: AutopilotLink, announcer: Announcer, clock: Clock) -> None:
        self._flight, self._link = flight, link
        self._announcer, self._clock = announcer, clock
        self._next_s = -math.inf

    async def keep_up(self) -> None:
        """Set the parameter if it has another value; a failure is announced, and tried again later."""
        state, now_s = self._flight.state, self._clock.now_s()
        value, dialect = return_kind_to_set(state), self._link.dialect
        if value is None or dialect is None or now_s < self._next_s:
            return
        self._next_s = now_s + AGAIN_S
        name = dialect.parameter_names["return_kind"]
        try:
            await self._link.set_parameter(name, int(value))
        except CompanionError as error:
            text = f"{name} {value:g} not set: {error}"
            self._announcer.decide(DecisionKind.RETURN, text, tell="return not set", name=name)
        else:
            before = state.settings.return_kind
            self._announcer.decide(
                DecisionKind.RETURN, f"{name} set to {value:g}, was {before:g}", tell="return set",
                name=name, value=f"{value:g}", before=f"{before:g}",
            )  # fmt: skip
