"""The command line ``companion`` and its exit codes.

Exit codes: 0 success, 1 no safe plan or failed flight, 2 bad usage or configuration, 3 link failure,
4 internal error.
"""

from __future__ import annotations

import logging
import sys
import time
from dataclasses import asdict
from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.console import Console
from rich.logging import RichHandler
from typer.models import CommandInfo

from companion import __version__, plain_text
from companion.cli_options import (
    Force,
    GeojsonTarget,
    JsonFile,
    KmlTarget,
    MetricsPort,
    MissionFile,
    PageGround,
    PageListen,
    PagePort,
    PageToken,
    PlanTarget,
    Targets,
    make_ready_with_bar,
    write_json,
    writing,
)
from companion.config.conversion import mission_commands
from companion.errors import CompanionError, ConfigError
from companion.service.process.log_format import LogKind, PlainFormatter, set_up
from companion.ui.editor import register as register_editor

EXIT_FAILED = 1
RECORDING_SUFFIXES = (".mcap", ".tlog")
HEALTH_MAX = 10_000  # Bytes of an answer.
EXTRA_COMMANDS = "companion.commands"
# Packages that some commands need, and the extras that install them.
EXTRAS = {"matplotlib": "plot", "jsbsim": "sim", "distributed": "dask", "rerun": "rerun"}


app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)
console = Console()
_log = logging.getLogger("companion")


@app.callback(invoke_without_command=True)
def _version(
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
) -> None:
    """Plan safe paths online for a fixed-wing aircraft, on a companion computer of its autopilot."""
    if version:
        console.print(__version__)
        raise typer.Exit


@app.command()
def check(
    mission: MissionFile,
    json_file: JsonFile = None,
    items: Annotated[
        Path | None, typer.Option(help="An operator's mission, .plan or .waypoints: heights over ground.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Write a picture to this file.")] = None,
) -> None:
    """Validate a mission file, and print a summary of it."""
    from companion.config import load_mission, require_goals
    from companion.config.mission_summary import mission_summary, summary_parts

    if plot is not None:
        from companion.config import world_of
        from companion.ui.reports.plots import plot_mission

    config = load_mission(mission)
    heights, tables, line = dict[str, object](), list[object](), None
    if items is not None:
        from companion.config.conversion import items_over_ground as over_ground

        listed = over_ground.items_over_ground(items, config)
        heights["items_over_ground"] = over_ground.items_document(listed)
        tables.append(over_ground.items_table(listed, config))
        line = over_ground.line_of(listed, config)
    if json_file is not None:
        write_json(json_file, mission_summary(config) | heights)
    if json_file is None or str(json_file) != "-":
        for part in (*summary_parts(config), *tables):
            console.print(part)
    if plot is not None:
        require_goals(config, str(mission))
        with writing(plot, "--plot"):
            plot_mission(plot, config, world_of(config, none_known=False), line)


@app.command()
def plan(
    mission: MissionFile,
    method: Annotated[str | None, typer.Option(help="safe-rrt, a comparator or a plug-in.")] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Seed of the first run; later runs count up.")
    ] = None,
    runs: Annotated[int, typer.Option(min=1)] = 1,
    time_limit: Annotated[
        float | None, typer.Option(min=0.01, help="Time limit of a plan [s]; by default an iteration limit.")
    ] = None,
    json_file: JsonFile = None,
    plot: Annotated[Path | None, typer.Option(help="Write a picture of the first run to this file.")] = None,
    plan_file: PlanTarget = None,
    kml: KmlTarget = None,
    geojson: GeojsonTarget = None,
    force: Force = False,
) -> None:
    """Make one offline plan, or several, from the mission file's start."""
    from companion.config import load_mission, require_goals
    from companion.research.campaign.runs import plan_runs, result_of, results_table

    if plot is not None:
        from companion.ui.reports.plots import plot_plan

    config = load_mission(mission)
    require_goals(config, str(mission))
    snapshot, plans = plan_runs(
        config, method=method, first_seed=config.planning.seed if seed is None else seed, runs=runs,
        time_limit_s=time_limit, get_ready=lambda: make_ready_with_bar(Console(stderr=True)),
    )  # fmt: skip
    if json_file is not None:
        write_json(json_file, [result_of(entry, config) for entry in plans])
    if json_file is None or str(json_file) != "-":
        console.print(results_table(config.name, config.dimension, plans))
    if plot is not None:
        with writing(plot, "--plot"):
            plot_plan(plot, config, snapshot, plans[0])
    targets = Targets(plan_file, kml, geojson, force)
    if targets.is_any and plans[0].path is not None:
        said = mission_commands.export_plan(config, plans[0].path, targets)
        console.print(said, markup=False, soft_wrap=True)
    if not all(entry.reaches_goal for entry in plans):
        raise typer.Exit(EXIT_FAILED)


