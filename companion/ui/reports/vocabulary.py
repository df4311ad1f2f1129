"""Words that the page and the report share: the heading of each kind of decision, and its severity."""

from __future__ import annotations

import json
from typing import Final, NamedTuple

WATCH: Final = "watch"
DANGER: Final = "danger"


class Words(NamedTuple):
    """The words for a kind of decision.

    Parameters
    ----------
    head : str
        The heading.
    state : str
        ``danger``, ``watch``, or '' for a normal state.
    """

    head: str
    state: str = ""


KINDS: Final = {
    "swap": Words("New way flown"),
    "keep": Words("Kept the way being flown"),
    "no plan": Words("Found no plan", WATCH),
    "rejected": Words("Plan refused by the check", WATCH),
    "emergency": Words("Emergency", DANGER),
    "mode": Words("Mode"),
    "suspended": Words("Somebody else flies", WATCH),
    "arrived": Words("Arrived"),
    "landed": Words("Landed"),
    "landing": Words("Landing", WATCH),
    "mission": Words("Mission"),
    "takeover": Words("Takes over"),
    "fault": Words("Fault", WATCH),
    "ready": Words("Ready"),
    "handback": Words("Handing back"),
    "ahead": Words("Ahead", WATCH),
    "engine": Words("Engine", DANGER),
    "energy": Words("Battery", WATCH),
    "return": Words("Return path"),
    "off path": Words("Not on its path", WATCH),
    "restart": Words("Restarted"),
    "link": Words("Link", WATCH),
    "stale": Words("Data too old", WATCH),
    "fresh": Words("Data is fresh again"),
    "ground": Words("Ground", WATCH),
    "traffic": Words("Traffic", WATCH),
    "team": Words("Team", WATCH),
    "fence": Words("Fences"),
    "rally": Words("Rally points"),
    "reload": Words("Mission file read again"),
    "parameters": Words("Parameters", WATCH),
    "recording": Words("Recording"),
    "stopped": Words("Service stopped", WATCH),
}


def decision_words(kind: str) -> Words:
    """Return the words for a kind; a kind of another version has its own name."""
    return KINDS.get(kind, Words(kind))


def as_script() -> bytes:
    """Return the same for the page: a JavaScript module with ``KINDS``, each with a heading and a state."""
    return f"export const KINDS = {json.dumps(KINDS)};\n".encode("ascii")
