"""The parts of replanning."""

from __future__ import annotations

from dataclasses import dataclass

from companion.clock import Clock
from companion.flight.exchange.handover import Handover
from companion.flight.exchange.protocols import protocols_for
from companion.flight.messages.announcer import Announcer
from companion.flight.messages.observer import Observer
from companion.flight.monitors.freshness_watch import FreshnessWatch
from companion.flight.monitors.geofences import Geofences
from companion.flight.monitors.rally_points import RallyPoints
from companion.flight.state.checkpoint import Checkpoint
from companion.flight.state.flight_state import StateOwner
from companion.flight.state.situation import Situation
from companion.flight.tasks.plan_maker import PlanMaker, PlanRunner
from companion.flight.tasks.plan_schedule import KnownThreats
from companion.link.missions.autopilot_link import AutopilotLink
from companion.recording.recorder import Recorder


@dataclass(frozen=True, slots=True)
class ReplanningParts:
    """The parts of replanning.

    Parameters
    ----------
    flight : StateOwner
        The flight's state.
    situation : Situation
        The known world: aircraft and threats.
    maker : PlanMaker
        Makes the plans.
    handover : Handover
        Hands missions over to the autopilot.
    geofences : Geofences
        Reads the fences.
    rally_points : RallyPoints
        Reads the rally points.
    freshness : FreshnessWatch
        Detects stale inputs.
    announcer : Announcer
        Announces decisions.
    clock : Clock
        The service's clock.
    """

    flight: StateOwner
    situation: Situation
    maker: PlanMaker
    handover: Handover
    geofences: Geofences
    rally_points: RallyPoints
    freshness: FreshnessWatch
    announcer: Announcer
    clock: Clock


def parts_for(
    flight: StateOwner,
    situation: Situation,
    link: AutopilotLink,
    clock: Clock,
    *,
    announcer: Announcer,
    checkpoint: Checkpoint,
    recorder: Recorder,
    observer: Observer,
    seed: int,
    runner: PlanRunner,
) -> ReplanningParts:
    """Return the parts over one link; the parameters are those of ``tasks.composition.composed``."""
    protocols = protocols_for(flight, link, situation.ownship, clock)
    return ReplanningParts(
        flight=flight,
        situation=situation,
        maker=PlanMaker(seed, runner, clock, recorder, observer),
        handover=Handover(protocols, announcer, checkpoint, recorder, observer),
        geofences=Geofences(flight, situation, link, announcer, clock),
        rally_points=RallyPoints(flight, link, announcer, clock),
        freshness=FreshnessWatch(flight, situation, link, announcer),
        announcer=announcer,
        clock=clock,
    )


def known_threats(situation: Situation, now_s: float) -> KnownThreats:
    """Return the threats that are known now."""
    return KnownThreats(situation.num_known_threats, tuple(situation.tracker.received_s(now_s)))
