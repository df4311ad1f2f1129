"""Where the code is that makes a campaign's runs, by kind; other packages offer theirs, loaded later."""

from __future__ import annotations

EXTRA_COMMANDS = "companion.commands"  # entry points of those who offer commands, and places as they do
FLIGHT = "flight"  # who flies one flight for a Python program
PURSUERS = "pursuers"  # who drives the moving threats against a plan
_PLACES = {"plans": "companion.campaign.plan_outcomes:PlanRunner"}


def offer(kind: str, place: str) -> None:
    """Tell where the code for a kind of run is, as ``module:name``; it is loaded when it is needed."""
    _PLACES[kind] = place


def places() -> dict[str, str]:
    """Where the code is, by kind; handed to the processes that make the runs."""
    return dict(_PLACES)
