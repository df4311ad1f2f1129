"""Faults of the link, announced to the pilot once: other autopilots, contradictions, floods."""

from __future__ import annotations

from companion.flight.messages.announcer import Announcer
from companion.flight.messages.vehicle_link import VehicleLink
from companion.flight.state.decision import DecisionKind
from companion.types.events import Heartbeat

ANNOUNCED_MAX = 4  # At most this many other autopilots are announced; more are a flood.
FLOOD_MIN = 50  # This many dropped frames per second are a flood.
FLOOD_OVER_S = 10.0  # A flood is over after this time without drops.
DROPS = ("rate_limited", "total_limited", "vehicle_rate_limited", "unanswered", "untold")
ANNOUNCED_ONCE = {
    "other_address": ("its ids come from a second address", "second address"),
    "refused_parameter_source": ("who may not wants to set parameters", "parameter source"),
}


class LinkWatch:
    """Watches one link.

    Parameters
    ----------
    link : VehicleLink
        The watched link.
    announcer : Announcer
        Announces faults to the pilot.

    Attributes
    ----------
    is_contradicted : bool
        Whether heartbeats with the vehicle's ids contradict each other.
    """

    def __init__(self, link: VehicleLink, announcer: Announcer) -> None:
        self.is_contradicted = False
        self._link = link
        self._announcer = announcer
        self._num_others = 0
        self._num_dropped = 0
        self._announced: set[str] = set()
        self._flooded_s: float | None = None

    def note_heartbeat(self, heartbeat: Heartbeat) -> None:
        """Announce when contradictions begin and end."""
        if heartbeat.is_contradicted is self.is_contradicted:
            return
        self.is_contradicted = heartbeat.is_contradicted
        words = "heartbeats contradict each other" if self.is_contradicted else "heartbeats agree again"
        self._announcer.decide(DecisionKind.LINK, words)  # The pilot is informed by the change of mode.

    def look(self, now_s: float) -> None:
        """Evaluate what was counted since the last call, a second ago."""
        identity, counters = self._link.codec.identity, self._link.codec.counters
        for system in identity.others[self._num_others : ANNOUNCED_MAX]:
            if system in self._link.members:
                continue
            words = f"autopilot {system} is heard, too; flying {identity.system_id}"
            own = identity.system_id
            self._announcer.decide(DecisionKind.LINK, words, tell="another autopilot", other=system, own=own)
        self._num_others = len(identity.others)
        for reason, (words, name) in ANNOUNCED_ONCE.items():
            if counters[reason] and reason not in self._announced:
                self._announced.add(reason)
                self._announcer.decide(DecisionKind.LINK, words, tell=name)
        dropped = sum(counters[reason] for reason in DROPS) + counters["flooded_bytes"] // 100
        new, self._num_dropped = dropped - self._num_dropped, dropped
        if new >= FLOOD_MIN:
            if self._flooded_s is None:
                self._announcer.decide(
                    DecisionKind.LINK,
                    "flood: not all is heard",
                    why={"dropped": new},
                    tell="flood",
                )
            self._flooded_s = now_s
        elif self._flooded_s is not None and now_s - self._flooded_s > FLOOD_OVER_S:
            self._flooded_s = None
            self._announcer.decide(
                DecisionKind.LINK,
                "the flood is over",
                why={"dropped": dropped},
                tell="calm",
            )
