"""``companion replay`` and ``companion export``: progress, results as text, and files."""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from companion.config import MissionConfig, mission_from_text
from companion.config.load import text_of
from companion.errors import ConfigError, RecordError
from companion.plain_text import printable
from companion.recording.foxglove_export import export_flight
from companion.recording.reader import Recording, load_recording
from companion.recording.recorder import TLOG, Listener, versions_now
from companion.recording.rerun_export import export_rerun
from companion.service.replay.comparison import Difference, document_of, first_difference
from companion.service.replay.engine import Replay, Replayed, flown_uploads
from companion.types.record import Decision
from companion.ui.page.ground import ground_at
from companion.ui.page.playback import Playback, mcap_of, recorded_playback
from companion.ui.page.playback_page import show_playbacks

__all__ = [
    "compared_with", "document_of", "exported", "first_difference", "remarks", "replayable", "replayed",
    "show", "show_page",
]  # fmt: skip

DECISIONS_SHOWN = 60
RERUN_SUFFIX = ".rrd"  # The viewer recognises its files by this suffix.


def replayed(
    recording: Recording,
    mission: MissionConfig,
    seed: int | None,
    screen: Console,
    listener: Listener | None = None,
) -> Replayed:
    """Replay to the end, with a progress bar.

    Parameters
    ----------
    recording : Recording
        The recorded flight.
    mission : MissionConfig
        Mission file, which may differ from the recorded one.
    seed : int or None
        Seed of plans and filters; None for the recorded one.
    screen : Console
        Console of the progress bar.
    listener : callable, optional
        Gets each message recorded in the replay.
    """
    bar = Progress(
        TextColumn("replaying {task.fields[name]}"), BarColumn(), TaskProgressColumn(),
        TextColumn("{task.completed:.0f} s"), TimeRemainingColumn(), console=screen, transient=True,
    )  # fmt: skip
    with bar:
        task = bar.add_task("replay", name=recording.name, total=recording.duration_s)
        replay = Replay(recording, mission, seed)
        if listener is not None:
            replay.listen(listener)
        return asyncio.run(replay.run(lambda done_s: bar.update(task, completed=done_s)))


def replayable(log: Path) -> Recording:
    """Read a recording for a replay, from a tlog or a flight's folder.

    Raises
    ------
    RecordError
        If it cannot be read, or contains no MAVLink frame.
    """
    file = log / TLOG if log.is_dir() else log
    recording = load_recording(file)
    if not recording.frames:
        raise RecordError(f"{file}: no frame of MAVLink in it")
    return recording


def remarks(recording: Recording, mission: MissionConfig) -> list[str]:
    """Return remarks on why a replay may differ from the flight."""
    if not recording.is_ours:
        return []
    about, said = recording.about, []
    if not about:
        return [
            f"No flight.mcap beside {recording.name} can be read: seed and instants of plans are not known."
        ]
    with contextlib.suppress(ConfigError):
        flown = mission_from_text(str(about.get("mission_file", "")), recording.name)
        if flown != mission:
            said.append(f"The mission file is not the one flown, of {flown.name}.")
    versions = about.get("versions")
    kept = versions if isinstance(versions, dict) else {}
    others = [
        f"{name} {kept[name]} (now {now})"
        for name, now in versions_now().items()
        if kept.get(name, now) != now
    ]
    if others:
        said.append(f"Flown with {', '.join(others)}.")
    if recording.until_s < math.inf:
        said.append(f"flight.mcap ends early: compared up to {recording.until_s:.1f} s.")
    return said


def exported(flight: Path, target: Path | None, *, is_for_rerun: bool) -> str:
    """Write the picture of a recording for Foxglove or rerun; returns a text about the files.

    Parameters
    ----------
    flight : Path
        Folder of the flight, its ``flight.mcap``, or its tlog.
    target : Path or None
        The picture; None, for rerun only, writes it next to the recording.
    is_for_rerun : bool
        True for rerun, false for Foxglove.

    Raises
    ------
    ConfigError
        If the target for Foxglove is missing, or the name is one of the other viewer.
    ModuleNotFoundError
        If rerun is not installed.
    RecordError
        If there is nothing to show, or the target cannot be written.
    """
    source = mcap_of(flight)
    picture = source.with_suffix(RERUN_SUFFIX) if target is None and is_for_rerun else target
    if picture is None:
        raise ConfigError("command line", None, "TARGET", "nothing", "a file to write, or --rerun")
    if (picture.suffix == RERUN_SUFFIX) != is_for_rerun:
        expected = f"a name that ends in {RERUN_SUFFIX} with --rerun, and only then"
        raise ConfigError("command line", None, "TARGET", printable(picture.name), expected)
    if is_for_rerun:
        export_rerun(source, picture)
        return f"picture: {printable(picture)}"
    return f"picture: {printable(picture)}\nlayout: {printable(export_flight(source, picture))}"


