"""Read the autopilot's mission list, and find out whose it is and which part is flown."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from functools import partial

from companion.errors import CompanionError
from companion.flight.construction.mission_simulation import stored_ground
from companion.flight.exchange.protocols import SwapProtocols
from companion.flight.messages.announcer import Announcer
from companion.flight.state.checkpoint import Checkpoint, key_of
from companion.flight.state.decision import DecisionKind
from companion.flight.state.flight_state import StateOwner, after_list_adopted, after_restart
from companion.flight.state.goals_state import after_operator_goals, after_return_begun
from companion.flight.state.list_state import (
    FlownPath,
    MissionPosition,
    after_adopted,
    after_current_reported,
    after_found_as_left,
    after_found_flown,
    after_landing_missed,
    after_text_reported,
)
from companion.flight.state.modes import ModeEvent
from companion.mission.list_layout import Layout
from companion.mission.operator import (
    TERRAIN_FRAMES,
    Operator,
    goals_of_operator,
    operator_of,
    position_of,
)
from companion.mission.path_progress import progress_on
from companion.types.events import MissionCurrent, StatusText
from companion.types.mission import Mission, MissionItem


class ListReadResult(Enum):
    """The contents of the autopilot's list."""

    OURS = "ours, or nothing new"
    FOREIGN = "another mission"
    UNREADABLE = "not to be read"


class ListReader:
    """Keeps the knowledge of the autopilot's list up to date.

    Parameters
    ----------
    protocols : SwapProtocols
        The autopilots' protocols, with flight state, link and aircraft.
    announcer : Announcer
        Announces to the pilot.
    checkpoint : Checkpoint
        Remembers the path of a mission found in the autopilot, and the goals that are reached.
    """

    def __init__(self, protocols: SwapProtocols, announcer: Announcer, checkpoint: Checkpoint) -> None:
        self._parts = protocols.parts
        self._protocols = protocols
        self._announcer = announcer
        self._checkpoint = checkpoint
        self._flight, self._link = self._parts.flight, self._parts.link

    @property
    def position(self) -> MissionPosition:
        """The autopilot's position in its list."""
        return self._flight.listed.position(self._link.current)

    @property
    def current(self) -> MissionCurrent | None:
        """The item that the autopilot flies."""
        return self._link.current

    def note(self, event: MissionCurrent | StatusText) -> None:
        """Watch for missions that the service did not send, and for items that it did not choose."""
        if isinstance(event, StatusText):
            self._flight.apply_to_list(after_text_reported, event.text)
            return
        self._flight.apply_to_list(
            after_current_reported,
            event,
            is_flying_ours=self._flight.state.flown is not None,
            num_home_items=self._protocols.dialect.num_home_items,
        )

    async def prepare(self) -> ListReadResult:
        """Read the autopilot's list if it is not known, or may have been changed by another station."""
        listed = self._flight.listed
        if listed.layout is not None and not listed.suspected:
            return ListReadResult.OURS
        try:
            read = await self._parts.read()
        except CompanionError as error:
            text = f"the autopilot's mission cannot be read: {error}"
            self._announcer.decide(DecisionKind.REJECTED, text, tell="unreadable")
            return ListReadResult.UNREADABLE
        is_first = self._flight.listed.layout is None
        if not is_first and self._flight.listed.is_as_left(read):
            self._flight.apply_to_list(after_found_as_left, self._link.current)
            return ListReadResult.OURS
        layout = self._adopt(read)
        span = self._span_flown(read, layout)
        if is_first and span is not None:
            layout = self._protocols.now.layout_as_flown(layout, read[slice(*span)])
            self._flight.apply_to_list(after_found_flown, layout)
            self._recover(read, span)
            reached = self._checkpoint.reached([goal.position_enu_m for goal in self._flight.state.goals])
            state = self._flight.apply(after_restart, num_goals_reached=reached)
            if (end := self._checkpoint.return_end) is not None and reached == len(state.goals):
                place = state.region_at(end[0])
                self._flight.apply(after_return_begun, place, state.flown, is_landing=end[1])
            text = f"the autopilot flies a mission of ours; {reached} goals reached"
            self._announcer.decide(DecisionKind.RESTART, text, tell="restarted")
        return ListReadResult.OURS if is_first else ListReadResult.FOREIGN

    def _span_flown(self, read: tuple[MissionItem, ...], layout: Layout) -> tuple[int, int] | None:
        """Return where the service's items are in a list, if the aircraft flies one of them."""
        if not self._flight.state.phase.is_moving:  # On the ground they belong to the last flight.
            return None
        current, span = self._link.current, self._protocols.now.span_of_ours(read, layout)
        if current is None or span is None or not span[0] <= current.sequence < span[1]:
            return None
        return span

    def _recover(self, read: tuple[MissionItem, ...], span: tuple[int, int]) -> None:
        """Restore the path of a mission that the autopilot has been flying since before a restart."""
        kept = self._checkpoint.flown(key_of(read[slice(*span)]))
        state = self._parts.state()
        if kept is None or state is None:
            return
        path, until_s = kept
        row = progress_on(path, state.position_enu_m).row
        self._flight.apply(after_restart, FlownPath(path, Mission(read, span[0], 0), until_s, row))

    def _adopt(self, read: tuple[MissionItem, ...]) -> Layout:
        """Adopt a list as the operator's, apart from the service's items in it."""
        layout = adopt(self._flight, self._protocols, read)
        listed, operator = self._flight.listed, self._flight.listed.operator
        is_missed = bool(read) and operator is not None and not operator.has_landing
        if self._protocols.now.wants_landing and is_missed and not listed.landing_reported:
            self._flight.apply_to_list(after_landing_missed)
            text = "no landing in the autopilot's mission"
            fault = "PX4 does not arm without a landing item"
            self._announcer.decide(DecisionKind.LANDING, text, tell="check", about=text, fault=fault)
        return layout

    async def knows_mission(self) -> tuple[bool, ModeEvent | None]:
        """Return whether the autopilot's list is known and left to the service.

        Returns
        -------
        bool
            Whether plans can be made for the list.
        ModeEvent or None
            The event that another station's mission is flown.
        """
        result = await self.prepare()
        if result is ListReadResult.UNREADABLE:
            return False, None
        state = self._flight.state
        if result is ListReadResult.FOREIGN:
            if not state.mission.goals_from_autopilot:
                return False, ModeEvent.OTHER_MISSION
            words = f"{len(state.goals)} goals"
            self._announcer.decide(
                DecisionKind.MISSION,
                f"another mission was uploaded: {words} from it",
                tell="other mission",
                mission=words,
            )
        if not state.goals and not state.mission.shares_goals:
            text = "the autopilot's mission has no waypoint to fly to"
            self._announcer.decide(DecisionKind.NO_PLAN, text, tell="no goal")
        return bool(state.goals), None