@app.command("warm-up")
def warm_up() -> None:
    """Compile the planner's kernels now, so that the first start of the service need not wait for it."""
    began = time.perf_counter()
    make_ready_with_bar(console)
    console.print(f"the planner's kernels are ready ({time.perf_counter() - began:.1f} s)")


@app.command()
def run(
    mission: MissionFile,
    link: Annotated[
        str,
        typer.Option(help="serial:///dev/ttyAMA0:921600, udpin://host:port, udpout://… or tcp://…"),
    ],
    record: Annotated[Path, typer.Option(help="Folder of the flights' recordings.")] = Path("flights"),
    metrics: MetricsPort = None,
    log: Annotated[LogKind, typer.Option(envvar="COMPANION_LOG", help="Format of the log.")] = LogKind.TEXT,
    record_max_mb: Annotated[
        int, typer.Option(min=1, help="Limit of all recordings; the oldest flights are deleted first.")
    ] = 2_000,
    page: Annotated[
        int | None,
        typer.Option(min=1, max=65535, envvar="COMPANION_PAGE", help="Port of the page that shows flights."),
    ] = None,
    page_listen: PageListen = "",
    page_token: PageToken = "",
    page_ground: PageGround = None,
) -> None:
    """Run the service until it is stopped."""
    import asyncio
    import gc

    gc.disable()  # What is imported stays: looking for garbage in it takes a twelfth of the start.
    from companion.service.process.service import serve

    gc.freeze()
    gc.enable()
    set_up(log)
    asyncio.run(
        serve(
            mission, link, record, metrics, record_max_mb * 1_000_000,
            page_port=page, page_host=page_listen, page_token=page_token, page_ground=page_ground,
        )
    )  # fmt: skip


@app.command()
def health(metrics: MetricsPort = None) -> None:
    """Ask the service on this computer for its health; exit 0 only if its planning loop runs."""
    if metrics is None:
        raise ConfigError("command line", None, "--metrics", "nothing", "the port that the service tells on")

    import http.client
    import urllib.error
    import urllib.request

    def body_of(answer: http.client.HTTPResponse | urllib.error.HTTPError) -> str:
        return plain_text.printable(answer.read(HEALTH_MAX).decode(errors="replace").strip())

    direct = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with direct.open(f"http://127.0.0.1:{metrics}/healthz", timeout=3.0) as answer:
            console.print(body_of(answer), markup=False, soft_wrap=True)
    except urllib.error.HTTPError as error:
        with error:
            console.print(body_of(error), markup=False, soft_wrap=True)
        raise typer.Exit(EXIT_FAILED) from None
    except (OSError, http.client.HTTPException) as error:
        console.print(
            plain_text.printable(f"no answer on port {metrics}: {error}"), markup=False, soft_wrap=True
        )
        raise typer.Exit(EXIT_FAILED) from None


@app.command()
def replay(
    log: Annotated[
        Path,
        typer.Argument(exists=True, help="A tlog or a flight's folder; its mcap is read, too."),
    ],
    mission: Annotated[
        Path | None, typer.Argument(help="A mission file, as in mission_configs; required without --page.")
    ] = None,
    expect: Annotated[
        Path | None,
        typer.Option(
            exists=True, file_okay=False, help="A flight's folder; exit 1 if decisions or missions differ."
        ),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Seed of plans; by default the recorded one.")
    ] = None,
    json_file: JsonFile = None,
    page: PagePort = None,
    beside: Annotated[
        Path | None,
        typer.Option(exists=True, help="A second recording for the page, shown next to the first."),
    ] = None,
    page_ground: PageGround = None,
) -> None:
    """Replay a recorded flight with the present code, and compare missions and decisions.

    With --page, show the flight in a browser, and with a mission file the replayed decisions next to it.
    """
    from companion.config import load_mission
    from companion.service.replay import replay_command as replaying

    config = None if mission is None else load_mission(mission)
    screen = Console(stderr=json_file is not None and str(json_file) == "-")
    logging.getLogger("companion").setLevel(logging.WARNING)
    if page is not None:
        replaying.show_page(log, config, beside, seed, (page, page_ground), screen)
        return
    if config is None:
        raise ConfigError("command line", None, "MISSION", "nothing", "a mission file, or --page")
    recording = replaying.replayable(log)
    expected = None if expect is None else replaying.replayable(expect)
    for remark in replaying.remarks(recording, config):
        screen.print(plain_text.printable(remark), markup=False, highlight=False, soft_wrap=True)
    result = replaying.replayed(recording, config, seed, screen)
    if expected is not None:
        recording, result = expected, replaying.compared_with(expected, result)
    if json_file is not None:
        write_json(json_file, replaying.document_of(recording, result))
    differs = replaying.first_difference(recording, result)
    replaying.show(recording, result, differs, screen)
    if expected is not None and differs is not None:
        raise typer.Exit(EXIT_FAILED)


