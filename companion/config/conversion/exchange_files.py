"""Imports files into a mission file, exports a mission file, and writes a new one from a few answers."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

from companion import safe_files
from companion.cli_options import Targets
from companion.config import MissionConfig, load_mission, mission_from_text
from companion.config.conversion.formats.foreign_file import foreign_bytes, reader_of
from companion.config.conversion.formats.geojson_file import feature_collection, take_geojson
from companion.config.conversion.formats.gpx_file import take_gpx
from companion.config.conversion.formats.kml_file import kml_bytes, take_kml, take_kmz
from companion.config.conversion.formats.plan_file import plan_document, take_plan
from companion.config.conversion.formats.radar_table import take_radar_table
from companion.config.conversion.formats.waypoint_file import take_waypoints
from companion.config.conversion.found_places import Importer, Kind
from companion.config.conversion.mission_composition import Wishes, composed
from companion.config.conversion.mission_places import places_of
from companion.config.conversion.mission_text import remarks_of, text_of_mission
from companion.config.conversion.path_lines import PathLine
from companion.errors import ConfigError

READERS: dict[str, Callable[[Importer, bytes], None]] = {
    ".plan": take_plan,
    ".waypoints": take_waypoints,
    ".txt": take_waypoints,
    ".kml": take_kml,
    ".kmz": take_kmz,
    ".geojson": take_geojson,
    ".json": take_geojson,
    ".gpx": take_gpx,
    ".csv": take_radar_table,
}
EXAMPLES = """\
# Further sections, to copy from; docs/mission-file.md has every key.
# radars:
#   - {name: radar_1, latitude_deg: 0.0, longitude_deg: 0.0, up_m: 20, max_threat_radius_m: 500}
# obstacles:
#   - {name: hall, polygon_lat_lon_deg: [[0.0, 0.0], [0.0, 0.0], [0.0, 0.0]], base_m: 0, top_m: 40}
"""


def taken(path: Path, default_kind: Kind | None = None) -> Importer:
    """Return what a file has, by the ending of its name.

    Parameters
    ----------
    path : Path
        The file.
    default_kind : Kind or None
        Kind of the places of which the file does not say it.

    Raises
    ------
    ConfigError
        If it is of an unknown kind, cannot be read, or is wrong.
    """
    reader = reader_of(path, READERS)
    importer = Importer(path.name, default_kind)
    reader(importer, foreign_bytes(path))
    if not importer.places:
        importer.remark("file", "nothing of it is taken")
    return importer


def imported(
    files: Sequence[Path],
    wishes: Wishes,
    default_kind: Kind | None = None,
    tell: Callable[[Sequence[str]], None] | None = None,
) -> str:
    """Return the text of a mission file made of other files; it is valid, and has remarks at its top.

    Parameters
    ----------
    files : sequence of Path
        The files; goals are reached in their order.
    wishes : Wishes
        What the user says beside them.
    default_kind : Kind or None
        Kind of the places of which a file does not say it.
    tell : callable, optional
        Called with all remarks, before an error as well: what was left out may be what is missing.

    Raises
    ------
    ConfigError
        If a file is wrong, something is missing, or the places contradict each other.
    """
    importers = [taken(path, default_kind) for path in files]
    names = ", ".join(importer.file for importer in importers)
    remarks: Sequence[str] = [remark for importer in importers for remark in importer.remarks]
    try:
        head = (f"Made by companion import of {names}.",)
        text = text_of_mission(composed(importers, wishes), wishes, f"Imported from {names}", head)
        remarks = remarks_of(text)
        check_text(text, names)
    finally:
        if tell is not None:
            tell(remarks)
    return text


def check_text(text: str, source: str) -> MissionConfig:
    """Return the mission of a text that was made here.

    Raises
    ------
    ConfigError
        If it is not valid; the error names the source, since no file was written.
    """
    try:
        return mission_from_text(text, "mission")
    except ConfigError as error:
        raise ConfigError(source, None, error.key, error.value, error.expected) from None


def written_new(path: Path, data: bytes, *, replaces: bool) -> None:
    """Write a file that does not exist yet, whole or not at all.

    Parameters
    ----------
    path : Path
        The file.
    data : bytes
        Content.
    replaces : bool
        True to replace an existing file.

    Raises
    ------
    ConfigError
        If it exists, or cannot be written.
    """
    if not replaces and (path.exists() or path.is_symlink()):
        raise ConfigError(str(path), None, "file", "a file that exists", "a new name, or --force")
    try:
        safe_files.replace_file(path, data, safe_files.SHARED)
    except OSError as error:
        reason = error.strerror or str(error)
        raise ConfigError(str(path), None, "file", reason, "a file to write") from None


def import_files(
    files: Sequence[Path],
    target: Path,
    wishes: Wishes,
    default_kind: Kind | None,
    tell: Callable[[Sequence[str]], None],
    *,
    replaces: bool,
) -> MissionConfig:
    """Import files into a mission file, and return the mission.

    Parameters
    ----------
    files : sequence of Path
        The files.
    target : Path
        The mission file to write.
    wishes : Wishes
        What the user says beside them.
    default_kind : Kind or None
        Kind of the places of which a file does not say it.
    tell : callable
        Called with what was not taken, or taken otherwise than it was found.
    replaces : bool
        True to replace an existing mission file.

    Raises
    ------
    ConfigError
        If a file is wrong, something is missing, or the file cannot be written.
    """
    text = imported(files, wishes, default_kind, tell)
    written_new(target, text.encode(), replaces=replaces)
    return check_text(text, str(target))


def export_mission(mission: Path, targets: Targets) -> list[str]:
    """Export the places of a mission file, and return a line for each file and for what is not in it.

    Parameters
    ----------
    mission : Path
        The mission file.
    targets : Targets
        The files to write.

    Raises
    ------
    ConfigError
        If the mission is wrong, or a file cannot be written.
    """
    config = load_mission(mission)
    said = export_places(config, targets)
    if config.goals_from_autopilot:
        said.append("goals: none, since they are in the autopilot")
    return [
        *said,
        "vehicle, planning and other settings are not exported; companion import --like brings them back",
    ]


def export_places(
    config: MissionConfig,
    targets: Targets,
    lines: Sequence[PathLine] = (),
    waypoints: PathLine | None = None,
) -> list[str]:
    """Write the places of a mission and lines; return a line of text for each file.

    Parameters
    ----------
    config : MissionConfig
        The mission.
    targets : Targets
        The files.
    lines : sequence of PathLine
        Paths beside the places, in KML and GeoJSON.
    waypoints : PathLine, optional
        Waypoints in place of the goals, in the plan.

    Raises
    ------
    ConfigError
        If a file cannot be written.
    """
    places, said = places_of(config), []
    also = f", {lines[0].name}" if lines else ""
    if len(lines) > 1:
        also += f" and {len(lines) - 1} missions"
    if targets.plan is not None:
        document = plan_document(places, waypoints)
        written_new(targets.plan, _json(document), replaces=targets.replaces)
        kept = "waypoints of the path" if waypoints is not None else "the rest under a key of its own"
        said.append(f"{targets.plan}: mission, fence (bounds, obstacles) and rally points; {kept}")
    if targets.kml is not None:
        written_new(targets.kml, kml_bytes(places, config.name, lines), replaces=targets.replaces)
        said.append(f"{targets.kml}: all places{also}")
    if targets.geojson is not None:
        written_new(targets.geojson, _json(feature_collection(places, lines)), replaces=targets.replaces)
        said.append(f"{targets.geojson}: all places{also}")
    return said


def _json(document: object) -> bytes:
    return (json.dumps(document, indent=1, allow_nan=False) + "\n").encode("ascii")


def new_mission(wishes: Wishes, goal: tuple[float, float]) -> str:
    """Return the text of a mission file from home to one goal.

    Parameters
    ----------
    wishes : Wishes
        Home, aircraft, name and height.
    goal : tuple of float
        Latitude and longitude of the goal [deg].

    Raises
    ------
    ConfigError
        If the answers do not make a mission.
    """
    importer = Importer("command line")
    values = {"up_m": wishes.height_m}
    importer.add(Kind.GOAL, [goal], "", values, "--goal")
    description = f"From home to one goal, by companion new with the aircraft {wishes.aircraft}"
    head = ("Made by companion new. companion check tells what it means; companion sitl flies it.",)
    text = text_of_mission(composed([importer], wishes), wishes, description, head) + EXAMPLES
    check_text(text, "command line")
    return text
