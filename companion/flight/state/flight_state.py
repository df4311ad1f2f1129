"""The state of a flight: the flown path, the rules, and who flies, as one frozen value with one owner.

Theory of operation. :class:`FlightState` is everything that a decision depends on, apart from the known
world. It is never changed, only replaced, and only by :meth:`StateOwner.apply`, which takes a function of
this module, of :mod:`companion.flight.state.goals_state` or of :mod:`companion.flight.state.list_state`: each
maps the state and one event to the next state.

==========================  =============================================================
event                       function
==========================  =============================================================
pilot takes over            :func:`after_mode_event`, and when the pilot hands back
armed, disarmed             :func:`after_armed_reported`
autopilot's parameters      :func:`after_settings_reported`
its kind, mode, target      :func:`after_heartbeat`, :func:`after_target_reported`,
                            on the ground :func:`after_autopilot_known`
taken off, landed           :func:`after_landed_reported`, :func:`after_movement_reported`
mission file reloaded       :func:`after_reload`
restart in flight           :func:`after_restart`, once the flown mission is known
fences read                 :func:`after_fences`
rally points                :func:`after_rally_reported`, :func:`after_rally_points`
home reported               :func:`after_home_reported`
the autopilot's list        :func:`after_list`, with a function of ``list_state``
list laid out again         :func:`after_list_adopted`
takeover                    :func:`after_takeover`
mission entered             :func:`after_swap`
own position                :func:`after_position`
goals won in a team         :func:`after_auction`
asked to circle elsewhere   :func:`after_goal_added`, :func:`after_goal_dropped`
return that is planned      :func:`after_return_begun`
==========================  =============================================================
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Concatenate, ParamSpec

import numpy as np

from companion.assurance.violation import Violation
from companion.config import MissionConfig
from companion.config.rules import COORDINATION_CHANGE, Rules, rules_of
from companion.flight.state.flight_phase import (
    FlightPhase,
    after_armed_state,
    after_landed_state,
    after_movement,
)
from companion.flight.state.list_state import (
    FlownPath,
    ListState,
    after_landing,
    after_other_goals,
    after_pause,
    after_taken,
)
from companion.flight.state.modes import Mode, ModeEvent, next_mode
from companion.mission.list_layout import Layout
from companion.mission.path_progress import progress_on
from companion.planning.problem import GoalRegion
from companion.types.events import Heartbeat, HomePosition, MissionCurrent, Motion, SteeringTarget
from companion.types.mission import MissionItem
from companion.types.path import Path
from companion.types.state import AutopilotSettings, Ownship
from companion.types.threat import Obstacle, ThreatPicture

SEARCH_ROWS = 20  # The aircraft is searched in this many rows of the path ahead.
# Plans reach goals within these shares of their acceptance radius: goals to pass, and the last goal.
NARROWED_SHARE, NARROWED_LAST_SHARE = 0.6, 0.75
GOAL_RADIUS_M = 60.0  # Acceptance radius of goals that are the operator's waypoints.

Arguments = ParamSpec("Arguments")


@dataclass(frozen=True, slots=True)
class FlightState:
    """The state of one flight.

    Parameters
    ----------
    rules : Rules
        The rules for plans and missions: mission file and fences.
    phase : FlightPhase
        Whether the aircraft is or was armed, and flies.
    mode : Mode
        What the service may do.
    goals : tuple of GoalRegion
        The goals in their order: the mission file's, or the operator's waypoints.
    actions : tuple of tuple of MissionItem
        The operator's DO_ items at each goal.
    goal_items : tuple of int
        Sequences of the operator's items that are the goals; empty if the mission file has goals.
    next_goal : int
        Index of the first goal that is not reached.
    is_on_call : bool
        Whether other members of the team have goals left that this one may win.
    is_returning : bool
        Whether the service plans a return that was begun; its end is the last goal.
    next_own : int or None
        Index of the mission's next goal while another place is flown to, which is the last of ``goals``: the
        end of a return, or a circle out of another member's way. None if there is no such place.
    flown : FlownPath or None
        The flown path of the service.
    tail_enu_m : tuple of float, or None
        Where the operator's mission continues after the last goal [m]; None if not known.
    wind_enu_m_s : tuple of float
        Last estimate of the velocity of the air, east and north [m/s].
    wind_std_m_s : float
        Standard deviation of that estimate [m/s].
    coordination : float
        Rate of turn as a share of that of a coordinated turn with the same bank.
    picture : ThreatPicture
        Threats in the last snapshot.
    flies_by : bool
        Whether the autopilot turns before a waypoint, as ArduPlane does.
    settings : AutopilotSettings
        The autopilot's parameters of its guidance.
    autopilot_mode : str
        The autopilot's name of its flight mode; '' before the first heartbeat.
    motion : Motion
        What the autopilot does in that mode.
    is_failsafe : bool
        Whether it reported a failsafe when it entered that mode.
    target_enu_m : tuple of float, or None
        Position that it has reported in that mode as its target [m].
    home_enu_m : tuple of float, or None
        Home, to which the autopilot returns; None until it is reported [m].
    rally_points : tuple of tuple of float
        Rally points, to which it may return instead, as far as they were read [m].
    holds_rally_points : bool
        Whether the autopilot has reported that it has rally points.
    joins_returns : bool
        Whether an ArduPlane joins return paths as its parameter says; some versions do not.
    mission_list : ListState
        Knowledge of the autopilot's list.
    """

    rules: Rules
    phase: FlightPhase
    mode: Mode = Mode.WAITING
    goals: tuple[GoalRegion, ...] = ()
    actions: tuple[tuple[MissionItem, ...], ...] = ()
    goal_items: tuple[int, ...] = ()
    next_goal: int = 0
    is_on_call: bool = False
    is_returning: bool = False
    next_own: int | None = None
    flown: FlownPath | None = None
    tail_enu_m: tuple[float, float, float] | None = None
    wind_enu_m_s: tuple[float, float] = (0.0, 0.0)
    wind_std_m_s: float = 0.0
    coordination: float = 1.0
    picture: ThreatPicture = field(default_factory=ThreatPicture)
    flies_by: bool = True
    settings: AutopilotSettings = field(default_factory=AutopilotSettings)
    autopilot_mode: str = ""
    motion: Motion = Motion.STEERED
    is_failsafe: bool = False
    target_enu_m: tuple[float, float, float] | None = None
    home_enu_m: tuple[float, float, float] | None = None
    rally_points: tuple[tuple[float, float, float], ...] = ()
    holds_rally_points: bool = False
    joins_returns: bool = True
    mission_list: ListState = field(default_factory=ListState)

    @property
    def mission(self) -> MissionConfig:
        """The mission file in force."""
        return self.rules.mission

    @property
    def may_act(self) -> bool:
        """Whether the pilot leaves the aircraft to the service."""
        return self.mode is Mode.ACTIVE

    @property
    def may_write(self) -> bool:
        """Whether the list may be changed, also while the pilot flies, to keep a resume path ready."""
        is_kept_ready = self.mode is Mode.SUSPENDED and self.mission.authority.keep_ready
        return self.may_act or (is_kept_ready and self.mission.authority.resume == "auto")

    @property
    def has_arrived(self) -> bool:
        """Whether the last goal was reached, and the team has none left for this member."""
        may_arrive = bool(self.goals) or self.mission.shares_goals
        return may_arrive and not self.goals_left and not self.is_on_call

    @property
    def own_goals(self) -> tuple[GoalRegion, ...]:
        """The mission's goals, without a place that was added."""
        return self.goals if self.next_own is None else self.goals[:-1]

    @property
    def num_reached(self) -> int:
        """Number of the mission's goals that are reached."""
        return self.next_goal if self.next_own is None else self.next_own

    @property
    def num_done(self) -> int:
        """Number of the mission's goals that are reached, or given up for a return."""
        return self.next_goal if self.is_returning else self.num_reached

    @property
    def goals_left(self) -> tuple[GoalRegion, ...]:
        """Goals that are not reached yet, with narrower radii than those at which they count as reached.

        A path that just touches a goal's region is flown a few metres off, and the aircraft would turn
        back. The goals that the flight continues after are narrowed most.
        """
        left = self.goals[self.next_goal :]
        num_passed = len(left) if self.continues_behind else max(len(left) - 1, 0)
        shares = [NARROWED_SHARE] * num_passed + [NARROWED_LAST_SHARE] * (len(left) - num_passed)
        return tuple(
            replace(goal, acceptance_radius_m=share * goal.acceptance_radius_m)
            for goal, share in zip(left, shares, strict=True)
        )

    @property
    def flies_aside(self) -> bool:
        """Whether the last of ``goals`` is a circle out of another member's way."""
        return self.next_own is not None and not self.is_returning

    @property
    def continues_behind(self) -> bool:
        """Whether the operator's mission continues behind the last of ``goals``."""
        return self.tail_enu_m is not None and not self.flies_aside

    @property
    def flies_to_goal(self) -> bool:
        """Whether the flown path leads to the last goal, not to a safe loiter."""
        return self.flown is not None and self.leads_to_goal(self.flown.path)

    def leads_to_goal(self, path: Path) -> bool:
        """Return whether a path leads to the last goal; there may be none any more."""
        if not self.goals:
            return False
        away = np.linalg.norm(path.positions_enu_m[-1] - self.goals[-1].position_enu_m)
        return bool(away <= self.goals[-1].acceptance_radius_m + 1.0)

    def region_at(self, place_enu_m: tuple[float, float, float]) -> GoalRegion:
        """Return an operator's position [m] as a goal; in the plane, at the mission's level."""
        if self.mission.dimension == 2:
            place_enu_m = (*place_enu_m[:2], self.rules.level_m)
        return GoalRegion(place_enu_m, GOAL_RADIUS_M)

    @property
    def turn_radius_m(self) -> float:
        """Radius of the tightest turn that can be flown on any course in the present wind [m]."""
        return self.rules.vehicle.turn_radius_in(math.hypot(*self.wind_enu_m_s))

    def violations_of(self, path: Path) -> tuple[Violation, ...]:
        """Return the violations of a path that should reach the last goal."""
        return self.violations_to(self.goals[-1] if self.goals else None, path)

    def violations_to(self, goal: GoalRegion | None, path: Path) -> tuple[Violation, ...]:
        """Return the violations of a path in the present wind; it should reach the goal if one is given."""
        return self.rules.checker.check_path(
            path,
            goal_enu_m=None if goal is None else goal.position_enu_m,
            acceptance_radius_m=None if goal is None else goal.acceptance_radius_m + 1.0,
            wind_enu_m_s=self.wind_enu_m_s,
            wind_std_m_s=self.wind_std_m_s,
            picture=self.picture,
            may_come_back=True,
        )


