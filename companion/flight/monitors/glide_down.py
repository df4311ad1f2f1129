"""The answer to missing thrust: choose a field to glide to, inform the pilot, and fly there if allowed.

The field with most height left is chosen, else open ground away from obstacles and people. The choice is
looked at again every half second and kept while it is within reach. With ``authority.glide`` its mission
is handed over; the landing is made current once no more height is left than the glide straight to the field
needs.
"""

from __future__ import annotations

import math
from enum import Enum

from companion.clock import Clock
from companion.flight.construction.mission_construction import ConstructedMission
from companion.flight.exchange.handover import Handover
from companion.flight.messages.announcer import Announcer
from companion.flight.monitors.performance_watch import PerformanceWatch
from companion.flight.state.decision import DecisionKind, Verdict
from companion.flight.state.flight_state import FlightState, StateOwner
from companion.flight.state.modes import Mode
from companion.flight.state.progress import start_by_motion
from companion.flight.state.world_model import WorldModel
from companion.mission.glide.glide_mission import (
    CIRCLE_ITEM,
    ENTRY_ITEM,
    LAND_ITEM,
    glide_part,
    glide_path,
    glide_waypoints,
)
from companion.mission.glide.glide_progress import (
    TURN_BEGINS_S,
    begin_of,
    best_place,
    circle_is_due,
    final_is_due,
    from_now,
    is_near,
    is_past,
)
from companion.mission.glide.landing_choice import GlideOptions, LandingChoice
from companion.types.mission import Command
from companion.types.state import Ownship

BACK_S = 6.0  # An aircraft past its field is turned back to it no more often than this.
OTHERS_MIN = 4  # Another place is chosen once it was found this many times in a row, at 2 Hz.
AGAIN_S = 1.0  # After a failed exchange, the next is tried after this time.
EARLIEST_S = 0.5  # No mission is entered sooner after its place was chosen.
LEAD_S = 2.5  # A mission is entered about this long after the place was chosen.


class Stage(Enum):
    """The stage of a glide."""

    NONE = "thrust"
    CHOSEN = "a place is chosen"
    FLOWN = "the mission to it is flown"
    FINAL = "the landing is flown"


