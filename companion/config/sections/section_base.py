"""Base of all sections of a mission file."""

from __future__ import annotations

from typing import Any, get_args, get_origin

from pydantic import BaseModel, ConfigDict

METRES = ("east_m", "north_m")
DEGREES = ("latitude_deg", "longitude_deg")
UTM = "utm"
LINE_METRES, LINE_DEGREES = "_enu_m", "_lat_lon_deg"


class Section(BaseModel):
    """Base of all sections: strict, without unknown keys, and frozen."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


def section_in(annotation: Any) -> tuple[type[Section], bool] | None:  # noqa: ANN401
    """Return the section that a key holds, and whether it holds a list of them; None if it holds neither."""
    if isinstance(annotation, type) and issubclass(annotation, Section):
        return annotation, False
    for inner in get_args(annotation):
        found = section_in(inner)
        if found is not None:
            return found[0], found[1] or get_origin(annotation) is tuple
    return None


def instead_of_metres(model: type[BaseModel]) -> list[str]:
    """Return the keys of a section that a file may have in place of those in metres east and north."""
    keys = [*DEGREES, UTM] if set(METRES) <= model.model_fields.keys() else []
    lines = [key for key in model.model_fields if key.endswith(LINE_METRES)]
    return keys + [key.removesuffix(LINE_METRES) + LINE_DEGREES for key in lines]
