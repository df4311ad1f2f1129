"""Turns the errors of pydantic into one sentence that says what is expected in a mission file."""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from typing import Any, get_args

from pydantic import BaseModel

from companion.config.models import MissionConfig
from companion.config.sections.section_base import instead_of_metres
from companion.config.source import Document, KeyPath
from companion.errors import ConfigError

# Longer suffixes come first: the first one that matches gives the unit.
_UNITS = (
    ("_m_s2", "metres per second squared"),
    ("_rad_s", "radians per second"),
    ("_per_m", "one per metre"),
    ("_m_s", "metres per second"),
    ("_amsl_m", "metres above mean sea level"),
    ("_j_m", "joules per metre"),
    ("_wh", "watt-hours"),
    ("_w", "watts"),
    ("_deg", "degrees"),
    ("_hz", "hertz"),
    ("_m", "metres"),
    ("_s", "seconds"),
)
_RELATIONS = {
    "greater_than": ("gt", "greater than"),
    "greater_than_equal": ("ge", "of at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "of at most"),
}
_KINDS = {
    "float_type": "a number{unit}, written without quotes and without a unit",
    "finite_number": "a finite number{unit}",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "text",
    "bool_type": "true or false",
    "tuple_type": "a list, in brackets or as entries that begin with '-'",
    "model_type": "keys and values",
    "model_attributes_type": "keys and values",
    "string_too_short": "text that is not empty",
    "string_pattern_mismatch": "a name of letters, digits, '-', '_' and '.', starting with a letter or digit",
    "missing": "a value for this key{unit}",
}
_SIMILARITY_MIN = 0.6  # Less similar keys are not suggested.
_MISPLACED_MIN = 0.85  # A key of another section is suggested from this similarity on.


def unit_of(key: str) -> str | None:
    """Return the unit, in words, that a key's name ends in."""
    return next((unit for suffix, unit in _UNITS if key.endswith(suffix)), None)


def explained(document: Document, findings: list[Any], model: type[BaseModel] = MissionConfig) -> ConfigError:
    """Return the error to report first.

    A misspelt key is reported both as unknown and as missing. Unknown keys come first, since they say more;
    then wrong values in the order of the file; then missing keys.

    Parameters
    ----------
    document : Document
        The parsed file.
    findings : list of dict
        ``ValidationError.errors()`` of pydantic.
    model : type of BaseModel
        Model of the file; unknown keys are compared with its keys.
    """
    ranks = {"extra_forbidden": 0, "missing": 2}

    def order(finding: Any) -> tuple[int, int]:  # noqa: ANN401
        return ranks.get(finding["type"], 1), document.line_of(tuple(finding["loc"])) or 0

    first = min(findings, key=order)
    path: KeyPath = tuple(first["loc"])
    if first["type"] == "extra_forbidden":
        return document.error(path, _nearest(path, model), value="a key that is not known")
    return document.error(path, _expected(first, path))


def _expected(finding: Any, path: KeyPath) -> str:  # noqa: ANN401
    kind, context = finding["type"], finding.get("ctx", {})
    words = unit_of(_last_key(path))
    unit = "" if words is None else f" ({words})"
    if kind in _RELATIONS:
        bound, relation = _RELATIONS[kind]
        return f"a number {relation} {_plain(context[bound])}{unit}"
    if kind == "literal_error":
        return str(context["expected"])
    if kind == "string_too_long":
        return f"text of at most {context['max_length']} characters"
    if kind == "too_short":
        return f"at least {context['min_length']} entries"
    if kind == "too_long":
        return f"at most {context['max_length']} entries"
    if kind == "missing" and path and isinstance(path[-1], int):
        return f"a number{unit} in this place of the list"
    return _KINDS[kind].format(unit=unit) if kind in _KINDS else str(finding["msg"])


def _plain(number: object) -> str:
    return f"{number:g}" if isinstance(number, float) else str(number)


def _last_key(path: KeyPath) -> str:
    return next((part for part in reversed(path) if isinstance(part, str)), "")


def _nearest(path: KeyPath, model: type[BaseModel]) -> str:
    known = dict(_sections(model))
    section = ".".join(part for part in path[:-1] if isinstance(part, str))
    wanted = str(path[-1])
    score, near, place = _most_similar(wanted, section, known)
    if score < _SIMILARITY_MIN:
        return "one of " + ", ".join(known.get(section, []))
    unit = unit_of(near)
    described = near if unit is None else f"{near} ({unit})"
    return described if place == section else f"{described}, in {place or 'the file itself'}"


def _most_similar(wanted: str, section: str, known: dict[str, list[str]]) -> tuple[float, str, str]:
    """Return similarity, name and section of the key that is meant.

    That is a key of the same section, if any is similar enough; the file itself holds keys of all kinds. Else
    it is one that is nearly the same elsewhere, also with its section's name.
    """
    found = [(_similarity(wanted, key), key, section) for key in known.get(section, [])]
    found = [entry for entry in found if entry[0] >= _SIMILARITY_MIN]
    if not (section and found):
        elsewhere = {
            spelling: (key, name)
            for name, keys in sorted(known.items())
            for key in keys
            if name != section
            for spelling in (key, f"{name}_{key}")
        }
        for spelling in difflib.get_close_matches(wanted, elsewhere, n=1, cutoff=_MISPLACED_MIN):
            found.append((_ratio(wanted, spelling), *elsewhere[spelling]))
    return max(found, default=(0.0, "", ""))


def _ratio(wanted: str, key: str) -> float:
    return difflib.SequenceMatcher(None, wanted, key).ratio()


def _similarity(wanted: str, key: str) -> float:
    ratio = _ratio(wanted, key)
    stem = wanted.split("_", maxsplit=1)[0]  # The noun makes "radius_ft" similar to "max_threat_radius_m".
    return max(ratio, 0.6) if len(stem) > 3 and stem in key.split("_") else ratio


def _sections(model: type[BaseModel], path: str = "") -> Iterator[tuple[str, list[str]]]:
    yield path, [*model.model_fields, *instead_of_metres(model)]
    for key, field in model.model_fields.items():
        kinds = (field.annotation, *get_args(field.annotation))
        for kind in kinds:
            if isinstance(kind, type) and issubclass(kind, BaseModel):
                yield from _sections(kind, f"{path}.{key}" if path else key)
