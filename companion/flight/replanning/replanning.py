"""Make plans when they are due, judge them, and swap missions or carry out the emergency strategy."""

from __future__ import annotations

import math
from collections.abc import Coroutine
from dataclasses import replace
from functools import partial

from companion.assurance.emergency import EmergencyStep
from companion.flight.construction.cycle import (
    RALLY_POINTS_TRIED,
    EmergencyConclusion,
    conclude_either,
    conclude_emergency,
    conclude_rally,
    ends_within,
    flown_passes,
    is_over,
    rally_points_near,
)
from companion.flight.construction.mission_construction import ConstructedMission
from companion.flight.monitors.energy_watch import EnergyWatch
from companion.flight.prediction.return_path import return_path
from companion.flight.replanning.look_ahead import LookAhead
from companion.flight.replanning.plan_maker import (
    PASSAGE,
    PlanBrokenOffError,
    PlanRequest,
    PlanRun,
    least_threat_request,
    plan_request,
    rally_request,
)
from companion.flight.replanning.plan_schedule import (
    BEGIN,
    ENDS_S,
    RETRY_S,
    SUSPICION_S,
    known_threats,
    wind_fault,
)
from companion.flight.replanning.replanning_parts import ReplanningParts
from companion.flight.replanning.surprise_watch import SurpriseWatch
from companion.flight.state.decision import DecisionKind, Verdict
from companion.flight.state.modes import ModeEvent
from companion.flight.takeover.start_prediction import begin, begin_now
from companion.mission.swap import SwapOutcome
from companion.world.snapshot import Snapshot

# The steps after which a plan to a rally point is tried first.
LAST_RESORTS = frozenset({EmergencyStep.RETURN_TO_LAUNCH, EmergencyStep.LEAVE_TO_AUTOPILOT})
STEP_WORDS = {  # Words in the pilot's text about each step.
    EmergencyStep.KEEP_FLOWN: "flying on",
    EmergencyStep.LEAST_THREAT: "no better path",
    EmergencyStep.LOITER: "circling at a safe place",
    EmergencyStep.RALLY_POINT: "flying to a rally point",
    EmergencyStep.RETURN_TO_LAUNCH: "returning to launch",
}
RETURN_BLOCKED = "the way home does not keep clear any more"  # Recorded if return to launch became unsafe.
BARRED_S = 15.0  # Time without a mission to the goal after which others are requested to move, and again.
# After this many failed swaps in a row the pilot is informed that the flown path is kept.
FAILED_SWAPS_MAX = 3


