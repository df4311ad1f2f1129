"""The part of one flight in a team: its agreement, and what it says of its goals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from companion.config.sections.team_section import TeamConfig
from companion.flight.state.flight_state import FlightState, StateOwner
from companion.flight.state.goals_state import after_auction
from companion.flight.state.modes import Mode
from companion.mission.team.agreement import Agreement
from companion.mission.team.goal_auction import GoalAuction
from companion.mission.team.shared_plan import NUMBERS
from companion.mission.team.team_settings import TeamSettings

REPLY_S, REPEAT_S, QUIET_S = 0.4, 1.0, 5.0  # As in TeamSettings: a plan has seconds to be approved.
AVAILABLE = frozenset({Mode.ACTIVE, Mode.LOST})


def settings_of(config: TeamConfig) -> TeamSettings:
    """Return what the members agree on before they fly, from the mission file."""
    return TeamSettings(
        apart_m=config.apart_m, apart_up_m=config.apart_up_m, lost_after_s=config.lost_after_s,
        reply_s=REPLY_S, repeat_s=REPEAT_S, quiet_s=QUIET_S,
    )  # fmt: skip


def new_agreement(state: FlightState, system_id: int, utc_s: float) -> Agreement | None:
    """Return a member's part in the agreement from now on; None if the system is no member of a team.

    Parameters
    ----------
    state : FlightState
        The state, with the mission file.
    system_id : int
        The autopilot's system id.
    utc_s : float
        UTC time [s].
    """
    config, frame = state.mission.team, state.mission.frame
    if config is None or system_id not in config.members:
        return None
    auction = None
    if config.share_goals:
        places = np.array([goal.position_enu_m[:2] for goal in state.rules.goals])
        auction = GoalAuction(system_id, places, frame, state.rules.vehicle.airspeed_cruise_m_s)
    return Agreement(
        system_id, config.members, frame, settings_of(config),
        started_s=utc_s, first_number=int(utc_s) % NUMBERS, commits_itself=False, auction=auction,
    )  # fmt: skip


def is_available(state: FlightState) -> bool:
    """Return whether a member flies goals of the team: the pilot leaves it to the service."""
    return state.mode in AVAILABLE


def take_goals(flight: StateOwner, won: Sequence[int], *, is_over: bool) -> bool:
    """Let a member fly the goals that it has won; return whether they are others than before.

    Parameters
    ----------
    flight : StateOwner
        The flight's state.
    won : sequence of int
        Numbers of the mission file's goals in the order in which they are flown, from 0.
    is_over : bool
        Whether all goals of the team are flown.
    """
    goals = flight.state.goals
    return flight.apply(after_auction, won, is_over=is_over).goals != goals


def reached_goals(state: FlightState) -> tuple[int, ...]:
    """Return the numbers of the mission file's goals that this member has reached, from 0."""
    listed = state.rules.goals
    return tuple(listed.index(goal) for goal in state.own_goals[: state.num_reached])
