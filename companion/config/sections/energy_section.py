"""The section ``energy`` of a mission file."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from companion.config.sections.section_base import Section

Power = Annotated[float, Field(gt=0.0, le=1_000_000.0)]
Energy = Annotated[float, Field(gt=0.0, le=1_000_000.0)]


class EnergyConfig(Section):
    """The energy that flying takes, and the energy on board. All five numbers count at the same place: for
    electric flight at the battery, as its monitor measures; for a combustion engine at the shaft, where a
    litre of petrol is about 2 kWh. `companion identify` estimates the first three from recorded flights. With
    this section the service asks the autopilot for its battery messages, `companion check` tells what each
    goal costs, and `companion doctor` compares it with the battery. In flight the pilot is told when to turn
    back, and with `authority.turn_back` the service does it."""  # noqa: D205, D209 - A paragraph of the reference page.

    power_cruise_w: Power
    """Power of level flight at `airspeed_cruise_m_s`."""
    power_max_airspeed_w: Power
    """Power of level flight at `airspeed_max_m_s`."""
    climb_energy_j_m: Annotated[float, Field(ge=0.0, le=1_000_000.0)]
    """Energy that each metre of climb takes beyond level flight; a metre of descent gives as much back, as
    long as the motor still runs. Without losses it is the aircraft's weight in newtons."""
    capacity_wh: Energy
    """Energy of a full battery, or of a full tank."""
    reserve_wh: Annotated[float, Field(ge=0.0, le=1_000_000.0)]
    """Energy that must be left at the landing."""
