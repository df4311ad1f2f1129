"""The swap protocol of each kind of autopilot, selected by the autopilot's heartbeat."""

from __future__ import annotations

from dataclasses import dataclass

from companion.clock import Clock
from companion.flight.exchange.consent import NobodyAsked, Team
from companion.flight.exchange.swap_arduplane import ArduPlaneSwap
from companion.flight.exchange.swap_protocol import SwapParts, SwapProtocol
from companion.flight.exchange.swap_px4 import Px4Swap
from companion.flight.exchange.team_exchange import TeamExchange
from companion.flight.messages.announcer import Announcer
from companion.flight.messages.vehicle_link import VehicleLink
from companion.flight.state.flight_state import StateOwner
from companion.flight.state.world_model import WorldModel
from companion.link.missions.autopilot_link import AutopilotLink
from companion.tracking.ownship import OwnshipEstimator
from companion.types.events import Dialect


@dataclass(frozen=True, slots=True)
class SwapProtocols:
    """The protocols, made by :func:`protocols_for`.

    Parameters
    ----------
    parts : SwapParts
        The objects that the protocols work with.
    team : Team
        Who is asked before a mission is entered.
    by_dialect : mapping of Dialect to SwapProtocol
        One protocol for each kind of autopilot.
    """

    parts: SwapParts
    team: Team
    by_dialect: dict[Dialect, SwapProtocol]

    @property
    def dialect(self) -> Dialect:
        """The dialect of the received autopilot; ArduPlane's before one is received."""
        return self.parts.link.dialect or Dialect.ARDUPILOT

    @property
    def now(self) -> SwapProtocol:
        """The protocol of the received autopilot."""
        return self.by_dialect[self.dialect]


def protocols_for(
    flight: StateOwner, link: AutopilotLink, ownship: OwnshipEstimator, clock: Clock,
    team: Team | None = None,
) -> SwapProtocols:  # fmt: skip
    """Return the protocols over one link; without a ``team`` nobody is asked."""
    asked = team or NobodyAsked()
    parts = SwapParts(flight, link, ownship, clock, asked)
    return SwapProtocols(parts, asked, {Dialect.ARDUPILOT: ArduPlaneSwap(parts), Dialect.PX4: Px4Swap(parts)})


def team_protocols(
    flight: StateOwner, world_model: WorldModel, link: VehicleLink, clock: Clock, announcer: Announcer
) -> SwapProtocols:
    """Return the protocols of a member of a team; if the mission file has none, nobody is asked.

    Members whose paths are known are in the world where they will be.
    """
    team = TeamExchange(flight, world_model.ownship, link, clock, announcer)
    world_model.listen_to_team(team)
    return protocols_for(flight, link.autopilot, world_model.ownship, clock, team)
