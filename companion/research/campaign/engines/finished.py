"""A run that is over, whatever engine made it."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from companion.research.campaign.campaign_spec import Run
from companion.research.campaign.engines.runners import Packed
from companion.research.campaign.provenance import Provenance


@dataclass(frozen=True, slots=True)
class Finished:
    """A run that is over.

    Parameters
    ----------
    run : Run
        Which.
    outcome : Packed
        What came of it.
    started : datetime
        When it was handed out, in UTC.
    duration_s : float
        From then until its outcome was here [s].
    attempts : int
        How many processes it took.
    made_by : Provenance, optional
        What made it, where that is not this program on this computer.
    """

    run: Run
    outcome: Packed
    started: datetime
    duration_s: float
    attempts: int
    made_by: Provenance | None = None
