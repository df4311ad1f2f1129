"""``companion campaign`` and ``companion results``, without their options."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from companion.errors import ConfigError
from companion.research.campaign.campaign_progress import run_campaign
from companion.research.campaign.campaign_spec import load_campaign
from companion.research.campaign.run_store import RunStore
from companion.research.evidence.samples import evidence_of
from companion.safe_files import SHARED, replace_file

RESULTS = Path("results")


def campaign_from_file(
    spec: Path,
    *,
    jobs: int,
    resumes: bool,
    folder: Path | None,
    console: Console,
    scheduler: str | None = None,
) -> None:
    """Make the runs of a campaign's file, and print where they are.

    Raises
    ------
    CompanionError
        If the file has an error, the folder is another campaign's, or rows cannot be stored.
    """
    campaign = load_campaign(spec)
    where = RESULTS / campaign.config.name if folder is None else folder
    try:
        done = run_campaign(campaign, where, jobs=jobs, resumes=resumes, console=console, scheduler=scheduler)
    except KeyboardInterrupt:
        kept = f"stopped; what was made is kept, and --resume goes on: {where}"
        console.print(kept, markup=False, highlight=False, soft_wrap=True)
        raise
    summary = (
        f"{done.num_rows} runs, {done.num_made} of them made now, {done.num_errors} of these errors: {where}"
    )
    console.print(summary, markup=False, highlight=False, soft_wrap=True)


def results_in(folder: Path, console: Console, *, keep: Path | None = None, page: Path | None = None) -> None:
    """Write the results of a campaign next to its rows: tables, a page, and CSV files.

    Parameters
    ----------
    folder : Path
        A campaign's rows; with ``page``, a folder of kept rows.
    console : Console
        Console that the names of written files go to.
    keep : Path, optional
        File that the rows are also written to, in short form.
    page : Path, optional
        File for one page of all kept rows; then nothing else is written.

    Raises
    ------
    CompanionError
        If there are no rows, or the files cannot be written.
    """
    from companion.research.evidence.document.kept_rows import stored_text  # noqa: PLC0415 - drawings are an extra
    from companion.research.evidence.document.results_document import results_document  # noqa: PLC0415
    from companion.research.evidence.results import write_results  # noqa: PLC0415

    written: tuple[Path, ...]
    if page is not None:
        written = (_written(page, results_document(folder)),)
    else:
        store = RunStore.to_read(folder)
        try:
            evidence = evidence_of(store)
            kept = "" if keep is None else stored_text(store)
        finally:
            store.close()
        try:
            written = write_results(folder, evidence)
        except OSError as error:
            raise ConfigError(
                str(folder), None, "FOLDER", error.strerror or str(error), "a folder to write to"
            ) from None
        if keep is not None:
            written = (*written, _written(keep, kept))
    for file in written:
        console.print(file, markup=False, highlight=False, soft_wrap=True)


def _written(file: Path, text: str) -> Path:
    """Write a file that an option names, and print its name.

    Raises
    ------
    ConfigError
        If it cannot be written.
    """
    try:
        replace_file(file, text.encode(), SHARED)
    except OSError as error:
        raise ConfigError(
            str(file), None, "option", error.strerror or str(error), "a file to write"
        ) from None
    return file
