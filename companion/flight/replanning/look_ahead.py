"""Plan for the moment at which the aircraft is left to the service: the takeover, or a handback."""

from __future__ import annotations

from companion.flight.construction.cycle import conclude
from companion.flight.construction.mission_construction import ConstructedMission
from companion.flight.prediction.resume_path import resume_path
from companion.flight.replanning.plan_maker import plan_request
from companion.flight.replanning.plan_schedule import known_threats, wind_fault
from companion.flight.replanning.replanning_parts import ReplanningParts
from companion.flight.state.decision import DecisionKind
from companion.flight.state.flight_state import FlightState
from companion.flight.state.modes import Mode
from companion.flight.state.progress import Start, lead_s, start_by_motion
from companion.flight.takeover.start_prediction import start_at_takeover
from companion.mission.swap import SwapOutcome
from companion.types.plan import PlanStatus

EARLY_S, LATE_S = 8.0, 3.0  # A plan made ahead is used at most this long before and after its start.


class LookAhead:
    """Makes plans before they can be flown, and keeps one ready.

    Parameters
    ----------
    parts : ReplanningParts
        The parts of replanning.
    """

    def __init__(self, parts: ReplanningParts) -> None:
        self._parts = parts
        self._prepared: tuple[ConstructedMission, FlightState] | None = None
        self._announced: DecisionKind | None = None
        self._is_ready = False

    def forget(self) -> None:
        """Forget the plan made ahead."""
        self._prepared, self._announced, self._is_ready = None, None, False

    def take_prepared(self) -> ConstructedMission | None:
        """Return the plan made ahead, if the aircraft is about at its start, with its settings and goals."""
        kept, state = self._prepared, self._parts.flight.state
        self.forget()
        if kept is None or (kept[1].settings, kept[1].goals) != (state.settings, state.goals):
            return None
        prepared = kept[0]
        since_s = self._parts.clock.now_s() - prepared.start.state.stamp_s
        return prepared if -EARLY_S <= since_s <= LATE_S else None

    async def plan(self) -> None:
        """Make a plan; store it in the autopilot if the pilot flies and the mission file allows it."""
        parts = self._parts
        maker, handover = parts.maker, parts.handover
        maker.schedule.begin(parts.clock.now_s())
        if self._keeps_ready():
            return
        await parts.geofences.catch_up()
        await maker.until_begun()
        now, state = parts.clock.now_s(), parts.flight.state
        start, ownship = self._start(now), parts.world_model.ownship.state(now)
        if start is None or ownship is None or not state.goals_left:
            return
        snapshot, track_s = parts.world_model.snapshot(now), parts.world_model.newest_track_s
        state = parts.flight.update_world(ownship, snapshot.picture)
        if wind_fault(state):
            return
        maker.schedule.note_known(known_threats(parts.world_model, now))
        run, found = await maker.make(
            plan_request(state, start, snapshot), lambda plan: conclude(state, plan, start, snapshot)
        )
        made_with, state = state, parts.flight.state
        if found.constructed is None:
            self._prepared = None
            # In the climb the aircraft is below the bounds.
            if run.plan.status is not PlanStatus.INVALID_START:
                self._announce(DecisionKind.NO_PLAN, f"ahead: {found.decision.text}")
        elif state.mode is Mode.SUSPENDED and state.may_write and handover.is_settled():
            occasion = maker.schedule.occasion
            outcome = await handover.hand_over(
                found.constructed, maker.num_plans, run.plan_ms, track_s, occasion
            )
            self._is_ready = outcome is SwapOutcome.FLOWN
        else:
            self._prepared = found.constructed, made_with
            count = len(found.constructed.waypoints.positions_enu_m)
            self._announce(DecisionKind.READY, f"first plan, {count} waypoints", tell="path ready")

    def _keeps_ready(self) -> bool:
        """Return whether the mission that was stored for the handback is still safe to resume."""
        parts, state = self._parts, self._parts.flight.state
        ownship = parts.world_model.ownship.state(parts.clock.now_s())
        if not self._is_ready or state.mode is not Mode.SUSPENDED or ownship is None:
            return False
        return resume_path(state, parts.handover.reader.current, ownship).is_safe

    def _start(self, now: float) -> Start | None:
        """Return the start of a plan made ahead; None if a plan would be of no use."""
        parts, state = self._parts, self._parts.flight.state
        ownship, current = parts.world_model.ownship.state(now), parts.handover.reader.current
        if ownship is None or not state.phase.is_airborne:
            return None
        if state.mode is Mode.DEPARTING:
            return None if current is None else start_at_takeover(state, current, ownship)
        return start_by_motion(state.rules, ownship, lead_s(state))

    def _announce(self, kind: DecisionKind, text: str, tell: str = "") -> None:
        """Announce the result of planning ahead, once until it changes."""
        if kind is not self._announced:
            self._announced = kind
            self._parts.announcer.decide(kind, text, tell=tell)