@app.command()
def doctor(
    mission: Annotated[
        Path | None, typer.Argument(help="A mission file, whose requirements are checked.")
    ] = None,
    link: Annotated[
        str | None, typer.Option(help="URL of the autopilot's link; the service must not run meanwhile.")
    ] = None,
    seconds: Annotated[float, typer.Option(min=1.0, max=600.0, help="Time for measuring rates.")] = 10.0,
    record: Annotated[Path, typer.Option(help="Folder for recordings.")] = Path("flights"),
    json_file: JsonFile = None,
) -> None:
    """Check everything that the service needs; exit 1 for a failure, 3 without an autopilot."""
    import asyncio

    from companion.service.doctor.doctor_command import findings_table, run_checks

    findings, code = asyncio.run(run_checks(mission, link, seconds, record))
    if json_file is not None:
        write_json(json_file, [asdict(entry) | {"verdict": entry.verdict.value} for entry in findings])
    if json_file is None or str(json_file) != "-":
        console.print(findings_table(findings))
    if code:
        raise typer.Exit(code)


@app.command()
def report(
    flight: Annotated[Path, typer.Argument(exists=True, file_okay=False, help="A flight's folder.")],
) -> None:
    """Write the report of a flight from its recording."""
    from companion.service.replay import flight_summary
    from companion.ui.reports.report import write_report

    mission, world, record = flight_summary.flight_of(flight)
    with writing(flight, "report"):
        page, picture = write_report(flight, mission, world, record, flight_summary.report_name(record))
    console.print(
        f"report: {plain_text.printable(page)}\npicture: {plain_text.printable(picture)}",
        markup=False,
        soft_wrap=True,
    )


@app.command()
def export(
    flight: Annotated[Path, typer.Argument(exists=True, help="A flight's folder, tlog or mcap; or mission.")],
    target: Annotated[
        Path | None,
        typer.Argument(help="The file to write; with --rerun by default flight.rrd at the tlog."),
    ] = None,
    rerun: Annotated[
        bool, typer.Option("--rerun", help="Write a picture for rerun; the file ends in .rrd.")
    ] = False,
    plan: PlanTarget = None,
    kml: KmlTarget = None,
    geojson: GeojsonTarget = None,
    force: Force = False,
) -> None:
    """Export a recording for Foxglove or rerun; a flight or a mission for ground stations and maps."""
    targets = Targets(plan, kml, geojson, force)
    is_recording = flight.is_dir() or flight.suffix in RECORDING_SUFFIXES
    if is_recording and targets.is_any:
        from companion.service.replay import flight_summary

        mission, _, record = flight_summary.flight_of(flight if flight.is_dir() else flight.parent)
        said = mission_commands.export_flight(mission, record, targets)
    elif targets.is_any or flight.suffix == ".yaml":
        said = mission_commands.export_mission_file(flight, targets)
    else:
        from companion.service.replay import replay_command as replaying

        said = replaying.exported(flight, target, is_for_rerun=rerun)
    console.print(said, markup=False, soft_wrap=True)


