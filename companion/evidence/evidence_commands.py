"""``companion campaign`` and ``companion results``, but for their options."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from companion.campaign.campaign_progress import run_campaign
from companion.campaign.campaign_spec import load_campaign
from companion.campaign.run_store import RunStore
from companion.errors import ConfigError
from companion.evidence.samples import evidence_of

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
    try:
        done = run_campaign(campaign, where, jobs=jobs, resumes=resumes, console=console)
    except KeyboardInterrupt:
        kept = f"stopped; what was made is kept, and --resume goes on: {where}"
        console.print(kept, markup=False, highlight=False, soft_wrap=True)
        raise
    told = (
        f"{done.num_rows} runs, {done.num_made} of them made now, {done.num_errors} of these errors: {where}"
    )
    console.print(told, markup=False, highlight=False, soft_wrap=True)


def results_in(folder: Path, console: Console) -> None:
    """Write what a campaign's rows say beside them, as tables, a page and figures for other programs.

    Raises
    ------
    CompanionError
        If there are no rows, or nothing can be written there.
    """
    from companion.evidence.results import write_results  # noqa: PLC0415 - its drawings are an extra

    store = RunStore.to_read(folder)
    try:
        evidence = evidence_of(store)
    finally:
        store.close()
    try:
        written = write_results(folder, evidence)
    except OSError as error:
        raise ConfigError(
            str(folder), None, "FOLDER", error.strerror or str(error), "a folder to write to"
        ) from None
    for file in written:
        console.print(file, markup=False, highlight=False, soft_wrap=True)
