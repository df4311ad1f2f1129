"""Runners, which make the runs of a campaign, and the outcomes of runs."""

from __future__ import annotations

import json
import math
import pkgutil
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol, cast

from companion.research.campaign.campaign_spec import Campaign, Run, Scalar


@dataclass(frozen=True, slots=True)
class Outcome:
    """The outcome of one run.

    Parameters
    ----------
    measures : dict
        Measures that repeat with the run, on any computer; None where there is nothing to measure.
    timings : dict
        Measures that depend on the computer.
    paths : dict
        Paths as rows, by name.
    """

    measures: dict[str, Scalar | None] = field(default_factory=dict)
    timings: dict[str, Scalar | None] = field(default_factory=dict)
    paths: dict[str, object] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Packed:
    """An outcome as stored: JSON with sorted keys, and the paths compressed; without paths no bytes."""

    measures: str = "{}"
    timings: str = "{}"
    paths: bytes = b""
    error: str | None = None


def packed(outcome: Outcome) -> Packed:
    """Pack an outcome; infinite values and NaN count as not measured.

    Raises
    ------
    ValueError
        If there is such a value in a path.
    """
    paths = zlib.compress(json_text(outcome.paths).encode("ascii")) if outcome.paths else b""
    return Packed(json_text(_finite(outcome.measures)), json_text(_finite(outcome.timings)), paths)


def json_text(value: object) -> str:
    """Write JSON that is the same for the same value."""
    return json.dumps(value, sort_keys=True, allow_nan=False)


def _finite(measures: dict[str, Scalar | None]) -> dict[str, Scalar | None]:
    return {
        key: None if isinstance(value, float) and not math.isfinite(value) else value
        for key, value in measures.items()
    }


class Runner(Protocol):
    """Makes one run after the other, in one process."""

    def warm_up(self) -> None:
        """Do the work that must not be timed, once."""
        ...

    def outcome(self, run: Run) -> Outcome:
        """Make a run."""
        ...


def runner_at(place: str, campaign: Campaign, known: dict[str, str]) -> Runner:
    """Load the runner for a campaign.

    Parameters
    ----------
    place : str
        Where the runner's code is, as ``module:name``.
    campaign : Campaign
        The campaign.
    known : dict
        All known places, for parts in other packages.
    """
    made = cast("Callable[[Campaign, dict[str, str]], Runner]", pkgutil.resolve_name(place))
    return made(campaign, known)
