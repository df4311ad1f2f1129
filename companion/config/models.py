"""The keys of a mission file, each with its unit, bounds and default.

Attribute names are the YAML keys. Nothing is converted on the way in: a number must be written as
a number, an unknown key is an error, and an instance never changes. What relates one key to
another is checked in ``companion.config.checks``.
"""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field
from pydantic_core import PydanticKnownError

from companion.frames import LocalFrame
from companion.types.threat import DynamicThreat, Obstacle, Radar

# A local frame holds to 1 part in 10⁶ within 10 km; ten times that is the farthest a file may reach.
Horizontal = Annotated[float, Field(ge=-100_000.0, le=100_000.0)]
Vertical = Annotated[float, Field(ge=-1_000.0, le=20_000.0)]
Length = Annotated[float, Field(gt=0.0, le=100_000.0)]
Speed = Annotated[float, Field(gt=0.0, le=340.0)]
Seconds = Annotated[float, Field(gt=0.0, le=86_400.0)]
CourseDegrees = Annotated[float, Field(ge=0.0, le=360.0)]
Name = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9][A-Za-z0-9 ._-]*$")]
SystemId = Annotated[int, Field(ge=1, le=255)]


class Section(BaseModel):
    """What all sections share: strict, closed and frozen."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


class Origin(Section):
    """WGS84 point at which east, north and up are zero; altitude above mean sea level."""

    latitude_deg: Annotated[float, Field(ge=-90.0, le=90.0)]
    longitude_deg: Annotated[float, Field(ge=-180.0, le=180.0)]
    altitude_amsl_m: Annotated[float, Field(ge=-500.0, le=9_000.0)]


class Bounds(Section):
    """Box the aircraft stays in: lowest and highest east, north and up [m]."""

    east_m: tuple[Horizontal, Horizontal]
    north_m: tuple[Horizontal, Horizontal]
    up_m: tuple[Vertical, Vertical]


class Start(Section):
    """Where an offline plan and the simulator begin; course clockwise from north."""

    east_m: Horizontal
    north_m: Horizontal
    up_m: Vertical
    course_deg: CourseDegrees


class Goal(Section):
    """A point to reach, in the file's order; reached within the acceptance radius [m]."""

    east_m: Horizontal
    north_m: Horizontal
    up_m: Vertical
    acceptance_radius_m: Length = 60.0


class Vehicle(Section):
    """What the aircraft can do, and how well its motion and state are known (one sigma)."""

    airspeed_min_m_s: Speed
    airspeed_max_m_s: Speed
    airspeed_cruise_m_s: Speed
    acceleration_max_m_s2: Annotated[float, Field(gt=0.0, le=100.0)]
    turn_radius_min_m: Length
    straight_length_min_m: Annotated[float, Field(ge=0.0, le=100_000.0)]
    penetration_speed_m_s: Speed
    climb_angle_max_deg: Annotated[float, Field(gt=0.0, le=60.0)] = 10.0
    descent_angle_max_deg: Annotated[float, Field(gt=0.0, le=60.0)] = 10.0
    acceleration_std_m_s2: Annotated[float, Field(ge=0.0, le=20.0)] = 0.3
    course_rate_std_rad_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.02
    climb_rate_std_rad_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.01
    position_std_m: Annotated[float, Field(gt=0.0, le=1_000.0)] = 2.0
    altitude_std_m: Annotated[float, Field(gt=0.0, le=1_000.0)] = 2.0
    course_std_deg: Annotated[float, Field(gt=0.0, le=90.0)] = 2.0
    climb_std_deg: Annotated[float, Field(gt=0.0, le=45.0)] = 1.0
    initial_position_std_m: Annotated[float, Field(gt=0.0, le=1_000.0)] = 2.0


class PlanningConfig(Section):
    """How plans are made, and when the flown one is replaced."""

    sensing_horizon_m: Length
    time_horizon_s: Seconds
    total_planning_time_s: Seconds
    method: Annotated[str, Field(min_length=1, max_length=40, pattern=r"^[a-z][a-z0-9-]*$")] = "safe-rrt"
    certainty: Literal["shifted", "literal"] = "shifted"
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)] = 1
    planning_budget_s: Annotated[float, Field(gt=0.0, le=600.0)] = 1.0
    swap_margin_s: Annotated[float, Field(ge=0.0, le=600.0)] = 2.0
    max_iterations: Annotated[int, Field(ge=1, le=100_000_000)] = 60_000
    clearance_min_m: Annotated[float, Field(ge=0.0, le=10_000.0)] = 15.0
    threat_level_max: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0
    swap_gain: Annotated[float, Field(ge=0.0, le=1.0)] = 0.05


class RadarConfig(Section):
    """A static threat; the boundary coefficient is K_R of h_B = K_R·L² [1/m]."""

    name: Name
    east_m: Horizontal
    north_m: Horizontal
    up_m: Vertical = 0.0
    max_threat_radius_m: Length
    boundary_coefficient_per_m: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0


class DynamicThreatConfig(Section):
    """A moving threat: where it starts, what it can do, and what the simulated one does."""

    name: Name
    east_m: Horizontal
    north_m: Horizontal
    up_m: Vertical = 0.0
    speed_m_s: Annotated[float, Field(ge=0.0, le=340.0)]
    max_threat_radius_m: Length
    turn_radius_m: Length = 15.0
    behaviour: Literal["pursue", "stand"] = "pursue"


