"""``companion sitl``: a whole flight in the simulator, with live progress, a table and a report."""

from __future__ import annotations

import importlib.util
import logging
import math
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.live import Live
from rich.table import Table

from companion.cli import EXIT_FAILED
from companion.cli_options import (
    MissionFile,
    PageGround,
    PageListen,
    PagePort,
    PageToken,
    make_ready_with_bar,
    write_json,
)
from companion.run_places import FLIGHT, PURSUERS, WATCHED, offer
from companion.types.events import Dialect

if TYPE_CHECKING:  # Every command of companion loads this module, and most of them do not fly.
    from companion.config import MissionConfig
    from companion.ui.page.live_page import LivePage
    from .sitl import Flight
    from .team.team_flight import TeamFlight

REFRESH_S = 1.0  # Simulated time between two updates of the live table.

_log = logging.getLogger(__name__)


def register(app: typer.Typer) -> None:
    """Add the command to ``companion``, and the runners of flights and pursuers to its campaigns."""
    app.command("sitl")(sitl)
    offer("anytime", f"{__package__}.comparison.anytime_runs:AnytimeRunner")
    offer(FLIGHT, f"{__package__}.bench.offline_flight:flown")
    offer(WATCHED, f"{__package__}.bench.offline_flight:watched")
    offer("encounters", f"{__package__}.bench.encounter_flights:EncounterRunner")
    offer("flights", f"{__package__}.bench.campaign_runs:FlightRunner")
    offer(PURSUERS, f"{__package__}.bench.campaign_runs:driven")