class StateOwner:
    """Holds the state of a flight, from an initial one on; no other object replaces it."""

    def __init__(self, state: FlightState) -> None:
        self._state = state

    @property
    def state(self) -> FlightState:
        """The state now."""
        return self._state

    @property
    def listed(self) -> ListState:
        """Return the present knowledge of the autopilot's list."""
        return self._state.mission_list

    def apply(
        self,
        transition: Callable[Concatenate[FlightState, Arguments], FlightState],
        *arguments: Arguments.args,
        **named: Arguments.kwargs,
    ) -> FlightState:
        """Replace the state by the result of a transition; return the new state."""
        self._state = transition(self._state, *arguments, **named)
        return self._state

    def update_world(self, ownship: Ownship, picture: ThreatPicture) -> FlightState:
        """Use the present wind and threats for judging from now on; return the new state."""
        self._state = replace(_in_air(self._state, ownship), picture=picture)
        return self._state

    def apply_to_list(
        self,
        transition: Callable[Concatenate[ListState, Arguments], ListState],
        *arguments: Arguments.args,
        **named: Arguments.kwargs,
    ) -> ListState:
        """Replace the knowledge of the list by the result of a transition; return the new one."""
        listed = transition(self._state.mission_list, *arguments, **named)
        self._state = after_list(self._state, listed)
        return listed


