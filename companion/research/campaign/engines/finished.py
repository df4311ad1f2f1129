"""A finished run, whatever engine made it."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from companion.research.campaign.campaign_spec import Run
from companion.research.campaign.engines.runners import Packed
from companion.research.campaign.provenance import Provenance


@dataclass(frozen=True, slots=True)
class Finished:
    """A finished run.

    Parameters
    ----------
    run : Run
        The run.
    outcome : Packed
        The outcome of the run.
    started : datetime
        When a process or worker got it, in UTC.
    duration_s : float
        Time from then until its outcome arrived [s].
    attempts : int
        Number of processes that tried it.
    made_by : Provenance, optional
        The program and computer that made it, if not these.
    """

    run: Run
    outcome: Packed
    started: datetime
    duration_s: float
    attempts: int
    made_by: Provenance | None = None
