"""Writes the reference page of the mission file from its models, for ``make docs``."""

from __future__ import annotations

import ast
import functools
import inspect
import itertools
import sys
import textwrap
import types
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from companion.config.models import MissionConfig
from companion.config.sections.section_base import Section, instead_of_metres, section_in

UNITS = {
    "_m_s2": "m/s²", "_rad_s": "rad/s", "_per_m": "1/m", "_m_s": "m/s", "_hz": "Hz", "_deg": "°",
    "_enu_m": "m", "_j_m": "J/m", "_m": "m", "_s": "s", "_wh": "Wh", "_w": "W",
}  # fmt: skip
INTRODUCTION = """\
# The mission file

One YAML file describes a mission: where the aircraft flies, its performance, its threats, and what the
service may do. `companion check FILE` validates it and prints a summary; `--plot` draws it. An error names
the file, the line, the key, the value and what was expected. Keys end in their units. Lengths are metres
east, north and up of the origin; courses are degrees clockwise from north. An unknown key is an error, so
that no misspelt key is ignored. `mission_configs/first-flight.yaml` is a template, `companion new` writes a
file from four answers, and `companion import` makes one of [what you have](own-mission.md).

This page is made from the code that validates the file (`make docs`).

## Places

A place may be written in three ways, mixed within a file as one likes. They are converted when the file is
loaded, with the file's `origin`; a place must lie within 200 km of it. Heights (`up_m`, `base_m`, `top_m`)
are always metres above the origin.

| a place | written as |
|---|---|
| metres | `{east_m: 1750, north_m: 750}` |
| degrees, WGS84 | `{latitude_deg: -35.356499, longitude_deg: 149.184484}` |
| UTM, WGS84 | `{utm: {zone: 55H, easting_m: 698485, northing_m: 6085231}}` |
| corners of a polygon | `polygon_lat_lon_deg: [[-35.3538, 149.1762], …]` in place of `polygon_enu_m` |
| points of a route | `route_lat_lon_deg: [[-35.3538, 149.1762], …]` in place of `route_enu_m` |

The letter of a UTM zone is that of its band, from C in the south to X in the north. `bounds` may have
`latitude_deg: [south, north]` and `longitude_deg: [west, east]`: they become the largest box east and north
that lies within these parallels and meridians.
"""


@functools.cache
def meanings(model: type[Section]) -> dict[str, str]:
    """Return the text below each key of a section, on one line."""
    (section,) = ast.parse(textwrap.dedent(inspect.getsource(model))).body
    assert isinstance(section, ast.ClassDef)
    return {
        key.target.id: " ".join(str(text.value.value).split())
        for key, text in itertools.pairwise(section.body)
        if isinstance(key, ast.AnnAssign) and isinstance(key.target, ast.Name)
        if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
    }


def reference() -> str:
    """Return the page in Markdown."""
    parts = [INTRODUCTION, *_section("", MissionConfig)]
    return "\n".join(parts).rstrip() + "\n"


def keys_of(model: type[Section]) -> list[dict[str, str]]:
    """Return the keys of a section that hold values, in words: key, unit, allowed, default and meaning."""
    return [
        {
            "key": name,
            "unit": _unit(name),
            "allowed": _type(field.annotation, list(field.metadata)),
            "default": _default(field),
            "meaning": meanings(model)[name],
        }
        for name, field in model.model_fields.items()
        if section_in(field.annotation) is None
    ]


def _section(path: str, model: type[Section]) -> list[str]:
    """Return heading, description and table of a section, then those of the sections in it."""
    words = " ".join((model.__doc__ or "").split()).replace("``", "`")
    lines = [f"## {path}" if path else "## The file itself", "", words, ""]
    lines += ["| key | unit | allowed | default | meaning |", "|---|---|---|---|---|"]
    inner: list[tuple[str, type[Section]]] = []
    for name, field in model.model_fields.items():
        found = section_in(field.annotation)
        where = f"{path}.{name}" if path else name
        if found is not None:
            inner.append((where, found[0]))
        meaning = meanings(model)[name]
        cells = (f"`{name}`", _unit(name), _allowed(field, found, where), _default(field), meaning)
        lines.append("| " + " | ".join(cells) + " |")
    if instead_of_metres(model):
        keys = ", ".join(f"`{key}`" for key in instead_of_metres(model))
        lines += ["", f"In place of metres east and north: {keys}; see [Places](#places)."]
    lines.append("")
    for where, found_model in inner:
        lines += _section(where, found_model)
    return lines


def _unit(name: str) -> str:
    return next((unit for suffix, unit in UNITS.items() if name.endswith(suffix)), "")


def _allowed(field: FieldInfo, found: tuple[type[Section], bool] | None, where: str) -> str:
    if found is not None:
        anchor = where.replace(".", "")
        return f"{'list of sections' if found[1] else 'section'}, see [{where}](#{anchor})"
    return _type(field.annotation, list(field.metadata))


def _type(annotation: Any, metadata: list[Any]) -> str:  # noqa: ANN401
    """Describe the values that a key accepts."""
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _type(inner[0], [*inner[1:], *metadata])
    if origin is Literal:
        return " or ".join(f"`{value}`" for value in inner)
    if origin in (Union, types.UnionType):
        return _type(next(value for value in inner if value is not type(None)), metadata)
    if origin is tuple:
        words = _type(inner[0], [])
        if len(inner) == 2 and inner[1] is Ellipsis:
            return f"list of {words}" if get_origin(inner[0]) is not tuple else f"list of [{words}]"
        return f"{len(inner)} × {words}"
    names = {float: "number", int: "integer", str: "text", bool: "`true` or `false`"}
    return " ".join(filter(None, (names[annotation], _range(metadata))))


def _range(metadata: list[Any]) -> str:
    """Describe the bounds of a number, or of a text's length."""
    flat = [
        entry for item in metadata for entry in (item.metadata if isinstance(item, FieldInfo) else [item])
    ]
    bounds = {key: getattr(entry, key) for entry in flat for key in ("gt", "ge", "le") if hasattr(entry, key)}
    signs = {"gt": ">", "ge": "≥", "le": "≤"}
    limits = [f"{sign} {bounds[key]:g}" for key, sign in signs.items() if key in bounds]
    longest = next((entry.max_length for entry in flat if hasattr(entry, "max_length")), None)
    return ", ".join([*limits, *((f"up to {longest} characters",) if longest else ())])


def _default(field: FieldInfo) -> str:
    if field.default is PydanticUndefined:
        return "required"
    value = field.default
    if isinstance(value, Section):
        return "its defaults"
    if value in (None, (), ""):
        return "none"
    return f"`{str(value).lower() if isinstance(value, bool) else value}`"


def main() -> None:
    """Write the page to the file named on the command line."""
    Path(sys.argv[1]).write_text(reference(), encoding="utf-8")


if __name__ == "__main__":
    main()
