"""The scene that the editor's page shows of a mission file's text, even if the mission has faults."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from companion.config import MissionConfig
from companion.config.load import faults_of
from companion.config.reference import keys_of
from companion.config.sections.geographic_places import frame_of, local_section
from companion.config.sections.section_base import (
    DEGREES,
    LINE_DEGREES,
    LINE_METRES,
    METRES,
    UTM,
    Section,
    section_in,
)
from companion.config.source import Document, KeyPath
from companion.errors import ConfigError
from companion.frames import LocalFrame
from companion.ui.editor.text_edits import parsed, value_at

LISTS = (
    ("goals",),
    ("radars",),
    ("dynamic_threats",),
    ("obstacles",),
    ("glide", "fields"),
    ("glide", "people"),
)


@dataclass(frozen=True, slots=True)
class Scene:
    """A mission file's text as the page shows it.

    Parameters
    ----------
    mission : MissionConfig or None
        The mission; None while it is wrong.
    document : dict
        Elements with places in metres, other sections as written, and faults.
    """

    mission: MissionConfig | None
    document: dict[str, object]


def scene_of(text: str, file: str) -> Scene:
    """Return what a text says, and everything that is wrong with it.

    Parameters
    ----------
    text : str
        The mission file, which is YAML.
    file : str
        Name of the file; a map of heights lies beside it.
    """
    document = replace(parsed(text), file=file)
    mission, faults = faults_of(document)
    try:
        frame = frame_of(document)
    except ConfigError:
        frame = None
    data = document.data
    return Scene(
        mission,
        {
            "sections": _written_sections(data),
            "absent": [".".join(map(str, path)) for path in SECTIONS if value_at(data, path) is None],
            "optional": OPTIONAL,
            "bounds_m": _box(document, frame),
            "elements": list(_elements(document, frame)),
            "faults": [_fault(error) for error in faults],
        },
    )


def _written_sections(data: object) -> dict[str, object]:
    """Return the sections as written, by dotted path; '' holds the file's own values."""
    assert isinstance(data, dict)
    own = {
        key: entry
        for key, entry in data.items()
        if key in MissionConfig.model_fields and (key,) not in MODELS
    }
    found = {".".join(map(str, path)): value_at(data, path) for path in SECTIONS}
    return {"": as_json(own)} | {
        path: as_json(entry) for path, entry in found.items() if isinstance(entry, dict)
    }


def _sections() -> Iterator[tuple[KeyPath, type[Section]]]:
    """Yield each section and list of sections, with its model."""
    yield (), MissionConfig
    waiting: list[tuple[KeyPath, type[Section]]] = [((), MissionConfig)]
    for path, model in waiting:
        for key, field in model.model_fields.items():
            if (found := section_in(field.annotation)) is not None:
                yield (*path, key), found[0]
                waiting.append(((*path, key), found[0]))


MODELS = dict(_sections())
SECTIONS = [path for path in MODELS if path and path not in LISTS]
OPTIONAL = [
    ".".join(map(str, path))
    for path in SECTIONS
    if not MODELS[path[:-1]].model_fields[str(path[-1])].is_required()
]


def key_tables() -> dict[str, list[dict[str, str]]]:
    """Return the keys of each section by its dotted path, in words; '' is the file itself."""
    return {".".join(map(str, path)): keys_of(model) for path, model in MODELS.items()}


def _elements(document: Document, frame: LocalFrame | None) -> Iterator[dict[str, object]]:
    paths: list[KeyPath] = [("start",)] if isinstance(value_at(document.data, ("start",)), dict) else []
    for where in LISTS:
        entries = value_at(document.data, where)
        paths += [(*where, number) for number in range(len(entries) if isinstance(entries, tuple) else 0)]
    for path in paths:
        values = value_at(document.data, path)
        kind = ".".join(part for part in path if isinstance(part, str))
        yield {
            "path": path,
            "kind": kind,
            "name": _name(path, values),
            "values": as_json(values),
            "written": _way(values),
            "line": document.line_of(path),
            **_place(document, frame, path, values),
        }


def as_json(value: object) -> object:
    """Return a value of a mission file with all its digits; infinite numbers, which JSON has not, as text."""
    if isinstance(value, dict):
        return {key: as_json(entry) for key, entry in value.items()}
    if isinstance(value, tuple):
        return [as_json(entry) for entry in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def _name(path: KeyPath, values: object) -> str:
    """Return what an element is called."""
    name = values.get("name") if isinstance(values, dict) else None
    if isinstance(name, str) and name:
        return name
    return (
        str(path[0])
        if len(path) == 1
        else f"{str(path[-2]).removesuffix('s').replace('_', ' ')} {int(path[-1]) + 1}"
    )


def _way(values: object) -> str:
    """Return how an element's place is written."""
    keys = values.keys() if isinstance(values, dict) else ()
    if UTM in keys:
        return UTM
    is_degrees = any(key in DEGREES or str(key).endswith(LINE_DEGREES) for key in keys)
    return "degrees" if is_degrees else "metres"


def _place(document: Document, frame: LocalFrame | None, path: KeyPath, values: object) -> dict[str, object]:
    """Return an element's place and lines in metres; nothing that cannot be read as such."""
    where = tuple(part for part in path if isinstance(part, str))
    try:
        local = values if frame is None else local_section(document, frame, MODELS[where], path, values)
    except ConfigError:
        return {}
    if not isinstance(local, dict):
        return {}
    lines = {key: entry for key, entry in local.items() if key.endswith(LINE_METRES) and _are_places(entry)}
    point = [local.get(key) for key in METRES]
    if not _are_numbers(point):
        return lines
    up = local.get("up_m")
    return lines | {"place_m": [*point, up if _are_numbers([up]) else 0.0]}


def _box(document: Document, frame: LocalFrame | None) -> list[float] | None:
    """Return west, east, south, north, lowest and highest of the bounds; None if they are no such numbers."""
    section = value_at(document.data, ("bounds",))
    try:
        if frame is not None:
            section = local_section(document, frame, MODELS["bounds",], ("bounds",), section)
    except ConfigError:
        return None
    pairs = [section.get(key) for key in (*METRES, "up_m")] if isinstance(section, dict) else []
    numbers = [value for pair in pairs if isinstance(pair, tuple) for value in pair]
    return numbers if len(numbers) == 6 and _are_numbers(numbers) else None


def _are_places(line: object) -> bool:
    """Return whether a line is a list of pairs of numbers."""
    return isinstance(line, tuple) and all(
        isinstance(corner, tuple) and len(corner) == 2 and _are_numbers(corner) for corner in line
    )


def _are_numbers(values: Sequence[object]) -> bool:
    return all(type(value) in (int, float) and abs(value) < 1e7 for value in values)  # type: ignore[arg-type]


def _fault(error: ConfigError) -> dict[str, object]:
    """Return what is wrong, with the key's path."""
    path = [int(part) if part.isdecimal() else part for part in error.key.split(".")]
    return {
        "path": path,
        "line": error.line,
        "key": error.key,
        "got": error.value,
        "expected": error.expected,
    }