def first_state(mission: MissionConfig, now_s: float) -> FlightState:
    """Return the state before anything is received, at a reading of the clock [s]."""
    rules, shared = rules_of(mission), mission.shares_goals
    return FlightState(
        rules, FlightPhase(now_s), goals=() if shared else rules.goals, is_on_call=shared,
        coordination=rules.vehicle.coordination,
    )  # fmt: skip


def after_mode_event(state: FlightState, event: ModeEvent) -> FlightState:
    """Return the state after a mode event; see the table in :mod:`companion.flight.state.modes`.

    Whenever the aircraft is left to the service again, others may have used the pause, so the list is read
    again. A landing clears everything of the flight: the next one begins with the list as it is then.
    """
    mode = next_mode(state.mode, event, may_resume=state.mission.authority.resume == "auto")
    if mode is state.mode:
        return state
    if event is ModeEvent.LANDED:
        goals = (state.is_returning and state.rules.goals) or state.own_goals
        return replace(
            state, mode=mode, goals=goals, is_returning=False, next_own=None, next_goal=0, flown=None,
            tail_enu_m=None, mission_list=after_landing(state.mission_list),
        )  # fmt: skip
    is_back = mode is Mode.ACTIVE and event in (ModeEvent.MISSION_FLOWN, ModeEvent.RETURN_RENEWED)
    listed = after_pause(state.mission_list) if is_back else state.mission_list
    return replace(state, mode=mode, mission_list=listed)


