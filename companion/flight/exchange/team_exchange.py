"""The service's part in a team: what it proposes before a mission is entered, and where the others will be.

A mission is proposed when it is handed over, and stored in the autopilot while the others answer. It is
entered once everybody has approved it (:class:`Consent`). Until the autopilot flies it, the others keep clear
of both the flown and the proposed path.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from companion.clock import Clock
from companion.flight.construction.mission_construction import ConstructedMission
from companion.flight.exchange.announced_plan import (
    AnnouncedPlan,
    announced_rows,
    can_wait,
    proposed_plan,
    returns_near,
)
from companion.flight.exchange.circle_aside import (
    CircleAside,
    circles_of,
    listed,
    members_barring,
    wanted_plan,
)
from companion.flight.messages.announcer import Announcer
from companion.flight.messages.vehicle_link import VehicleLink
from companion.flight.state.decision import DecisionKind
from companion.flight.state.flight_state import StateOwner
from companion.flight.state.team_part import is_available, new_agreement, reached_goals, take_goals
from companion.mission.team.agreement import Agreement, Outcome
from companion.mission.team.member_tracks import (
    IDENTITY,
    PlansNear,
    member_named,
    members_among,
    track_of_plan,
)
from companion.tracking.ownship import OwnshipEstimator
from companion.types.events import ClockReported, TeamMessage
from companion.types.path import Path
from companion.types.threat import TrackState

DRIFT = 1e-4  # Two clocks drift apart by at most this share of the time.
NO_PLAN: dict[str, object] = {"plan_enu_m": [], "circle_m": 0.0}  # A member's document without its plan.
PLANNED_SLACK_M = 25.0  # Announced plans have tolerances of up to 10 m more, and plans keep clear of those.


@dataclass(slots=True)
class UtcClock:
    """UTC, by what the autopilot reports of it. A report arrives late, never early: the earliest one counts.

    Parameters
    ----------
    ahead_s : float or None
        UTC less the service's clock [s]; None before the first report.
    reported_s : float
        Time of the last report, by the service's clock [s].
    """

    ahead_s: float | None = None
    reported_s: float = 0.0

    def note(self, event: ClockReported) -> None:
        """Take a report."""
        ahead_s = event.unix_s - event.stamp_s
        if self.ahead_s is not None:
            drifted_s = self.ahead_s - DRIFT * (event.stamp_s - self.reported_s)
            ahead_s = max(ahead_s, drifted_s)
        self.ahead_s, self.reported_s = ahead_s, event.stamp_s


class TeamExchange:
    """Proposals to the team and its answers.

    Parameters
    ----------
    flight : StateOwner
        The flight's state, with the mission file.
    ownship : OwnshipEstimator
        The estimate of the aircraft.
    link : VehicleLink
        Sends the team's messages.
    clock : Clock
        The service's clock.
    announcer : Announcer
        Informs the pilot of members that are lost.
    """

    def __init__(
        self, flight: StateOwner, ownship: OwnshipEstimator, link: VehicleLink, clock: Clock,
        announcer: Announcer,
    ) -> None:  # fmt: skip
        self._flight, self._ownship, self._link, self._clock = flight, ownship, link, clock
        self._announcer = announcer
        self._utc = UtcClock()
        self._agreement: Agreement | None = None
        self._announced = AnnouncedPlan()
        self._is_asking = self._is_waiting = False
        self._lost = frozenset[int]()
        self._returns_near = frozenset[int]()
        self._aside = CircleAside(flight, link, announcer)
        # When each member was sighted last [s], and where [m].
        self._sightings: dict[int, tuple[float, tuple[float, float, float]]] = {}
        self._near = PlansNear()

    @property
    def agreement(self) -> Agreement | None:
        """The member's part in the agreement; None without a team, or before system id and UTC are known."""
        system_id, utc_s = self._link.codec.vehicle_system_id, self._utc_s()
        if self._agreement is None and system_id is not None and utc_s is not None:
            self._agreement = new_agreement(self._flight.state, system_id, utc_s)
        return self._agreement

    def _utc_s(self) -> float | None:
        ahead_s = self._utc.ahead_s
        return None if ahead_s is None else self._clock.now_s() + ahead_s

    def take(self, event: ClockReported | TeamMessage) -> None:
        """Take a report of the time, or another member's message."""
        if isinstance(event, ClockReported):
            self._utc.note(event)
        elif self.agreement is not None and self._utc.ahead_s is not None:
            self.agreement.receive(event.system_id, event.payload, event.stamp_s + self._utc.ahead_s)

    def keep_up(self) -> bool:
        """Send what is due, and inform the pilot of members that are lost or received again.

        Returns
        -------
        bool
            Whether this member flies other goals from now on.
        """
        agreement, utc_s = self.agreement, self._utc_s()
        if agreement is None or utc_s is None:
            return False
        self._announce(agreement, utc_s)
        self._compare_returns(agreement)
        lost = agreement.members_lost(utc_s)
        has_other_goals = self._share_goals(agreement, utc_s, lost) or self._aside.look(agreement, utc_s)
        for payload in agreement.outgoing(utc_s):
            self._link.send(self._link.codec.team_message(payload))
        for member in sorted(lost ^ self._lost):
            is_lost = member in lost
            text = f"system {member} is {'lost' if is_lost else 'received'}"
            self._announcer.decide(
                DecisionKind.TEAM, text, tell="team lost" if is_lost else "team again", about=str(member),
                member=member,
            )  # fmt: skip
        self._lost = lost
        return has_other_goals

    def _share_goals(self, agreement: Agreement, utc_s: float, lost: frozenset[int]) -> bool:
        """Take part in the auction of goals; return whether this member flies other goals from now on.

        The plan of a lost member ends in a circle about a goal. Nobody else could fly there as long as that
        is kept clear of. It is forgotten once the member's position was not received for as long either.
        """
        auction, state, config = agreement.auction, self._flight.state, self._flight.state.mission.team
        ownship = self._ownship.state(self._clock.now_s())
        if auction is None or config is None or ownship is None:
            return False
        for member in lost:
            seen = self._sightings.get(member)
            if seen is None or self._clock.now_s() - seen[0] >= config.lost_after_s:
                agreement.forget(member)
        east_m, north_m, _ = ownship.position_enu_m
        won = auction.look(
            utc_s, (east_m, north_m), frozenset(config.members) - lost,
            reached=reached_goals(state), is_available=is_available(state),
        )  # fmt: skip
        if not take_goals(self._flight, won, is_over=auction.is_over):
            return False
        words = ", ".join(str(number + 1) for number in won) or "none"
        self._announcer.decide(DecisionKind.TEAM, f"goals: {words}")
        return True

    def _announce(self, agreement: Agreement, utc_s: float, *, anew: bool = False) -> None:
        """Announce what is flown if that is nothing that the others know, or ``anew`` in any case."""
        state, now_s = self._flight.state, self._clock.now_s()
        ownship, config = self._ownship.state(now_s), state.mission.team
        if ownship is None or config is None:
            return
        if anew or self._announced.is_due(agreement, ownship, utc_s):
            rows = announced_rows(state, ownship, self._link.autopilot.current)
            agreement.announce(self._announced.plan(rows, config, utc_s - now_s))

    def _compare_returns(self, agreement: Agreement) -> None:
        """Inform the pilot of members that return to launch at nearly the same altitude."""
        state, ownship = self._flight.state, self._ownship.state(self._clock.now_s())
        config = state.mission.team
        if config is None or ownship is None:
            return
        near = returns_near(state, ownship, agreement, config)
        if near - self._returns_near:
            fault = f"RTL height near system {listed(near)}'s: {config.paths_apart_up_m:.0f} m needed"
            self._announcer.decide(DecisionKind.TEAM, fault, tell="check", about="return height", fault=fault)
        self._returns_near = near

    # --- proposals

    def propose(self, constructed: ConstructedMission) -> str:
        """Propose what is flown if a mission is entered; return whom that conflicts with, '' for nobody.

        It is announced instead if what is flown now meets an obstacle before the others could approve.

        Parameters
        ----------
        constructed : ConstructedMission
            The mission that is to be entered.
        """
        agreement, ahead_s = self.agreement, self._utc.ahead_s
        ownship = self._ownship.state(self._clock.now_s())
        self._is_asking = False
        if agreement is None or ahead_s is None or ownship is None:
            return ""
        state, current = self._flight.state, self._link.autopilot.current
        plan = proposed_plan(state, constructed, ownship, current, ahead_s)
        if not can_wait(state, ownship, current):
            agreement.announce(plan)
            return ""
        self._is_asking = True
        # The autopilot's direction may have become known since. It cannot be announced during a proposal.
        self._announce(agreement, plan.start_s, anew=state.flown is None)
        if agreement.propose(plan, plan.start_s, constructed.start.state.stamp_s + ahead_s) is None:
            return f"the path of system {listed(agreement.refused_by)}"
        return ""

    def circling(self) -> frozenset[str]:
        """Return the identities of members that circle at the end of their plans."""
        agreement, utc_s = self._agreement, self._utc_s()
        if agreement is None or utc_s is None:
            return frozenset()
        return frozenset(f"{IDENTITY}{plan.member}" for plan in circles_of(agreement, utc_s))

    def barring(self, path: Path) -> frozenset[int]:
        """Return the members whose circles bar a path to the goal that is flown from now on."""
        agreement, utc_s = self._agreement, self._utc_s()
        if agreement is None or utc_s is None:
            return frozenset()
        return members_barring(self._flight.state, path, circles_of(agreement, utc_s), utc_s)

    def request(self, path: Path) -> None:
        """Request that members move whose circles bar a path to the goal."""
        agreement, utc_s, who = self._agreement, self._utc_s(), listed(self.barring(path))
        if agreement is None or utc_s is None or not who:
            return
        agreement.request(wanted_plan(self._flight.state, path, utc_s), utc_s)
        text = f"system {who} bars the way to the goal, and is asked to move"
        self._announcer.decide(DecisionKind.TEAM, text, tell="barred", about=who, member=who)

    def note_waiting(self, *, is_waiting: bool) -> None:
        """Inform the pilot if the aircraft waits before the goal from now on."""
        if is_waiting and not self._is_waiting:
            text = "waits before the goal: the way on behind it is not free"
            self._announcer.decide(DecisionKind.TEAM, text, tell="way on taken")
        self._is_waiting = is_waiting

    @property
    def is_given(self) -> bool:
        """Whether the handed over mission may be entered: all have approved it, or nobody is asked."""
        agreement = self._agreement
        return agreement is None or not self._is_asking or agreement.outcome() is Outcome.APPROVED

    @property
    def refusal(self) -> str:
        """Why the mission may not be entered any more; '' while it may."""
        agreement = self._agreement
        if agreement is None or not self._is_asking:
            return ""
        if agreement.outcome() is Outcome.REFUSED:
            return f"refused by system {listed(agreement.refused_by)}"
        return "not approved in time" if agreement.outcome() is Outcome.WITHDRAWN else ""

    def hold(self) -> None:
        """Note that the mission is being entered."""
        if self._agreement is not None and self._is_asking:
            self._agreement.hold()

    def end(self, *, is_flown: bool) -> None:
        """Note whether the mission is flown now."""
        if self._agreement is not None and self._is_asking:
            self._agreement.commit() if is_flown else self._agreement.withdraw()
        self._is_asking = False

    def status(self) -> dict[str, object]:
        """Return the members, where they are and what they announced, for pages; nothing without a team.

        Goals are numbered from 1 as in the mission file. A team that shares none has no list of flown ones.
        """
        agreement, utc_s = self._agreement, self._utc_s()
        if agreement is None or utc_s is None:
            return {}
        lost, auction = agreement.members_lost(utc_s), agreement.auction
        plans = {
            plan.member: plan for plan in (*agreement.plans_to_clear()[::-1], agreement.committed) if plan
        }
        members = sorted({agreement.member, *self._flight.state.mission.team_members})
        lists = {} if auction is None else auction.lists(frozenset(members) - lost)
        rows = [
            {
                "system": member,
                "is_own": member == agreement.member,
                "is_lost": member in lost,
                "place_enu_m": self._place_of(member) if member not in lost else None,
                **(plans[member].document() if member in plans else NO_PLAN),
                "goals": [goal + 1 for goal in lists.get(member, ())],
            }
            for member in members
        ]
        flown = None if auction is None else [goal + 1 for goal in auction.flown]
        return {"members": rows, "flown": flown}

    def _place_of(self, member: int) -> tuple[float, float, float] | None:
        seen = self._sightings.get(member)
        return None if seen is None else seen[1]

    # --- where the others will be

    @property
    def plans(self) -> tuple[object, ...]:
        """The plans of others from which this member keeps clear."""
        return () if self._agreement is None else self._agreement.plans_to_clear()

    def takes(self, identity: str, place_enu_m: tuple[float, float, float], stamp_s: float) -> bool:
        """Return whether a vehicle is a member that flies its announced plan: then it is not tracked.

        Parameters
        ----------
        identity : str
            Identity of the vehicle that reported itself.
        place_enu_m : tuple of float
            Position of the vehicle [m].
        stamp_s : float
            Time of the position, by the clock [s].
        """
        agreement, ahead_s = self._agreement, self._utc.ahead_s
        member = member_named(identity, self._flight.state.mission.team_members)
        if agreement is None or ahead_s is None or member is None:
            return False
        agreement.observe(member, place_enu_m, stamp_s + ahead_s)
        self._sightings[member] = stamp_s, place_enu_m
        return member in agreement.members_as_announced(stamp_s + ahead_s)

    def with_members(self, tracks: Iterable[TrackState], now_s: float) -> tuple[TrackState, ...]:
        """Return tracks in which members fly their announced plans.

        A member that is lost, deviates or has announced nothing is an aircraft that passes, too.

        Parameters
        ----------
        tracks : iterable of TrackState
            All vehicles that are tracked.
        now_s : float
            The clock's reading [s].
        """
        agreement, ahead_s, state = self._agreement, self._utc.ahead_s, self._flight.state
        config = state.mission.team
        if agreement is None or config is None or ahead_s is None:
            return tuple(tracks)
        sighted, others = members_among(tracks, config.members)
        reach_m = config.apart_m + 2.0 * config.tolerance_m + PLANNED_SLACK_M
        up_m = config.paths_apart_up_m
        as_announced = agreement.members_as_announced(now_s + ahead_s)
        others += [
            replace(track, max_threat_radius_m=reach_m, flies_on=True, is_airborne=True, clear_up_m=up_m)
            for member, track in sighted.items()
            if member not in as_announced
        ]
        bounds = state.mission.bounds
        area = (bounds.east_m, bounds.north_m, bounds.up_m)
        near = self._near.of(agreement.plans_to_clear(), area, reach_m, up_m)
        others += [track_of_plan(plan, now_s, ahead_s, reach_m, up_m) for plan in near]
        return tuple(sorted(others, key=lambda track: track.identity))
