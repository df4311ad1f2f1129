"""The section ``glide`` of a mission file."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from companion.config.sections.section_base import Section

Horizontal = Annotated[float, Field(ge=-100_000.0, le=100_000.0)]
PlaceName = Annotated[str, Field(min_length=1, max_length=24, pattern=r"^[A-Za-z0-9][A-Za-z0-9 ._-]*$")]


class FieldConfig(Section):
    """A place to come down with the engine stopped."""

    name: PlaceName
    """Name in messages."""
    east_m: Horizontal
    """East coordinate of its middle."""
    north_m: Horizontal
    """North coordinate of its middle."""
    up_m: Annotated[float, Field(ge=-1_000.0, le=20_000.0)] | None = None
    """Height of its ground. With a section `terrain` it is left out, since the map has it."""
    radius_m: Annotated[float, Field(gt=0.0, le=5_000.0)]
    """The aircraft may touch down within this distance of the middle."""


class PeopleConfig(Section):
    """An area in which the aircraft must not come down."""

    name: PlaceName
    """Name in messages."""
    polygon_enu_m: Annotated[tuple[tuple[Horizontal, Horizontal], ...], Field(min_length=3, max_length=1_000)]
    """Corners, east and north, in order, each once."""


class GlideConfig(Section):
    """The glide with the engine stopped, and where it may end. With this section `companion check` and
    `companion plan` name the stretches from which no field is within reach, and the pilot reads them in
    flight. When thrust is missing, the service names the field to glide to; with `authority.glide` it flies
    there. Home and the autopilot's rally points count as fields as well; before the flight, home is the
    start's place on the ground. With a section `terrain`, a field is within reach only if the glide to it
    passes over the ground."""  # noqa: D205, D209 - A paragraph of the reference page.

    ratio: Annotated[float, Field(ge=1.0, le=100.0)]
    """Horizontal metres per metre of height in still air with the engine stopped. A stopped propeller costs
    much: measure it, and write a little less."""
    airspeed_m_s: Annotated[float, Field(gt=0.0, le=340.0)]
    """True airspeed of the glide."""
    fields: Annotated[tuple[FieldConfig, ...], Field(max_length=200)] = ()
    """Places to come down."""
    people: Annotated[tuple[PeopleConfig, ...], Field(max_length=200)] = ()
    """Areas in which the aircraft must not come down."""