def after_armed_reported(state: FlightState, now_s: float, *, is_armed: bool) -> FlightState:
    """Return the state after a heartbeat reported armed or disarmed; a while disarmed means landed."""
    return replace(state, phase=after_armed_state(state.phase, now_s, is_armed=is_armed))


def after_landed_reported(state: FlightState, landed_state: int) -> FlightState:
    """Return the state after the autopilot reported its MAV_LANDED_STATE."""
    return replace(state, phase=after_landed_state(state.phase, landed_state))


def after_movement_reported(
    state: FlightState, height_above_home_m: float, ground_speed_m_s: float
) -> FlightState:
    """Return the state after a position report: height above home [m], speed over ground [m/s]."""
    phase = after_movement(state.phase, height_above_home_m, ground_speed_m_s)
    return state if phase is state.phase else replace(state, phase=phase)


def after_autopilot_known(state: FlightState, *, flies_by: bool) -> FlightState:
    """Return the state once the kind of autopilot is known."""
    return replace(state, flies_by=flies_by)


def after_heartbeat(state: FlightState, heartbeat: Heartbeat) -> FlightState:
    """Return the state after a heartbeat: kind of autopilot and flight mode; a new mode has no target."""
    flies_by = heartbeat.dialect.flies_by
    if state.flies_by is flies_by and state.autopilot_mode == heartbeat.mode:
        return state
    return replace(
        state, flies_by=flies_by, autopilot_mode=heartbeat.mode, motion=heartbeat.motion,
        is_failsafe=heartbeat.is_failsafe, target_enu_m=None,
    )  # fmt: skip


def after_target_reported(state: FlightState, target: SteeringTarget) -> FlightState:
    """Return the state after the autopilot reported the position that it flies to."""
    place = state.mission.frame.local_from_global(
        target.latitude_deg, target.longitude_deg, target.altitude_amsl_m
    )
    return replace(state, target_enu_m=place)


def after_straight_return(state: FlightState) -> FlightState:
    """Return the state after an ArduPlane joined no return path in a return to launch."""
    return replace(state, joins_returns=False)


def after_settings_reported(state: FlightState, settings: AutopilotSettings) -> FlightState:
    """Return the state with the autopilot's parameters, which may allow less bank than assumed."""
    rules = rules_of(state.mission, state.rules.fences, settings, state.rules.vehicle.coordination)
    is_same = rules.vehicle == state.rules.vehicle
    return replace(state, settings=settings, rules=state.rules if is_same else rules)


def after_home_reported(state: FlightState, home: HomePosition) -> FlightState:
    """Return the state after the autopilot reported its home."""
    place = state.mission.frame.local_from_global(home.latitude_deg, home.longitude_deg, home.altitude_amsl_m)
    return replace(state, home_enu_m=place)


def after_rally_points(state: FlightState, places: tuple[tuple[float, float, float], ...]) -> FlightState:
    """Return the state with the autopilot's rally points, each east, north, up [m]."""
    return replace(state, rally_points=places)


