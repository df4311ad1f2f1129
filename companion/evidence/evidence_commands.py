"""``companion campaign`` and ``companion results``, but for their options."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from companion.campaign.campaign_progress import run_campaign
from companion.campaign.campaign_spec import load_campaign

RESULTS = Path("results")


def campaign_from_file(
    spec: Path, *, jobs: int, resumes: bool, folder: Path | None, console: Console
) -> None:
    """Make the runs that a campaign's file asks for, and tell where they are.

    Raises
    ------
    CompanionError
        If the file is wrong, the folder another's, or rows cannot be stored.
    """
    campaign = load_campaign(spec)
    where = RESULTS / campaign.config.name if folder is None else folder
    done = run_campaign(campaign, where, jobs=jobs, resumes=resumes, console=console)
    told = (
        f"{done.num_rows} runs, {done.num_made} of them made now, {done.num_errors} of these errors: {where}"
    )
    console.print(told, markup=False, highlight=False, soft_wrap=True)