def adopt(flight: StateOwner, protocols: SwapProtocols, read: tuple[MissionItem, ...]) -> Layout:
    """Adopt a list as the operator's, apart from the service's items; return the list's layout.

    Parameters
    ----------
    flight : StateOwner
        The flight's state.
    protocols : SwapProtocols
        The autopilots' protocols.
    read : tuple of MissionItem
        The list as read.
    """
    protocol, link = protocols.now, protocols.parts.link
    mission, current, home = flight.state.mission, link.current, link.home_altitude_amsl_m
    place = None
    if mission.goals:
        last = mission.goals[-1]
        place = float(last.east_m), float(last.north_m), float(last.acceptance_radius_m)
    num_home_items = protocols.dialect.num_home_items
    operator = operator_of(
        protocol.without_ours(read), mission.frame, home, place, num_home_items=num_home_items
    )
    layout = protocol.layout_of(read, operator, current.sequence if current is not None else 0)
    listed = after_adopted(flight.listed, read, layout, operator, current, home)
    is_over_ground = any(item.frame in TERRAIN_FRAMES for item in read)
    ground = stored_ground(flight.state) if is_over_ground else None
    flight.apply(
        after_list_adopted,
        listed,
        _tail_position(operator, partial(position_of, frame=mission.frame, home_amsl_m=home, ground=ground)),
    )
    if mission.goals_from_autopilot:
        flight.apply(after_operator_goals, goals_of_operator(operator, mission.frame, home, ground))
    return layout


def _tail_position(
    operator: Operator, place_of: Callable[[MissionItem], tuple[float, float, float] | None]
) -> tuple[float, float, float] | None:
    """Return where the operator's mission continues after the goal; None if that is not known."""
    for item in operator.items[operator.tail :]:
        place = place_of(item)
        if place is not None:
            return place
    return None
