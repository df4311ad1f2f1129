"""The section ``simulation`` of a mission file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from companion.config.sections.section_base import Section

CourseDegrees = Annotated[float, Field(ge=0.0, le=360.0)]
Length = Annotated[float, Field(gt=0.0, le=100_000.0)]


class Simulation(Section):
    """Weather of the simulator, and the radio of a team in it (`companion sitl --aircraft`)."""

    wind_speed_m_s: Annotated[float, Field(ge=0.0, le=100.0)] = 0.0
    """Speed of the mean wind."""
    wind_from_deg: CourseDegrees = 0.0
    """Direction that the wind comes from, clockwise from north."""
    turbulence: Literal["none", "light", "moderate"] = "none"
    """Dryden turbulence in addition to the mean wind."""
    radio_range_m: Length = 100_000.0
    """Range of a team's radio."""
    radio_loss: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    """Share of a team's messages that are lost; with 1 the members wait until they count each other lost."""
    radio_delay_s: Annotated[float, Field(ge=0.0, le=60.0)] = 0.5
    """Largest delay of a team's messages."""