def after_rally_reported(state: FlightState, *, holds_any: bool) -> FlightState:
    """Return the state after the autopilot reported whether it has rally points."""
    return state if state.holds_rally_points is holds_any else replace(state, holds_rally_points=holds_any)


def after_reload(state: FlightState, mission: MissionConfig) -> FlightState:
    """Return the state with another mission file; a changed list of goals begins at its first."""
    rules = rules_of(mission, state.rules.fences, state.settings, state.rules.vehicle.coordination)
    goals, next_goal, next_own = state.goals, state.next_goal, state.next_own
    has_own = mission.goals_from_autopilot or mission.shares_goals or state.is_returning
    if not has_own and rules.goals != state.own_goals:
        goals, next_goal, next_own = rules.goals, 0, None
    is_other = mission.goals != state.mission.goals
    listed = after_other_goals(state.mission_list) if is_other else state.mission_list
    return replace(
        state, rules=rules, goals=goals, next_goal=next_goal, next_own=next_own, mission_list=listed
    )  # fmt: skip


def after_fences(state: FlightState, fences: tuple[Obstacle, ...]) -> FlightState:
    """Return the state with the autopilot's fences, which plans and missions keep from now on."""
    rules = rules_of(state.mission, fences, state.settings, state.rules.vehicle.coordination)
    return replace(state, rules=rules)


def after_list(state: FlightState, listed: ListState) -> FlightState:
    """Return the state with new knowledge of the list."""
    return replace(state, mission_list=listed)


def after_list_adopted(
    state: FlightState, listed: ListState, tail_enu_m: tuple[float, float, float] | None
) -> FlightState:
    """Return the state after a list was adopted as the operator's: no path of the service is flown."""
    return replace(state, mission_list=listed, flown=None, tail_enu_m=tail_enu_m)


def after_restart(
    state: FlightState, flown: FlownPath | None = None, num_goals_reached: int = 0
) -> FlightState:
    """Return the state after a restart in flight, with the restored path and the goals that were reached."""
    return replace(state, flown=flown or state.flown, next_goal=max(state.next_goal, num_goals_reached))


def after_swap(
    state: FlightState, layout: Layout, flown: FlownPath, current: MissionCurrent | None
) -> FlightState:
    """Return the state once a mission of the service is flown."""
    listed = after_taken(state.mission_list, layout, flown.mission.items, current)
    return replace(state, flown=flown, mission_list=listed)


def after_goal_dropped(state: FlightState) -> FlightState:
    """Return the state with the mission's goals that are left, and no place that was added."""
    return replace(state, goals=state.own_goals, next_goal=state.num_reached, next_own=None)


def after_position(state: FlightState, ownship: Ownship) -> FlightState:
    """Return the state with the goals passed by now, the wind, and the aircraft's row on its path.

    At a place that was added, the flight goes on with the mission's goals that are left.
    """
    next_goal, flown = state.next_goal, state.flown
    while next_goal < len(state.goals):
        goal = state.goals[next_goal]
        if math.dist(goal.position_enu_m, ownship.position_enu_m) > goal.acceptance_radius_m:
            break
        next_goal += 1
    if flown is not None:
        row = progress_on(flown.path, ownship.position_enu_m, flown.row, SEARCH_ROWS).row
        flown = replace(flown, row=row)
    after = replace(_in_air(state, ownship), next_goal=next_goal, flown=flown)
    has_others = next_goal == len(state.goals) and state.num_reached < len(state.own_goals)
    return after_goal_dropped(after) if has_others and not state.is_returning else after


def _in_air(state: FlightState, ownship: Ownship) -> FlightState:
    """Return the state with the present wind, and with how the aircraft turns, on which the rules depend."""
    rules, coordination = state.rules, ownship.coordination
    if abs(coordination - rules.vehicle.coordination) > COORDINATION_CHANGE:
        rules = rules_of(state.mission, rules.fences, state.settings, coordination)
    return replace(
        state,
        rules=rules,
        wind_enu_m_s=ownship.wind_enu_m_s,
        wind_std_m_s=ownship.wind_std_m_s,
        coordination=coordination,
    )