def show_page(
    log: Path,
    mission: MissionConfig | None,
    other: Path | None,
    seed: int | None,
    page: tuple[int, Path | None],
    screen: Console,
) -> None:
    """Show a recording in a browser until interrupted.

    Parameters
    ----------
    log : Path
        A flight's folder, or a tlog; without an mcap of the same name only the replay is shown.
    mission : MissionConfig or None
        Mission file of a replay to show next to the recording.
    other : Path or None
        Another recording to show next to it.
    seed : int or None
        Seed of plans and filters; None for the recorded one.
    page : tuple of int and Path or None
        TCP port of the page; file or folder of the terrain under its map.
    screen : Console
        Console that shows the page's address.

    Raises
    ------
    RecordError
        If there is nothing to show.
    LinkError
        If the port is in use.
    ConfigError
        If a terrain file cannot be used.
    """
    port, ground = page[0], ground_at(page[1])
    shown = [
        recorded_playback(path)
        for path in ([log] if other is None else [log, other])
        if _shows_as_flown(path, mission)
    ]
    if mission is not None:
        recording = replayable(log)
        now = Playback(f"what would be decided now, by {mission.name}")
        now.begin(recording.start_us * 1e-6, text_of(mission))
        replayed(recording, mission, seed, screen, now.tell)
        shown.append(now)
    show_playbacks(
        shown, port, lambda address: screen.print(f"page: {address} - until Ctrl+C", markup=False), ground
    )


def _shows_as_flown(path: Path, mission: MissionConfig | None) -> bool:
    """Return whether to show a recording as flown; a tlog alone is only replayed if possible."""
    return mission is None or path.is_dir() or path.with_suffix(".mcap").exists()


def compared_with(expected: Recording, result: Replayed) -> Replayed:
    """Return a result that is compared with another flight than the replayed one."""
    return replace(result, flown_decisions=expected.decisions, flown_uploads=flown_uploads(expected))


def show(recording: Recording, result: Replayed, differs: Difference | None, screen: Console) -> None:
    """Print the result of a replay."""
    speed = result.duration_s / result.wall_s if result.wall_s > 0.0 else 0.0
    screen.print(
        f"{printable(recording.name)}: {result.duration_s:.0f} s replayed in {result.wall_s:.1f} s, "
        f"{speed:.0f} times real time",
        markup=False,
    )
    for reason, number in sorted(result.counters.items()):
        if reason != "accepted":
            screen.print(f"  {number} {reason.replace('_', ' ')}", markup=False)
    num_decisions, num_missions = (
        sum(entry.stamp_s <= recording.until_s for entry in entries)
        for entries in (result.decisions, result.uploads)
    )
    if differs is None:
        screen.print(f"as flown: {num_decisions} decisions, {num_missions} missions")
        return
    if recording.is_ours:
        screen.print(f"first difference {printable(differs)}", markup=False, highlight=False)
        screen.print("The aircraft flew on as recorded; from there on this is what would have been decided.")
        since = differs.stamp_s - 1e-6
    else:
        screen.print("No decision is recorded; this is what would have been decided.")
        since = -1.0
    screen.print(_table(result, since))


def _table(result: Replayed, since_s: float) -> Table:
    """Return a table of decisions from an instant on, flown and replayed, by time."""
    table = Table()
    table.add_column("time [s]", justify="right")
    for column in ("flown", "now"):
        table.add_column(column)
    rows = list(_by_time(result.flown_decisions, result.decisions, since_s))
    for stamp, flown, now in rows[:DECISIONS_SHOWN]:
        table.add_row(f"{stamp:.1f}", Text(flown), Text(now))
    if len(rows) > DECISIONS_SHOWN:
        table.add_row("…", "", f"{len(rows) - DECISIONS_SHOWN} more; --json has all")
    return table


def _by_time(
    flown: Sequence[Decision], now: Sequence[Decision], since_s: float
) -> Iterator[tuple[float, str, str]]:
    """Yield time, flown decisions and replayed decisions; simultaneous ones share a row."""
    rows: dict[float, list[list[str]]] = {}
    for column, decisions in enumerate((flown, now)):
        for entry in decisions:
            if entry.stamp_s >= since_s:
                cells = rows.setdefault(round(entry.stamp_s, 2), [[], []])
                cells[column].append(printable(f"{entry.kind}: {entry.text}"))
    for stamp, (one, other) in sorted(rows.items()):
        yield stamp, "\n".join(one), "\n".join(other)