@app.command()
def campaign(
    spec: Annotated[Path, typer.Argument(help="A campaign's file, as in campaigns.")],
    jobs: Annotated[int, typer.Option(min=1, help="Number of parallel processes.")] = 1,
    engine: Annotated[
        Literal["processes", "dask"], typer.Option(help="Local processes, or workers of a Dask scheduler.")
    ] = "processes",
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler, such as tcp://host:8786.")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue a campaign that was stopped.")] = False,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the rows; by default results/ and the campaign's name.")
    ] = None,
) -> None:
    """Plan or fly for all combinations of methods, missions, settings and seeds; each run gives a row."""
    from companion.research.evidence.evidence_commands import campaign_from_file

    if (engine == "dask") != (scheduler is not None):
        found, expected = scheduler or "nothing", "with --engine dask an address, else none"
        raise ConfigError("command line", None, "--scheduler", found, expected)
    campaign_from_file(spec, jobs=jobs, resumes=resume, folder=out, console=console, scheduler=scheduler)


@app.command()
def results(
    folder: Annotated[
        Path,
        typer.Argument(exists=True, file_okay=False, help="A campaign's folder; it may still be running."),
    ],
    keep: Annotated[Path | None, typer.Option(help="Also write the rows to this file, compressed.")] = None,
    page: Annotated[
        Path | None, typer.Option(help="Write only a page, to this file, from a folder of kept rows.")
    ] = None,
) -> None:
    """Evaluate a campaign's rows: tables with confidence intervals, as Markdown, CSV and HTML."""
    from companion.research.evidence.evidence_commands import results_in

    results_in(folder, console, keep=keep, page=page)


@app.command()
def identify(
    recordings: Annotated[
        list[Path], typer.Argument(exists=True, help="Folders of flights, or tlogs, all of one aircraft.")
    ],
    mission: Annotated[
        Path | None, typer.Option(help="Mission file of the flights, for a tlog without one.")
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """Estimate an aircraft's noise, turns and power from flights: keys to paste; exit 1 if data is short."""
    from companion.research.identification import identify_command as identifying

    flights, found = identifying.identify(recordings, mission)
    if json_file is not None:
        write_json(json_file, identifying.document_of(flights, found))
    if json_file is None or str(json_file) != "-":
        identifying.show(flights, found, console)
    if not found.has_any:
        raise typer.Exit(EXIT_FAILED)


def _not_installed(what: str, command: str, extra: str) -> ConfigError:
    """Return the error of a command that needs a package that is not installed."""
    return ConfigError(
        "companion", None, command, f"no {what} installed", f"pip install 'safe-rrt-companion[{extra}]'"
    )


def _without_simulator() -> None:
    """Raise the error of a missing simulator."""
    raise _not_installed("simulator", "sitl", "sim")


def _name_of(command: CommandInfo) -> str:
    """Return the name of a command, which typer takes from the function if none is given."""
    return command.name or str(getattr(command.callback, "__name__", ""))


mission_commands.register(app)
register_editor(app)
OWN_COMMANDS = frozenset(map(_name_of, app.registered_commands))


def _add_commands(called: str | None) -> None:
    """Add the commands that other packages contribute, unless ``called`` is one of :data:`OWN_COMMANDS`."""
    if called in OWN_COMMANDS:
        return
    names = set()
    for entry in entry_points(group=EXTRA_COMMANDS):
        try:
            entry.load()(app)
        except ImportError as error:
            _log.debug("%s: %s", entry.name, error)
            continue
        names.add(entry.name)
    if "sitl" not in names:
        app.command(
            "sitl",
            help="Fly a mission in the simulator (not installed).",
            context_settings={"ignore_unknown_options": True, "allow_extra_args": True},
        )(_without_simulator)


def _called() -> None:
    """Run the command, or report the extra that it lacks."""
    try:
        app()
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package not in EXTRAS:
            raise
        raise _not_installed(package, sys.argv[1], EXTRAS[package]) from None


def main() -> None:
    """Run a command; an error raised on purpose becomes one message and its exit code."""
    handler = RichHandler(console=Console(stderr=True), show_path=False, show_time=False, show_level=False)
    handler.setFormatter(PlainFormatter())
    logging.basicConfig(level=logging.INFO, handlers=[handler])
    _add_commands(sys.argv[1] if len(sys.argv) > 1 else None)
    try:
        _called()
    except CompanionError as error:
        Console(stderr=True, soft_wrap=True).print(
            f"error: {plain_text.printable(error)}", style="red", markup=False, highlight=False
        )
        sys.exit(error.exit_code)
    except Exception:
        _log.exception("internal error")
        sys.exit(CompanionError.exit_code)