def sitl(
    mission: MissionFile,
    speed: Annotated[
        float | None,
        typer.Option(min=0.0, help="Simulated seconds a second; 0 is as fast as it goes, as without a page."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of weather, sensors, tracks and plans.")] = 1,
    headless: Annotated[bool, typer.Option("--headless", help="No live table, no report.")] = False,
    autopilot: Annotated[
        Dialect, typer.Option(help="Whose mission semantics the simulator has.")
    ] = Dialect.ARDUPILOT,
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write measures and true paths here; - is standard output.")
    ] = None,
    flights: Annotated[Path, typer.Option(help="Folder of the flights' reports and recordings.")] = Path(
        "flights"
    ),
    aircraft: Annotated[
        int, typer.Option(min=1, max=16, help="As many fly as a team, every other one the other way.")
    ] = 1,
    page: PagePort = None,
    page_listen: PageListen = "",
    page_token: PageToken = "",
    page_ground: PageGround = None,
) -> None:
    """Fly a mission in the simulator; exit 0 only if the goal was reached without collision."""
    import asyncio

    from companion.config import load_mission, require_goals
    from companion.recording.retention import folder_for
    from companion.ui.page.live_page import page_of
    from .sitl import Flight

    if not headless and importlib.util.find_spec("matplotlib") is None:
        raise ModuleNotFoundError(
            name="matplotlib"
        )  # Raised before the flight, because the report after it needs the package.

    config = load_mission(mission)
    require_goals(config, str(mission))
    console = Console(stderr=json_file is not None and str(json_file) == "-")
    shown_on = page_of(page, page_listen, page_token, page_ground)
    folder = None if headless else folder_for(flights, config.name, datetime.now(UTC))
    logging.getLogger("companion.flight.tasks.app").setLevel(logging.WARNING)
    make_ready_with_bar(console)
    pace = _pace(speed, has_page=page is not None)
    if aircraft > 1:
        team = _team_of(config, aircraft, seed, autopilot, folder, pace)
        raise typer.Exit(_fly_team(team, shown_on, json_file, console))
    flight = Flight(
        config, seed, folder, autopilot, pace,
        mission_text=mission.read_text(encoding="utf-8-sig"),
    )  # fmt: skip
    if shown_on is not None:
        shown_on.follow(flight.recorder)
        console.print(f"page: {shown_on.address}", markup=False)
    if headless:
        logging.getLogger("companion.recording.recorder").setLevel(logging.WARNING)
        asyncio.run(flight.fly())
    else:
        with Live(_progress(flight), console=console, refresh_per_second=4, transient=True) as live:
            shown = 0.0

            def show(now: Flight) -> None:
                nonlocal shown
                if now.now_s - shown >= REFRESH_S:
                    shown = now.now_s
                    live.update(_progress(now))

            logging.getLogger("companion.recording.recorder").setLevel(logging.WARNING)
            asyncio.run(flight.fly(show))
    if json_file is not None:
        write_json(json_file, flight.document())
    console.print(_result(flight))
    if folder is not None:
        _write_report(flight, folder, console)
    if shown_on is not None:
        _keep_page(shown_on, console)
    if not flight.summary()["success"]:
        raise typer.Exit(EXIT_FAILED)


def _team_of(
    config: MissionConfig, num: int, seed: int, autopilot: Dialect, folder: Path | None, pace: float
) -> TeamFlight:
    """Return the flight of as many aircraft as a team."""
    from .team.team_flight import TeamFlight

    return TeamFlight(config, num, seed, autopilot, folder, speed=pace)


def _fly_team(team: TeamFlight, shown_on: LivePage | None, json_file: Path | None, console: Console) -> int:
    """Fly a team, and show the first member's view of it on a page; return the exit status."""
    from .team.team_command import fly_and_show

    if shown_on is not None:
        shown_on.follow(team.flights[0].recorder)
        console.print(f"page: {shown_on.address}", markup=False)
    is_success = fly_and_show(team, console)
    if json_file is not None:
        write_json(json_file, team.summary())
    if shown_on is not None:
        _keep_page(shown_on, console)
    return 0 if is_success else EXIT_FAILED


def _keep_page(shown_on: LivePage, console: Console) -> None:
    """Leave the page open after the flight until somebody interrupts."""
    from companion.ui.page.playback_page import wait_for_interrupt

    console.print(f"the flight is over; it stays on {shown_on.address} until Ctrl+C", markup=False)
    wait_for_interrupt()
    shown_on.close()


def _write_report(flight: Flight, folder: Path, console: Console) -> None:
    """Write the report and the picture of a flight, and say where they are."""
    from companion.config.compose import world_of
    from companion.ui.reports.report import write_report
    from .flight_record import record_of

    world = world_of(flight.mission, none_known=False)
    report, picture = write_report(folder, flight.mission, world, record_of(flight))
    console.print(f"report: {report}\npicture: {picture}\nrecording: {folder / 'flight.tlog'}")


def _pace(speed: float | None, *, has_page: bool) -> float:
    """Simulated seconds for each second: by default real time if the page is shown."""
    if speed is None:
        return 1.0 if has_page else math.inf
    return speed if speed > 0.0 else math.inf


def _progress(flight: Flight) -> Table:
    """Return the live table: the flight's position and the last decision."""
    table = Table(title=f"{flight.mission.name}, seed {flight.seed}", show_header=False, width=100)
    truth = flight.simulator.truth
    row = truth.path[-1]
    goal = flight.mission.goals[-1]
    left = ((row[1] - goal.east_m) ** 2 + (row[2] - goal.north_m) ** 2) ** 0.5
    table.add_row("simulated time", f"{flight.now_s:.0f} s")
    table.add_row("position", f"{row[1]:.0f} E  {row[2]:.0f} N  {row[3]:.0f} m up, {row[6]:.1f} m/s")
    table.add_row("to the goal", f"{left:.0f} m")
    if hasattr(flight, "app"):
        table.add_row("mode", f"{flight.simulator.autopilot.mode} / {flight.app.mode.value}")
        table.add_row("missions, plans", f"{flight.app.num_swaps}, {len(flight.recorder.plan_ms)}")
    for decision in flight.recorder.decisions[-5:]:
        table.add_row(f"{decision.stamp_s:.1f} s", f"{decision.kind}: {decision.text}"[:80])
    return table


def _result(flight: Flight) -> Table:
    """Return the summary table."""
    summary = flight.summary()
    verdict = "goal reached" if summary["success"] else "FAILED"
    table = Table(title=f"{flight.mission.name}, seed {flight.seed}: {verdict}")
    table.add_column("measure")
    table.add_column("value", justify="right")
    seconds = float(summary["seconds_in_reach_and_sight"])
    table.add_row("under threat", f"{seconds:.1f} s of {flight.now_s:.0f}" if seconds > 0.0 else "never")
    for key, value in summary.items():
        is_reported = not isinstance(value, float) or math.isfinite(value)
        table.add_row(key, str(value) if is_reported else "–")
    wall = flight.wall_s
    table.add_row("times real time", f"{flight.now_s / wall:.0f}" if wall > 0.0 else "-")
    return table
