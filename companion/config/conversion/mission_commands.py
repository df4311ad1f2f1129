"""``companion import`` and ``companion new``: a mission file of one's own.

Every command of companion loads this module; what reads and composes is imported by the commands themselves.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeVar

import typer
from rich.console import Console

from companion.cli_options import Force, Targets
from companion.errors import ConfigError
from companion.plain_text import printable

if TYPE_CHECKING:
    from companion.config import MissionConfig
    from companion.types.path import Path as PlannedPath
    from companion.types.record import FlightRecord

Answer = TypeVar("Answer")
Aircraft = Annotated[
    Literal["slow", "medium", "fast"] | None,
    typer.Option(help="slow: 14 m/s, turns of 30 m; medium: 25 m/s, 125 m; fast: 35 m/s, 150 m."),
]
Name = Annotated[str | None, typer.Option(help="Name of the mission; by default the file's.")]
_HOME_WORDS = "LATITUDE,LONGITUDE,ALTITUDE, in degrees and metres above the sea"
_GOAL_WORDS = "LATITUDE,LONGITUDE, in degrees"
_LIMITS = ((-90.0, 90.0), (-180.0, 180.0), (-500.0, 9_000.0))


def register(app: typer.Typer) -> None:
    """Add the commands to ``companion``."""
    app.command("import")(import_)
    app.command("new")(new)


def import_(
    files: Annotated[
        list[Path], typer.Argument(help=".plan, .waypoints, .kml, .kmz, .geojson, .gpx, or .csv of radars.")
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="The mission file to write.")],
    home: Annotated[
        str | None, typer.Option(help=f"Home in place of that in the files: {_HOME_WORDS}.")
    ] = None,
    aircraft: Aircraft = None,
    like: Annotated[
        Path | None, typer.Option(help="A mission file, from which all comes that the files do not have.")
    ] = None,
    kind: Annotated[
        str | None,
        typer.Option(help="Kind of places of which a file does not say it, such as obstacle or fence."),
    ] = None,
    height: Annotated[
        float, typer.Option(min=1.0, max=20_000.0, help="Height over home in metres where no file says one.")
    ] = 100.0,
    goals_from_autopilot: Annotated[
        bool, typer.Option("--goals-from-autopilot", help="Leave the goals to the mission in the autopilot.")
    ] = False,
    name: Name = None,
    force: Force = False,
) -> None:
    """Make a mission file of plans, maps and tables, several merged; tells what it cannot take."""
    from companion.config import load_mission
    from companion.config.conversion.exchange_files import import_files
    from companion.config.conversion.found_places import WORDS, kind_named
    from companion.config.conversion.mission_composition import Wishes
    from companion.config.conversion.mission_text import mission_name

    default_kind = None if kind is None else kind_named(kind)
    if kind is not None and default_kind is None:
        raise ConfigError("command line", None, "--kind", kind, f"one of {', '.join(WORDS)}")
    wishes = Wishes(
        name=mission_name(name or output.stem),
        aircraft=aircraft or "medium",
        like=None if like is None else load_mission(like),
        home=None if home is None else _home(home),
        height_m=height,
        goals_from_autopilot=goals_from_autopilot,
    )

    def tell(remarks: Sequence[str]) -> None:
        _tell(Console(stderr=True), [f"remark: {remark}" for remark in remarks])

    mission = import_files(files, output, wishes, default_kind, tell, replaces=force)
    goals = "goals in the autopilot" if mission.goals_from_autopilot else f"{len(mission.goals)} goals"
    counts = f"{goals}, {len(mission.obstacles)} obstacles, {len(mission.radars)} radars"
    _tell(Console(), [f"{output}: {counts}, {len(mission.dynamic_threats)} moving threats"])


def new(
    mission: Annotated[Path, typer.Argument(help="The mission file to write.")],
    home: Annotated[str | None, typer.Option(help=f"Home: {_HOME_WORDS}.")] = None,
    aircraft: Aircraft = None,
    goal: Annotated[str | None, typer.Option(help=f"Goal: {_GOAL_WORDS}.")] = None,
    height: Annotated[
        float | None, typer.Option(min=1.0, max=20_000.0, help="Height of the flight over home in metres.")
    ] = None,
    name: Name = None,
    force: Force = False,
) -> None:
    """Write a mission file from a few answers; each question has an option."""
    from companion.config.conversion.exchange_files import new_mission, written_new
    from companion.config.conversion.mission_composition import Wishes
    from companion.config.conversion.mission_text import mission_name

    place = _answer("--home", home, f"Home ({_HOME_WORDS})", _home)
    chosen = _answer(
        "--aircraft", aircraft, "Aircraft (slow 14, medium 25, fast 35 m/s)", _aircraft, "medium"
    )
    target = _answer("--goal", goal, f"Goal ({_GOAL_WORDS})", _goal)
    above = _answer("--height", height, "Height of the flight over home (m)", _height, "100")
    wishes = Wishes(mission_name(name or mission.stem), chosen, None, place, above)
    written_new(mission, new_mission(wishes, target).encode(), replaces=force)
    _tell(Console(), [f"{mission}: written; companion check {mission} tells what it means"])


def export_mission_file(mission: Path, targets: Targets) -> str:
    """Export the places of a mission file, and return what was written, for ``companion export``.

    Raises
    ------
    ConfigError
        If no format is asked for, the mission is wrong, or a file cannot be written.
    """
    if not targets.is_any:
        expected = "--plan, --kml or --geojson with a file to write, since a mission file is exported"
        raise ConfigError("command line", None, "export", "none of its options", expected)
    from companion.config.conversion.exchange_files import export_mission

    return _text_of(export_mission(mission, targets))


def export_flight(mission: MissionConfig, record: FlightRecord, targets: Targets) -> str:
    """Export a flight: flown path, missions, and the places of its mission file; return what was written.

    The plan has the waypoints of the last mission that was flown.

    Raises
    ------
    ConfigError
        If a plan is asked for and no mission of the service was flown, or a file cannot be written.
    """
    from companion.config.conversion.exchange_files import export_places
    from companion.config.conversion.path_lines import flown_lines, mission_lines

    missions = mission_lines(mission, record)
    if targets.plan is not None and not missions:
        raise ConfigError("command line", None, "--plan", "no mission of the service", "a flight with one")
    lines, last = (*flown_lines(mission, record), *missions), missions[-1] if missions else None
    return _text_of(export_places(mission, targets, lines, last))


def export_plan(mission: MissionConfig, path: PlannedPath, targets: Targets) -> str:
    """Export a planned path with the places of its mission file; return what was written.

    Raises
    ------
    ConfigError
        If a file cannot be written.
    """
    from companion.config.conversion.exchange_files import export_places
    from companion.config.conversion.path_lines import line_of, waypoints_of_plan

    line = line_of(mission, "planned path", path.positions_enu_m)
    waypoints = line_of(mission, "waypoints", waypoints_of_plan(path))
    return _text_of(export_places(mission, targets, [line], waypoints))


def _text_of(lines: Sequence[str]) -> str:
    return "\n".join(map(printable, lines))


def _tell(console: Console, lines: Sequence[str]) -> None:
    for line in lines:
        console.print(printable(line), markup=False, highlight=False, soft_wrap=True)


def _answer(
    option: str, given: object, question: str, read: Callable[[str], Answer], usual: str | None = None
) -> Answer:
    """Return what an option says, or else the answer to a question, which is asked again if it is wrong."""
    if given is not None:
        return read(str(given))

    def checked(text: str) -> Answer:
        try:
            return read(text)
        except ConfigError as error:
            raise typer.BadParameter(f"expected {error.expected}") from None

    try:
        answer: Answer = typer.prompt(question, default=usual, value_proc=checked)
    except typer.Abort:
        if sys.stdin.isatty():
            raise
        raise ConfigError("command line", None, option, "nothing", question) from None
    return answer


def _numbers(option: str, text: str, count: int, expected: str) -> tuple[float, ...]:
    try:
        numbers = tuple(float(part) for part in text.replace(",", " ").split())
    except ValueError:
        numbers = ()
    limits = _LIMITS[:count]
    are_good = len(numbers) == count and all(
        low <= number <= high for number, (low, high) in zip(numbers, limits, strict=True)
    )
    if not are_good:
        raise ConfigError("command line", None, option, text or "nothing", expected)
    return numbers


def _home(text: str) -> tuple[float, float, float]:
    latitude, longitude, altitude = _numbers("--home", text, 3, _HOME_WORDS)
    return latitude, longitude, altitude


def _goal(text: str) -> tuple[float, float]:
    latitude, longitude = _numbers("--goal", text, 2, _GOAL_WORDS)
    return latitude, longitude


def _aircraft(text: str) -> str:
    if text.strip() not in ("slow", "medium", "fast"):
        raise ConfigError("command line", None, "--aircraft", text, "slow, medium or fast")
    return text.strip()


def _height(text: str) -> float:
    try:
        height = float(text)
    except ValueError:
        height = 0.0
    if not 1.0 <= height <= 20_000.0:
        raise ConfigError("command line", None, "--height", text, "a number from 1 to 20000 (metres)")
    return height
