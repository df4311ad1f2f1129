"""Places of the code that makes a campaign's runs. Other packages register theirs with their commands."""

from __future__ import annotations

import contextlib
from importlib.metadata import entry_points

import typer

EXTRA_COMMANDS = "companion.commands"  # Entry points of packages that add commands and places to run.
FLIGHT = "flight"  # Place that flies one flight for a Python program.
WATCHED = "watched"  # Place that flies one flight for the editor, and publishes it as it goes.
PURSUERS = "pursuers"  # Place that drives the moving threats against a plan.
_PLACES = {"plans": "companion.research.campaign.plan_outcomes:PlanRunner"}


def offer(kind: str, place: str) -> None:
    """Register the code for a kind of run, as ``module:name``; it is loaded when needed."""
    _PLACES[kind] = place


def places() -> dict[str, str]:
    """Return where the code is, by kind, also that of other packages."""
    if FLIGHT not in _PLACES:
        _ask_others()
    return dict(_PLACES)


def _ask_others() -> None:
    """Let other packages register their commands on a dummy: they register their places, too."""
    for entry in entry_points(group=EXTRA_COMMANDS):
        with contextlib.suppress(ImportError):
            entry.load()(typer.Typer())
