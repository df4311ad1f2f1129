"""The consent that a mission needs before it is entered: of a team's members, or of nobody."""

from __future__ import annotations

from typing import Protocol

from companion.flight.construction.mission_construction import ConstructedMission
from companion.mission.swap import Consent
from companion.types.events import ClockReported, TeamMessage
from companion.types.path import Path


class Team(Consent, Protocol):
    """The members of a team, as the rest of the service sees them."""

    def propose(self, constructed: ConstructedMission, /) -> str:
        """Ask for a mission that is to be entered; return what it conflicts with, '' for nothing."""

    def end(self, *, is_flown: bool) -> None:
        """Note whether the mission is flown now."""

    def take(self, event: ClockReported | TeamMessage, /) -> None:
        """Take what arrives from others, or the time."""

    def keep_up(self) -> bool:
        """Send what is due; return whether other goals are flown from now on."""

    def circling(self) -> frozenset[str]:
        """Return the identities of members that circle at the end of their plans."""

    def barring(self, path: Path, /) -> frozenset[int]:
        """Return the members whose circles bar a path to the goal that is flown from now on."""

    def request(self, path: Path, /) -> None:
        """Request that members move whose circles bar a path to the goal."""

    def note_waiting(self, *, is_waiting: bool) -> None:
        """Inform the pilot if the aircraft waits before the goal from now on."""

    def status(self) -> dict[str, object]:
        """Return the members for pages."""


class NobodyAsked:
    """A team without other members."""

    is_given = True
    refusal = ""

    def propose(self, _constructed: ConstructedMission, /) -> str:
        """Return '': nothing conflicts."""
        return ""

    def hold(self) -> None:
        """Do nothing."""

    def end(self, *, is_flown: bool) -> None:
        """Do nothing."""

    def take(self, _event: ClockReported | TeamMessage, /) -> None:
        """Do nothing."""

    def keep_up(self) -> bool:
        """Return False: no goals are shared."""
        return False

    def circling(self) -> frozenset[str]:
        """Return nobody."""
        return frozenset()

    def barring(self, _path: Path, /) -> frozenset[int]:
        """Return nobody."""
        return frozenset()

    def request(self, _path: Path, /) -> None:
        """Do nothing."""

    def note_waiting(self, *, is_waiting: bool) -> None:
        """Do nothing."""

    def status(self) -> dict[str, object]:
        """Return nothing: there are no members."""
        return {}
