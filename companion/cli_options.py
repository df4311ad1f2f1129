"""What several commands share: arguments and options with their help, and the bar shown while compiling."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.console import Console

MissionFile = Annotated[Path, typer.Argument(help="A mission file, as in mission_configs.")]
JsonFile = Annotated[Path | None, typer.Option("--json", help="Write the result here; - is standard output.")]
MetricsPort = Annotated[
    int | None,
    typer.Option(
        "--metrics", min=1, max=65535, envvar="COMPANION_METRICS",
        help="Port of /metrics and /healthz, for this computer alone; left out, there is none.",
    ),
]  # fmt: skip
PagePort = Annotated[
    int | None, typer.Option("--page", min=1, max=65535, help="Port of the page that shows it in a browser.")
]
PageListen = Annotated[
    str,
    typer.Option(
        "--page-listen", envvar="COMPANION_PAGE_LISTEN",
        help="Address the page is told on, with a token; left out, to this computer alone.",
    ),
]  # fmt: skip
PageToken = Annotated[
    str,
    typer.Option("--page-token", envvar="COMPANION_PAGE_TOKEN", help="What viewers elsewhere have to know."),
]
PageGround = Annotated[
    Path | None,
    typer.Option(
        "--page-ground", envvar="COMPANION_PAGE_GROUND",
        help="Ground under the page's map: an .mbtiles or .hgt file, or a folder with some. Only drawn.",
    ),
]  # fmt: skip


def make_ready_with_bar(console: Console) -> None:
    """Load all kernels. A bar shows how many of how many are compiled, where some have to be.

    Raises
    ------
    RuntimeError
        If a kernel cannot be compiled.
    """
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from companion.kernels.native.ready import make_ready

    columns = (
        TextColumn("compiling the planner, once"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    bar = Progress(*columns, console=console)
    task = bar.add_task("")

    def report(done: int, total: int) -> None:
        if not bar.live.is_started:
            bar.start()
        bar.update(task, completed=done, total=total)

    try:
        make_ready(report)
    finally:
        if bar.live.is_started:
            bar.stop()
