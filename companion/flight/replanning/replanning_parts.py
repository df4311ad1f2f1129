"""The parts of replanning."""

from __future__ import annotations

from dataclasses import dataclass

from companion.clock import Clock
from companion.flight.exchange.handover import Handover
from companion.flight.exchange.protocols import team_protocols
from companion.flight.messages.announcer import Announcer
from companion.flight.messages.observer import Observer
from companion.flight.messages.vehicle_link import VehicleLink
from companion.flight.monitors.freshness_watch import FreshnessWatch
from companion.flight.monitors.geofences import Geofences
from companion.flight.monitors.performance_watch import PerformanceWatch
from companion.flight.monitors.rally_points import RallyPoints
from companion.flight.replanning.plan_maker import PlanMaker, PlanRunner
from companion.flight.state.checkpoint import Checkpoint
from companion.flight.state.flight_state import StateOwner
from companion.flight.state.world_model import WorldModel
from companion.recording.recorder import Recorder


@dataclass(frozen=True, slots=True)
class ReplanningParts:
    """The parts of replanning.

    Parameters
    ----------
    flight : StateOwner
        The flight's state.
    world_model : Situation
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
    performance : PerformanceWatch
        Notices when the aircraft does not do what its plan says.
    announcer : Announcer
        Announces decisions.
    clock : Clock
        The service's clock.
    """

    flight: StateOwner
    world_model: WorldModel
    maker: PlanMaker
    handover: Handover
    geofences: Geofences
    rally_points: RallyPoints
    freshness: FreshnessWatch
    performance: PerformanceWatch
    announcer: Announcer
    clock: Clock


def parts_for(
    flight: StateOwner,
    world_model: WorldModel,
    link: VehicleLink,
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
    autopilot, protocols = link.autopilot, team_protocols(flight, world_model, link, clock, announcer)
    return ReplanningParts(
        flight=flight,
        world_model=world_model,
        maker=PlanMaker(seed, runner, clock, recorder, observer),
        handover=Handover(protocols, announcer, checkpoint, recorder, observer),
        geofences=Geofences(flight, world_model, autopilot, announcer, clock),
        rally_points=RallyPoints(flight, autopilot, announcer, clock),
        freshness=FreshnessWatch(flight, world_model, autopilot, announcer),
        performance=PerformanceWatch(flight, world_model, announcer),
        announcer=announcer,
        clock=clock,
    )