class GlideDown:
    """Chooses where to come down without thrust, and flies there.

    Parameters
    ----------
    flight : StateOwner
        The flight's state.
    world_model : WorldModel
        The aircraft.
    handover : Handover
        Hands the mission over.
    announcer : Announcer
        Informs the pilot.
    performance : PerformanceWatch
        Notices whether thrust is missing.
    clock : Clock
        The service's clock.
    """

    def __init__(
        self, flight: StateOwner, world_model: WorldModel, handover: Handover, announcer: Announcer,
        performance: PerformanceWatch, clock: Clock,
    ) -> None:  # fmt: skip
        self._flight, self._world_model, self._handover = flight, world_model, handover
        self._announcer, self._performance, self._clock = announcer, performance, clock
        self._options: GlideOptions | None = None
        self._choice: LandingChoice | None = None
        self._stage, self._is_bound = Stage.NONE, False
        self._next_s = self._turned_s = -math.inf
        self._num_others = 0

    @property
    def is_commanded(self) -> bool:
        """Whether the aircraft is flown to a place without thrust, so that no plan is made."""
        state = self._flight.state
        return self._stage is not Stage.NONE and self._choice is not None and state.mission.authority.glide

    def status(self) -> dict[str, object]:
        """Return the place that is glided to, for the page; empty with thrust."""
        if self._stage is Stage.NONE:
            return {}
        if self._choice is None:
            return {"stage": "no place within glide", "is_commanded": False}
        name, place, radius = self._choice.place
        return {
            "stage": self._stage.value, "is_commanded": self.is_commanded, "name": name,
            "place_enu_m": [round(value, 1) for value in place], "radius_m": radius,
            "away_m": round(self._choice.away_m, 1), "spare_m": round(self._choice.spare_m, 1),
        }  # fmt: skip

    def look(self) -> bool:
        """Choose a place when thrust is missing, or look again at the chosen one; twice a second.

        Returns whether the aircraft is to be flown to it, unless it is on the final leg of a landing.
        """
        state, now = self._flight.state, self._clock.now_s()
        ownship = self._world_model.ownship.state(now)
        is_off = state.mission.glide is None or not state.phase.is_airborne
        if is_off or (self._performance.has_thrust and self._stage is not Stage.FINAL):
            self._release()
            return False
        if ownship is None:
            return False
        if self._options is None:
            self._options = state.rules.glide_options(state.home_enu_m, state.rally_points)
        if self._options is not None:
            self._look_from(self._options, state, ownship)
        current, stored = self._handover.reader.current, state.mission_list.stored
        item = None if current is None else current.sequence
        lands = item is not None and item < len(stored) and stored[item].command == Command.NAV_LAND
        return self.is_commanded and not lands

    def _look_from(self, options: GlideOptions, state: FlightState, ownship: Ownship) -> None:
        """Choose a place from where the aircraft is; on a near final, the place is not changed."""
        if self._stage is not Stage.NONE and state.mode in (Mode.SUSPENDED, Mode.YIELDED):
            self._stage, self._is_bound = Stage.CHOSEN, False  # After a handback the glide begins anew.
        if self._stage is Stage.FINAL and self._choice is not None and is_near(self._choice):
            self._is_bound = True
        self._choose(options, state, ownship)

    def _choose(self, options: GlideOptions, state: FlightState, ownship: Ownship) -> None:
        """Keep the chosen place while it is within reach, else choose another.

        The glide to another place begins when its mission is entered, at the earliest a moment from now.
        """
        before, is_flown = self._choice, self._stage in (Stage.FLOWN, Stage.FINAL)
        earliest = begin_of(options, ownship, EARLIEST_S)
        entry = begin_of(options, ownship, LEAD_S)._replace(earliest=earliest)
        begin = begin_of(options, ownship) if is_flown else entry
        kept = None if before is None else from_now(options, begin, before)
        if not self._is_bound:
            is_final = self._stage is Stage.FINAL
            kept = self._unless_hasty(best_place(options, entry, kept, on_final=is_final), kept)
        self._take(kept, options, ownship)
        if self.is_commanded and state.mode is Mode.ACTIVE:
            self._handover.reserve(is_reserved=True)
            self._performance.note_glide(is_gliding=True)

    def _unless_hasty(self, found: LandingChoice | None, kept: LandingChoice | None) -> LandingChoice | None:
        """Return another place only if it was found several times in a row: a turn is not flown exactly."""
        is_other = self._stage is not Stage.NONE and _place(found) != _place(kept)
        self._num_others = self._num_others + 1 if is_other else 0
        return kept if 0 < self._num_others < OTHERS_MIN else found

    def _take(self, choice: LandingChoice | None, options: GlideOptions, ownship: Ownship) -> None:
        """Take a choice; inform the pilot of another place, and hand another circle over."""
        before, self._choice = self._choice, choice
        is_other = self._stage is Stage.NONE or _place(choice) != _place(before)
        if is_other or _circle(choice) != _circle(before):
            self._stage = Stage.CHOSEN
        if is_other:
            self._announce(choice, options, ownship)

    def _announce(self, choice: LandingChoice | None, options: GlideOptions, ownship: Ownship) -> None:
        """Inform the pilot of the place."""
        if choice is not None and choice.place in options.places:
            away, spare = f"{1e-3 * choice.away_m:.1f}", f"{choice.spare_m:.0f}"
            text = f"glide to {choice.place.name}, {away} km, {spare} m spare"
            why = {"field": choice.place.name, "away_m": choice.away_m, "spare_m": choice.spare_m}
            self._announcer.decide(
                DecisionKind.ENGINE, text, why=why, tell="glide", field=choice.place.name, away=away,
                spare=spare,
            )  # fmt: skip
            return
        east, north, up = ownship.position_enu_m
        height = up - options.ground_up_m(east, north)
        where = f"{height:.0f} m high"
        if choice is not None:
            where = f"open ground {1e-3 * choice.away_m:.1f} km away"
        self._announcer.decide(
            DecisionKind.ENGINE, f"no field within glide, {where}", tell="no field", where=where
        )

    def _release(self) -> None:
        """Leave the aircraft to the planner again."""
        if self._stage is Stage.NONE:
            return
        self._stage, self._choice, self._options, self._is_bound = Stage.NONE, None, None, False
        self._handover.reserve(is_reserved=False)
        self._performance.note_glide(is_gliding=False)

    async def carry_out(self) -> None:
        """Hand the mission to the chosen place over, or begin the final, if that is due."""
        state, choice, options = self._flight.state, self._choice, self._options
        ownship = self._world_model.ownship.state(self._clock.now_s())
        if choice is None or options is None or ownship is None or not self._may_command(state):
            return
        entry = begin_of(options, ownship, TURN_BEGINS_S)
        if self._stage is Stage.CHOSEN:
            await self._hand_over(state, choice, ownship)
        elif self._stage is Stage.FLOWN and final_is_due(options, choice, entry):
            await self._make_current(choice, LAND_ITEM, Stage.FINAL)
        elif self._stage is Stage.FINAL:
            await self._correct_final(options, choice)

    def _may_command(self, state: FlightState) -> bool:
        """Return whether the aircraft is left to the service, and the next command is due."""
        return state.mode is Mode.ACTIVE and self.is_commanded and self._clock.now_s() >= self._next_s

    async def _correct_final(self, options: GlideOptions, choice: LandingChoice) -> None:
        """Send an aircraft that is too high back to the circle, and one that is past the field to it."""
        now = self._clock.now_s()
        if circle_is_due(options, choice):
            await self._make_current(choice, CIRCLE_ITEM, Stage.FLOWN)
        elif is_past(choice) and now >= self._turned_s + BACK_S:
            self._turned_s = now
            await self._make_current(choice, LAND_ITEM, Stage.FINAL)

    async def _hand_over(self, state: FlightState, choice: LandingChoice, ownship: Ownship) -> None:
        """Hand over the mission to the chosen place."""
        self._next_s = self._clock.now_s() + AGAIN_S
        if not self._handover.is_settled():
            return
        is_known, _ = await self._handover.reader.knows_mission()
        if not is_known:
            return
        waypoints, now = glide_waypoints(choice), self._clock.now_s()
        path = glide_path(choice, now, state.wind_enu_m_s)
        constructed = ConstructedMission(
            path, waypoints, glide_part(waypoints, state.mission.frame), float(path.times_s[-1]),
            start_by_motion(state.rules, ownship, LEAD_S), Verdict.EMERGENCY, f"glide to {choice.place.name}",
            {}, math.inf, ENTRY_ITEM,
        )  # fmt: skip
        is_flown, reason = await self._handover.glide(constructed)
        kind = DecisionKind.SWAP if is_flown else DecisionKind.REJECTED
        self._announcer.decide(kind, f"glide to {choice.place.name}: {reason}")
        # Another place or circle may have been chosen during the exchange; that is still to be handed over.
        if is_flown and (_place(self._choice), _circle(self._choice)) == (choice.place, choice.approach):
            self._stage = Stage.FLOWN

    async def _make_current(self, choice: LandingChoice, item: int, stage: Stage) -> None:
        """Send the aircraft to the landing, or back to the circle."""
        name, error = choice.place.name, await self._handover.fly_item(item)
        if error:
            self._announcer.decide(DecisionKind.REJECTED, f"item {item} of the glide to {name}: {error}")
            self._next_s = self._clock.now_s() + AGAIN_S
            return
        self._stage, self._is_bound = stage, self._is_bound or is_near(choice)
        words = "final" if stage is Stage.FINAL else "too high, circle before the final"
        text = f"{words} to {name}, {choice.away_m:.0f} m away, {choice.spare_m:.0f} m spare"
        tell = "final" if stage is Stage.FINAL else ""
        self._announcer.decide(DecisionKind.ENGINE, text, tell=tell, field=name)


def _place(choice: LandingChoice | None) -> object:
    """Return the place of a choice; None without one."""
    return None if choice is None else choice.place


def _circle(choice: LandingChoice | None) -> object:
    """Return the circle of a choice; None without one."""
    return None if choice is None else choice.approach