class ObstacleConfig(Section):
    """An upright prism: corners [m] in order, each once, between base and top [m, up]."""

    name: Name
    polygon_enu_m: Annotated[
        tuple[tuple[Horizontal, Horizontal], ...], Field(min_length=3, max_length=10_000)
    ]
    base_m: Vertical
    top_m: Vertical


class Simulation(Section):
    """Weather of the simulator."""

    wind_speed_m_s: Annotated[float, Field(ge=0.0, le=100.0)] = 0.0
    wind_from_deg: CourseDegrees = 0.0
    turbulence: Literal["none", "light", "moderate"] = "none"


class SigningConfig(Section):
    """MAVLink 2 signing: files of mode 0600, and the systems that are believed unsigned.

    ``timestamp_file`` left out: the key file's name with ``.times`` behind it.
    """

    key_file: Annotated[str, Field(min_length=1, max_length=1_000)]
    timestamp_file: Annotated[str, Field(min_length=1, max_length=1_000)] | None = None
    link_id: Annotated[int, Field(ge=0, le=255)] = 0
    allow_unsigned: tuple[SystemId, ...] = ()


class LinkConfig(Section):
    """What is listened to.

    ``track_sources`` left out: tracks of every system but the own; ``systems`` left out: every system.
    ``source_rate_max_hz`` bounds the messages of each source but the own autopilot.
    """

    track_sources: tuple[SystemId, ...] | None = None
    systems: tuple[SystemId, ...] | None = None
    stream_rate_hz: Annotated[float, Field(gt=0.0, le=100.0)] = 10.0
    source_rate_max_hz: Annotated[float, Field(gt=0.0, le=100_000.0)] = 200.0
    signing: SigningConfig | None = None


class Authority(Section):
    """What the service may do without asking the pilot.

    ``resume`` tells whether it goes on after the pilot has left the mission mode and come back;
    ``allow_rtl`` whether the last step of the emergency strategy may change the mode.
    """

    resume: Literal["auto", "never"] = "auto"
    allow_rtl: bool = False


FROM_AUTOPILOT = "from_autopilot"


def _goals(value: object) -> object:
    """Goals as written; ``from_autopilot`` in their place leaves them to the operator's mission."""
    if value == FROM_AUTOPILOT:
        return ()
    if value == ():
        raise PydanticKnownError("too_short", {"field_type": "Tuple", "min_length": 1, "actual_length": 0})
    return value


class MissionConfig(Section):
    """A whole mission file; ``goals`` is a list, or ``from_autopilot``."""

    name: Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")]
    description: Annotated[str, Field(max_length=500)] = ""
    dimension: Literal[2, 3]
    unit_m: Annotated[float, Field(gt=0.0, le=10_000.0)]
    origin: Origin
    bounds: Bounds
    start: Start
    goals: Annotated[tuple[Goal, ...], Field(max_length=1_000), BeforeValidator(_goals)]
    vehicle: Vehicle
    planning: PlanningConfig
    radars: tuple[RadarConfig, ...] = ()
    dynamic_threats: tuple[DynamicThreatConfig, ...] = ()
    obstacles: tuple[ObstacleConfig, ...] = ()
    simulation: Simulation = Simulation()
    link: LinkConfig = LinkConfig()
    authority: Authority = Authority()

    @property
    def goals_from_autopilot(self) -> bool:
        """Whether the operator's waypoints in the autopilot are the goals."""
        return not self.goals

    @cached_property
    def frame(self) -> LocalFrame:
        """East, north, up about the origin."""
        return LocalFrame(
            latitude_deg=float(self.origin.latitude_deg),
            longitude_deg=float(self.origin.longitude_deg),
            altitude_amsl_m=float(self.origin.altitude_amsl_m),
        )

    @cached_property
    def obstacle_list(self) -> tuple[Obstacle, ...]:
        """Obstacles as the world takes them."""
        return tuple(
            Obstacle(
                name=entry.name,
                polygon_enu_m=np.asarray(entry.polygon_enu_m, dtype=np.float64),
                base_m=float(entry.base_m),
                top_m=float(entry.top_m),
            )
            for entry in self.obstacles
        )

    @cached_property
    def radar_list(self) -> tuple[Radar, ...]:
        """Static threats as the world takes them."""
        return tuple(
            Radar(
                name=entry.name,
                position_enu_m=(float(entry.east_m), float(entry.north_m), float(entry.up_m)),
                max_threat_radius_m=float(entry.max_threat_radius_m),
                boundary_coefficient_per_m=float(entry.boundary_coefficient_per_m),
            )
            for entry in self.radars
        )

    @cached_property
    def dynamic_threat_list(self) -> tuple[DynamicThreat, ...]:
        """Moving threats as the world takes them."""
        return tuple(
            DynamicThreat(
                name=entry.name,
                position_enu_m=(float(entry.east_m), float(entry.north_m), float(entry.up_m)),
                speed_m_s=float(entry.speed_m_s),
                max_threat_radius_m=float(entry.max_threat_radius_m),
                turn_radius_m=float(entry.turn_radius_m),
            )
            for entry in self.dynamic_threats
        )
