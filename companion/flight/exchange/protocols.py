"""The protocol of each kind of autopilot, chosen by which one is heard."""

from __future__ import annotations

from dataclasses import dataclass

from companion.clock import Clock
from companion.flight.exchange.swap_arduplane import ArduPlaneSwap
from companion.flight.exchange.swap_protocol import SwapParts, SwapProtocol
from companion.flight.exchange.swap_px4 import Px4Swap
from companion.flight.state.flight_state import StateOwner
from companion.link.missions.autopilot_link import AutopilotLink
from companion.tracking.ownship import OwnshipEstimator
from companion.types.events import Dialect


@dataclass(frozen=True, slots=True)
class SwapProtocols:
    """The protocols, and what they work with; made by :func:`protocols_for`.

    Parameters
    ----------
    parts : SwapParts
        What they work with.
    by_dialect : mapping of Dialect to SwapProtocol
        One each.
    """

    parts: SwapParts
    by_dialect: dict[Dialect, SwapProtocol]

    @property
    def dialect(self) -> Dialect:
        """Of the autopilot that is heard; ArduPlane's before one is."""
        return self.parts.link.dialect or Dialect.ARDUPILOT

    @property
    def now(self) -> SwapProtocol:
        """What the autopilot that is heard needs."""
        return self.by_dialect[self.dialect]


def protocols_for(
    flight: StateOwner, link: AutopilotLink, ownship: OwnshipEstimator, clock: Clock
) -> SwapProtocols:
    """The protocols over one link."""
    parts = SwapParts(flight, link, ownship, clock)
    return SwapProtocols(parts, {Dialect.ARDUPILOT: ArduPlaneSwap(parts), Dialect.PX4: Px4Swap(parts)})