class Replanning:
    """Plans every time horizon, earlier on news, and most often while no safe path is flown.

    Parameters
    ----------
    parts : ReplanningParts
        The parts of replanning.

    Attributes
    ----------
    emergency : EmergencyStep or None
        The emergency step that was announced last; None once a plan is flown again.
    handover : Handover
        Hands missions over to the autopilot.
    geofences : Geofences
        Reads the fences.
    team : Team
        Asks the other members of a team.
    look_ahead : LookAhead
        Plans for the moment at which the aircraft is left to the service.
    freshness : FreshnessWatch
        Detects stale inputs; without the vital ones nothing is planned or handed over.
    performance : PerformanceWatch
        Notices when the aircraft does not do what its plan says.
    energy : EnergyWatch
        Knows what is left on board and what the way home costs.
    """

    def __init__(self, parts: ReplanningParts) -> None:
        self.emergency: EmergencyStep | None = None
        self._flight, self._world_model, self._clock = parts.flight, parts.world_model, parts.clock
        self._maker, self._schedule = parts.maker, parts.maker.schedule
        self._announcer = parts.announcer
        self.handover, self.geofences = parts.handover, parts.geofences
        self.team = parts.handover.protocols.team
        self._rally_points = parts.rally_points
        self._num_failed_swaps, self._led_to_goal_s = 0, -math.inf
        self.look_ahead = LookAhead(parts)
        self.freshness, self.performance = parts.freshness, parts.performance
        self.energy = EnergyWatch(parts.flight, parts.world_model, parts.handover.reader, parts.announcer)
        self._surprises = SurpriseWatch(parts.flight, parts.world_model, parts.handover.reader)

    @property
    def num_plans(self) -> int:
        """Number of plans that were begun."""
        return self._maker.num_plans

    def plan_at_once(self, why: str = BEGIN) -> None:
        """Plan at once, whatever has been flown since the last plan."""
        self._schedule.plan_at_once(why)

    def break_off(self) -> None:
        """Cancel an exchange that is under way, and forget the plan made ahead."""
        self.look_ahead.forget()
        self.handover.break_off()

    def next_look_s(self) -> float:
        """Return when to check next whether a plan is due, by the clock [s]."""
        return self._maker.next_look_s()

    def is_in_trouble(self) -> bool:
        """Return whether the planner cannot work now: it lacks vital inputs, or is stalled."""
        return self.freshness.is_blind or self._maker.is_stalled(self._clock.now_s())

    def is_due(self) -> bool:
        """Return whether a plan is due."""
        state, now = self._flight.state, self._clock.now_s()
        surprise = self._surprises.look(now)
        return self._schedule.is_due(
            now,
            state.rules.time_horizon_s,
            known_threats(self._world_model, now),
            state.mission_list.suspected,
            flies_to_goal=state.flies_to_goal and state.may_act and not self._surprises.is_failing,
            surprise=surprise,
            ends_soon=ends_within(state, ENDS_S),
        )

    def look_for_surprise(self) -> None:
        """Break off a plan, or give up a waiting mission, if the flown path has become worse."""
        is_planned, is_waiting = self._maker.may_break_off, self.handover.may_give_up
        surprise = self._surprises.look(self._clock.now_s()) if is_planned or is_waiting else ""
        if surprise and is_planned:
            self._maker.break_off(surprise)
        elif surprise:
            self.handover.give_up(surprise)

    async def plan(self) -> ModeEvent | None:
        """Plan once, and once more if a surprise breaks the plan off.

        Returns
        -------
        ModeEvent or None
            An event that was discovered and changes the mode.
        """
        try:
            return await self.plan_once()
        except PlanBrokenOffError as surprise:
            self._schedule.plan_urgently(str(surprise))
            return await self.plan_once()

    async def unless_surprised(self, work: Coroutine[object, object, None]) -> bool:
        """Wait for work that may make a plan; return whether a surprise broke it off: a plan is due."""
        try:
            await work
        except PlanBrokenOffError as surprise:
            self._schedule.plan_urgently(str(surprise))
            return True
        return False

    async def plan_once(self) -> ModeEvent | None:
        """Carry out one cycle: plan, judge, and swap if it is worthwhile; returns the same as :meth:`plan`.

        Raises
        ------
        PlanBrokenOffError
            If a surprise made the plan useless. A plan that answers a surprise is not broken off.
        """
        now = self._clock.now_s()
        self._schedule.begin(now)
        if self.freshness.is_blind:
            return None  # Planning resumes when the missing inputs are back.
        if self._is_too_windy(now):
            return None
        if not self.handover.is_settled():
            self._schedule.retry(now + SUSPICION_S, "it was not known what is flown")
            return None
        is_known, event = await self.handover.reader.knows_mission()
        if not is_known:
            return event
        if await self._hand_over_prepared():
            return None
        await self.geofences.catch_up()
        await self._rally_points.renew()
        await self._maker.until_begun()
        now, state = self._clock.now_s(), self._flight.state
        ownship = self._world_model.ownship.state(now)
        if ownship is None or not state.may_act or not state.goals_left:
            return None
        snapshot = self._world_model.snapshot(now)
        state = self._flight.update_world(ownship, snapshot.picture)
        self._schedule.note_known(known_threats(self._world_model, now))
        self._surprises.note_known(snapshot.picture.tracks, is_answer=self._schedule.is_urgent)
        track_s = self._world_model.newest_track_s
        if not is_over(state, ownship):
            is_urgent = self._is_urgent(snapshot)
            current = self.handover.reader.current
            start = begin_now(state, ownship, current, snapshot, is_urgent=is_urgent)
            request = plan_request(state, start, snapshot, is_urgent=is_urgent)
            self._surprises.note_judgement(start.rest, is_failing=request.is_failing)
            await self._plan(request, track_s)
            await self._request_passage(request)
        return None

    def _is_urgent(self, snapshot: Snapshot) -> bool:
        """Return whether the plan is to be flown as soon as possible.

        With a pursuer known, following the operator's mission any longer loses time. That holds for the first
        plan only: if an urgent plan found nothing, the next one takes more time.
        """
        is_first = self._flight.state.flown is None and self.emergency is None
        return self._schedule.is_urgent or (snapshot.is_pursued and is_first)

    def _is_too_windy(self, now_s: float) -> bool:
        """Return whether the wind is too strong for planning; announce that, and schedule a retry."""
        fault = wind_fault(self._flight.state)
        if not fault:
            return False
        wind = f"{math.hypot(*self._flight.state.wind_enu_m_s):.0f}"
        self._announce(EmergencyStep.KEEP_FLOWN, fault, DecisionKind.EMERGENCY, tell="wind", word=wind)
        self._schedule.retry(now_s + RETRY_S, "the wind was too strong")
        return True

    async def _hand_over_prepared(self) -> bool:
        """Hand over the plan that was made ahead, if the aircraft is at its start.

        Returns whether the cycle is complete: the plan is flown, or the list was changed by another station.
        """
        prepared = self.look_ahead.take_prepared()
        if prepared is None or not self._flight.state.may_act:
            return False
        left = self.energy.left_after(prepared.path, self._clock.now_s())
        prepared = replace(prepared, why={**prepared.why, **left})
        outcome = await self._hand_over(prepared, 0.0, self._world_model.newest_track_s)
        return outcome in (SwapOutcome.FLOWN, SwapOutcome.FOREIGN)

    async def _plan(self, request: PlanRequest, track_s: float) -> None:
        """Make a plan, and carry out its conclusion."""
        state, least_gain = self._flight.state, self._least_gain(is_urgent=self._schedule.is_urgent)
        run, (found, least_threat) = await self._maker.make(
            request,
            lambda plan: conclude_either(state, plan, request.start, request.snapshot, least_gain=least_gain),
            may_break_off=not request.is_urgent,
        )
        if self._is_outdated(request):
            return
        if found.is_waiting or found.constructed is not None:
            self.team.note_waiting(is_waiting=found.is_waiting)
        planned = run.plan.path if run.plan.reaches_goal else None
        found = self.energy.annotated(found, planned, self._clock.now_s())
        if found.constructed is not None:
            await self._hand_over(found.constructed, run.plan_ms, track_s, is_urgent=request.is_urgent)
            return
        if found.is_unflyable:
            self._announcer.count_rejected()
        decision = found.decision
        facts = {"occasion": self._schedule.occasion, **decision.why}
        self._announcer.decide(decision.verdict.kind, decision.text, run.plan_ms, why=facts)
        if least_threat is not None and least_threat.step is EmergencyStep.LEAST_THREAT:
            is_urgent = request.is_urgent or request.start.rest is not None
            await self._take(run, least_threat, track_s, is_urgent=is_urgent)
        elif decision.verdict.is_emergency:
            await self._respond(run, request, track_s)
        else:
            self.emergency = None

    async def _request_passage(self, request: PlanRequest) -> None:
        """Request that others move, if nothing leads to the goal and only their circles bar the way there."""
        circling, now = self.team.circling(), self._clock.now_s()
        if math.isinf(self._led_to_goal_s) or not circling or self._leads_to_goal():
            self._led_to_goal_s = now
        is_early = now - self._led_to_goal_s < BARRED_S
        if is_early or request.is_urgent or not self._flight.state.goals_left:
            return
        self._led_to_goal_s = now
        snapshot = request.snapshot
        others = [track for track in snapshot.tracks if track.identity not in circling]
        without = snapshot.with_tracks(snapshot.stamp_s, others)
        run, path = await self._maker.make(
            replace(request, purpose=PASSAGE, snapshot=without), lambda plan: plan.path
        )
        if path is not None and run.plan.reaches_goal and not self._is_outdated(request):
            self.team.request(path)

    def _leads_to_goal(self) -> bool:
        """Return whether the flown mission goes on towards the goal, and nobody circles in its way there."""
        state, flown = self._flight.state, self._flight.state.flown
        if flown is None or not state.flies_to_goal or ends_within(state, 0.0):
            return False
        return not self.team.barring(flown.path.since(flown.row))

    def _least_gain(self, *, is_urgent: bool) -> float:
        """Return the share by which a path has to cost less than the flown one if neither passes."""
        return 0.0 if is_urgent else float(self._flight.state.mission.planning.swap_gain)

    def _is_outdated(self, request: PlanRequest) -> bool:
        """Return whether a plan is of no use any more; if the rules have changed, schedule another."""
        state = self._flight.state
        if not state.may_act:
            return True
        if state.rules is not request.rules:
            self._schedule.plan_at_once("the rules changed meanwhile")
        return state.rules is not request.rules

    async def _respond(self, failed: PlanRun, request: PlanRequest, track_s: float) -> None:
        """Carry out and announce the first possible emergency step, because no plan passes.

        It is urgent if a path of the service is flown, because that path does not pass. No step is needed if
        the last goal was reached meanwhile, or another member of the team flies there.
        """
        now = self._clock.now_s()
        ownship = self._world_model.ownship.state(now)
        if ownship is None or not self._flight.state.goals_left:
            return
        is_surprised = self._schedule.is_urgent or bool(self._surprises.look(now, at_once=True))
        least_gain = self._least_gain(is_urgent=is_surprised)
        snapshot = self._world_model.snapshot(now)
        state = self._flight.update_world(ownship, snapshot.picture)
        self._surprises.note_known(snapshot.picture.tracks, is_answer=is_surprised)
        is_urgent = request.is_urgent or request.start.rest is not None
        start = begin_now(state, ownship, self.handover.reader.current, snapshot, is_urgent=is_urgent)
        if flown_passes(state, start):
            self._schedule.retry(now + RETRY_S, "no plan passed")
            self._announce(EmergencyStep.KEEP_FLOWN, "it still passes", DecisionKind.KEEP)
            return
        home = (
            return_path(state, ownship, self.handover.reader.current)
            if state.mission.authority.allow_rtl
            else None
        )
        run, found = await self._maker.make(
            least_threat_request(state, start, snapshot, is_urgent=is_urgent),
            lambda plan: conclude_emergency(
                state, plan, failed.plan.path, start, home, least_gain=least_gain
            ),
        )
        if found.step in LAST_RESORTS and state.rally_points:
            run, found = await self._by_rally_point(run, found, snapshot)
        if not self._is_outdated(request):
            await self._take(run, found, track_s, is_urgent=is_urgent)

    async def _take(
        self, run: PlanRun, found: EmergencyConclusion, track_s: float, *, is_urgent: bool
    ) -> None:
        """Carry out and announce an emergency step."""
        if found.step is EmergencyStep.RETURN_TO_LAUNCH and not self._is_return_clear():
            found = replace(found, step=EmergencyStep.LEAVE_TO_AUTOPILOT, reason=RETURN_BLOCKED)
        is_path = found.step is EmergencyStep.LEAST_THREAT and found.constructed is not None
        tell, step = "take over", STEP_WORDS.get(found.step, "")
        if step:
            tell = "" if is_path else "unsafe"  # A path is announced once it is flown.
        self._announce(found.step, found.reason, DecisionKind.EMERGENCY, tell=tell, word=step)
        if found.constructed is not None:
            await self._hand_over(found.constructed, run.plan_ms, track_s, is_urgent=is_urgent)
        elif found.step is EmergencyStep.RETURN_TO_LAUNCH:
            await self.handover.return_to_launch()

    async def _by_rally_point(
        self, run: PlanRun, found: EmergencyConclusion, snapshot: Snapshot
    ) -> tuple[PlanRun, EmergencyConclusion]:
        """Plan to the nearest rally points, one after the other, until one can be reached."""
        for number in range(RALLY_POINTS_TRIED):
            state = self._flight.state
            ownship = self._world_model.ownship.state(self._clock.now_s())
            if ownship is None or not state.may_act:
                break
            start = begin(state, ownship, self.handover.reader.current)
            places = rally_points_near(state, start.state.position_enu_m)
            if number >= len(places):
                break
            conclude_it = partial(conclude_rally, state, found, place=places[number], start=start)
            run, found = await self._maker.make(
                rally_request(state, start, snapshot, places[number]), conclude_it
            )
            if found.constructed is not None:
                break
        return run, found

    def _is_return_clear(self) -> bool:
        """Return whether the return path is still clear from the aircraft's present position."""
        ownship = self._world_model.ownship.state(self._clock.now_s())
        current = self.handover.reader.current
        return ownship is not None and return_path(self._flight.state, ownship, current) == ()

    def _announce(
        self, step: EmergencyStep, reason: str, kind: DecisionKind, tell: str = "", word: str = ""
    ) -> None:
        """Announce an emergency step, once until another is taken."""
        if step is not self.emergency:
            self.emergency = step
            self._announcer.decide(kind, f"{step.value}: {reason}", tell=tell, word=word)

    async def _hand_over(
        self, constructed: ConstructedMission, plan_ms: float, track_s: float, *, is_urgent: bool = False
    ) -> SwapOutcome:
        """Hand a mission over, and note the result."""
        if self.freshness.is_blind:
            return SwapOutcome.REFUSED
        outcome = await self.handover.hand_over(
            constructed, self._maker.num_plans, plan_ms, track_s, self._schedule.occasion,
            is_urgent=is_urgent,
        )  # fmt: skip
        if outcome is SwapOutcome.FLOWN:
            self._surprises.note_judgement(constructed.path, is_failing=not self._announcer.news.passes)
            self._num_failed_swaps = 0
            if constructed.verdict is not Verdict.EMERGENCY:
                self.emergency = None
            return outcome
        self._note_failed_swap(constructed)
        self._schedule.retry(self._clock.now_s() + RETRY_S, "the last mission was not entered")
        return outcome

    def _note_failed_swap(self, constructed: ConstructedMission) -> None:
        """Announce that the aircraft keeps its mission, after several failed swaps."""
        state = self._flight.state
        self._num_failed_swaps += 1
        if self._num_failed_swaps != FAILED_SWAPS_MAX or not state.may_act:
            return
        passes = flown_passes(state, constructed.start)
        reason = "it still passes" if passes else "nothing else reaches the autopilot"
        self._announce(
            EmergencyStep.KEEP_FLOWN,
            f"{reason}; {self._num_failed_swaps} swaps failed",
            DecisionKind.KEEP if passes else DecisionKind.EMERGENCY,
            tell="refused",
            word="safe" if passes else "NOT safe",
        )
