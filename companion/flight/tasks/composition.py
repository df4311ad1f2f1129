"""The parts of the service, put together from a mission file and a link."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from companion.clock import Clock
from companion.config import MissionConfig
from companion.config.parameters.pilot_parameters import Parameters
from companion.flight.messages.announcer import Announcer
from companion.flight.messages.observer import Observer
from companion.flight.messages.vehicle_link import VehicleLink
from companion.flight.replanning.plan_maker import PlanRunner
from companion.flight.replanning.replanning import Replanning
from companion.flight.replanning.replanning_parts import parts_for
from companion.flight.replanning.way_home import WayHome
from companion.flight.state.checkpoint import Checkpoint
from companion.flight.state.flight_state import StateOwner, first_state
from companion.flight.state.world_model import WorldModel
from companion.flight.tasks.departure import Departure
from companion.recording.recorder import Recorder


@dataclass(frozen=True, slots=True)
class Composition:
    """The parts of the service; made by :func:`composed`.

    Parameters
    ----------
    parameters : Parameters
        The parameters that a pilot may change.
    flight : StateOwner
        The flight's state.
    world_model : Situation
        The known world: aircraft and threats.
    link : VehicleLink
        The link to the vehicle.
    announcer : Announcer
        Announces decisions.
    departure : Departure
        Reads the operator's list until the takeover.
    replanning : Replanning
        Plans, and hands missions over.
    way_home : WayHome
        Keeps a return path in the autopilot's list.
    checkpoint : Checkpoint
        What a restart in flight needs to know.
    recorder : Recorder
        Records the flight.
    observer : Observer
        Is notified of events.
    clock : Clock
        The service's clock.
    """

    parameters: Parameters
    flight: StateOwner
    world_model: WorldModel
    link: VehicleLink
    announcer: Announcer
    departure: Departure
    replanning: Replanning
    way_home: WayHome
    checkpoint: Checkpoint
    recorder: Recorder
    observer: Observer
    clock: Clock


def composed(
    mission: MissionConfig,
    link: VehicleLink,
    clock: Clock,
    recorder: Recorder,
    *,
    seed: int,
    runner: PlanRunner,
    checkpoint: Checkpoint | None = None,
    observer: Observer | None = None,
    parameters_file: Path | None = None,
) -> Composition:
    """Put a service together.

    Parameters
    ----------
    mission : MissionConfig
        The mission file.
    link : VehicleLink
        The link to the vehicle.
    clock : Clock
        The service's clock. With an ``InlineRunner`` it must be one that others advance: a plan then takes
        the mission file's ``planning_budget_s`` of it, however long the computer needs.
    recorder : Recorder
        Records the flight.
    seed : int
        Seed of all plans and particle filters.
    runner : PlanRunner
        Limits the time of plans, and determines their clock.
    checkpoint : Checkpoint, optional
        What is remembered of the flight for a restart.
    observer : Observer, optional
        Is notified of events.
    parameters_file : Path, optional
        File of the parameters that a pilot sets.
    """
    parameters, observer = Parameters(mission, parameters_file, is_threaded=True), observer or Observer()
    flight = StateOwner(first_state(parameters.mission(), clock.now_s()))
    world_model = WorldModel(flight.state.rules, seed)
    announcer, checkpoint = Announcer(link, recorder, clock), checkpoint or Checkpoint()
    parts = parts_for(
        flight, world_model, link, clock, announcer=announcer, checkpoint=checkpoint,
        recorder=recorder, observer=observer, seed=seed, runner=runner,
    )  # fmt: skip
    replanning = Replanning(parts)
    return Composition(
        parameters=parameters,
        flight=flight,
        world_model=world_model,
        link=link,
        announcer=announcer,
        departure=Departure(parts),
        replanning=replanning,
        way_home=WayHome(parts, replanning.energy),
        checkpoint=checkpoint,
        recorder=recorder,
        observer=observer,
        clock=clock,
    )
