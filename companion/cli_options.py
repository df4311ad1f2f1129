"""Arguments, options, progress bars and output that several commands share."""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from companion import safe_files
from companion.errors import ConfigError

if TYPE_CHECKING:
    from rich.console import Console

MissionFile = Annotated[Path, typer.Argument(help="A mission file, as in mission_configs.")]
JsonFile = Annotated[Path | None, typer.Option("--json", help="Write the result here; - is standard output.")]
MetricsPort = Annotated[
    int | None,
    typer.Option(
        "--metrics", min=1, max=65535, envvar="COMPANION_METRICS",
        help="Port of /metrics and /healthz, for this computer only; by default none.",
    ),
]  # fmt: skip
Force = Annotated[bool, typer.Option("--force", help="Replace files that exist.")]
PlanTarget = Annotated[
    Path | None, typer.Option("--plan", help="Write the mission as a QGroundControl plan.")
]
KmlTarget = Annotated[Path | None, typer.Option("--kml", help="Write places and paths as KML.")]
GeojsonTarget = Annotated[Path | None, typer.Option("--geojson", help="Write places and paths as GeoJSON.")]
PagePort = Annotated[
    int | None, typer.Option("--page", min=1, max=65535, help="Port of the page that shows it in a browser.")
]
PageListen = Annotated[
    str,
    typer.Option(
        "--page-listen", envvar="COMPANION_PAGE_LISTEN",
        help="Address of the page for other computers, with a token; by default this computer only.",
    ),
]  # fmt: skip
PageToken = Annotated[
    str,
    typer.Option("--page-token", envvar="COMPANION_PAGE_TOKEN", help="Token for viewers on other computers."),
]
PageGround = Annotated[
    Path | None,
    typer.Option(
        "--page-ground", envvar="COMPANION_PAGE_GROUND",
        help="Terrain or map under the page's map: an .mbtiles or .hgt file, or a folder of them.",
    ),
]  # fmt: skip


@dataclass(frozen=True, slots=True)
class Targets:
    """Files to write, each in its format; ``replaces`` says whether existing files may be replaced."""

    plan: Path | None = None
    kml: Path | None = None
    geojson: Path | None = None
    replaces: bool = False

    @property
    def is_any(self) -> bool:
        """Whether a file is to be written."""
        return any((self.plan, self.kml, self.geojson))


def make_ready_with_bar(console: Console) -> None:
    """Load all kernels, with a progress bar if some must be compiled.

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


@contextlib.contextmanager
def writing(target: Path, option: str) -> Iterator[None]:
    """Report a file that cannot be written as a wrong option."""
    try:
        yield
    except OSError as error:
        raise ConfigError(
            str(target), None, option, error.strerror or str(error), "a file to write"
        ) from None


def write_json(target: Path, document: object) -> None:
    """Write a JSON document to a file, whole or not at all, or to standard output.

    Raises
    ------
    ConfigError
        If the file cannot be written.
    """
    text = json.dumps(document, indent=1, allow_nan=False) + "\n"
    if str(target) == "-":
        sys.stdout.write(text)
        return
    with writing(target, "--json"):
        safe_files.replace_file(target, text.encode("ascii"), safe_files.SHARED)
