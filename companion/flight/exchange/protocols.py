"""The swap protocol of each kind of autopilot, selected by the autopilot's heartbeat."""

from __future__ import annotations

from dataclasses import dataclass

from companion.clock import Clock
from companion.flight.exchange.swap_arduplane import ArduPlaneSwap
from companion.flight.exchange.swap_protocol import Consent, SwapParts, SwapProtocol
from companion.flight.exchange.swap_px4 import Px4Swap
from companion.flight.state.flight_state import StateOwner
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
    by_dialect : mapping of Dialect to SwapProtocol
        One protocol for each kind of autopilot.
    """

    parts: SwapParts
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
    flight: StateOwner, link: AutopilotLink, ownship: OwnshipEstimator, clock: Clock, consent: Consent
) -> SwapProtocols:
    """Return the protocols over one link."""
    parts = SwapParts(flight, link, ownship, clock, consent)
    return SwapProtocols(parts, {Dialect.ARDUPILOT: ArduPlaneSwap(parts), Dialect.PX4: Px4Swap(parts)})
