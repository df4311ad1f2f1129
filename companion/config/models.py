"""Pydantic models of a mission file: its keys with units, bounds and defaults.

Attribute names are the YAML keys. Values are not converted: a number must be written as a number. An unknown
key is an error, and an instance never changes. ``companion.config.checks`` validates relations between keys.
The reference page takes the texts below the keys from the source, since pydantic would parse them at
each start.
"""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, Field
from pydantic_core import PydanticKnownError

from companion.config.sections.authority_section import Authority
from companion.config.sections.energy_section import EnergyConfig
from companion.config.sections.glide_section import GlideConfig
from companion.config.sections.section_base import Section
from companion.config.sections.simulation_section import Simulation
from companion.config.sections.team_section import TeamConfig
from companion.config.sections.terrain_section import TerrainConfig
from companion.frames import LocalFrame
from companion.planning.plugins.installed_threats import with_sight
from companion.types.threat import DynamicThreat, Obstacle, Radar

# A local frame is accurate to 1 part in 10⁶ within 10 km. A file may reach ten times as far.
Horizontal = Annotated[float, Field(ge=-100_000.0, le=100_000.0)]
Vertical = Annotated[float, Field(ge=-1_000.0, le=20_000.0)]
Length = Annotated[float, Field(gt=0.0, le=100_000.0)]
Speed = Annotated[float, Field(gt=0.0, le=340.0)]
Seconds = Annotated[float, Field(gt=0.0, le=86_400.0)]
CourseDegrees = Annotated[float, Field(ge=0.0, le=360.0)]
Name = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9][A-Za-z0-9 ._-]*$")]
Identity = Annotated[str, Field(max_length=80, pattern=r"^(icao|callsign|mmsi|rid|utm|system):[0-9A-Za-z]+$")]
SystemId = Annotated[int, Field(ge=1, le=255)]


class Origin(Section):
    """WGS84 point at which east, north and up are zero; altitude above mean sea level."""

    latitude_deg: Annotated[float, Field(ge=-90.0, le=90.0)]
    """Latitude, positive north."""
    longitude_deg: Annotated[float, Field(ge=-180.0, le=180.0)]
    """Longitude, positive east."""
    altitude_amsl_m: Annotated[float, Field(ge=-500.0, le=9_000.0)]
    """Height of `up_m: 0` above mean sea level."""


class Bounds(Section):
    """Box that the aircraft stays in: lowest and highest east, north and up [m]."""

    east_m: tuple[Horizontal, Horizontal]
    """Lowest and highest value; plans stay between them."""
    north_m: tuple[Horizontal, Horizontal]
    """Lowest and highest value; plans stay between them."""
    up_m: tuple[Vertical, Vertical]
    """Lowest and highest value; plans stay between them."""


class Start(Section):
    """Where an offline plan and the simulator begin; the course is clockwise from north."""

    east_m: Horizontal
    """East coordinate at which an offline plan and a simulated flight begin."""
    north_m: Horizontal
    """North coordinate of the same point."""
    up_m: Vertical
    """Height of the same point; with `dimension: 2` the height of the whole flight."""
    course_deg: CourseDegrees
    """Course at the start, clockwise from north."""


class Goal(Section):
    """A point to reach, in the order of the file."""

    east_m: Horizontal
    """East coordinate of the point to reach."""
    north_m: Horizontal
    """North coordinate of the point to reach."""
    up_m: Vertical
    """Height of the point to reach."""
    acceptance_radius_m: Length = 60.0
    """The goal is reached within this distance."""


# With this multiple of a small aircraft's noise, path qualities are about those of the paper.
PAPER_NOISE = 3.0


class Vehicle(Section):
    """Performance of the aircraft, and the noise of its motion and state (one sigma).

    `companion identify` estimates the noise, the keys that contain `std`, and `coordination` from recorded
    flights.
    """

    airspeed_min_m_s: Speed
    """Lowest planned true airspeed."""
    airspeed_max_m_s: Speed
    """Highest planned true airspeed."""
    airspeed_cruise_m_s: Speed
    """True airspeed that missions command."""
    airspeed_fast_m_s: Speed | None = None
    """Highest airspeed that missions command if no slower path is safe from moving threats; by default
    `airspeed_max_m_s`. Turns are then as wide as `bank_max_deg` requires."""
    acceleration_max_m_s2: Annotated[float, Field(gt=0.0, le=100.0)]
    """Highest acceleration along the path."""
    turn_radius_min_m: Length
    """Radius of the tightest turn at cruise that the autopilot flies without losing height."""
    bank_max_deg: Annotated[float, Field(gt=0.0, le=60.0)] = 40.0
    """Highest bank in turns; with tail wind the turns are wider than `turn_radius_min_m`."""
    coordination: Annotated[float, Field(ge=0.5, le=1.0)] = 1.0
    """Rate of turn at a bank, as a share of that of a coordinated turn; an aircraft that slips turns less.
    It counts until the aircraft has turned; from then on it is estimated in flight."""
    straight_length_min_m: Annotated[float, Field(ge=0.0, le=100_000.0)]
    """Shortest straight flight between two turns (sl_min)."""
    penetration_speed_m_s: Speed
    """v_p of the non-membership function: a higher airspeed lowers the threat."""
    climb_angle_max_deg: Annotated[float, Field(gt=0.0, le=60.0)] = 10.0
    """Steepest climb; flatter where the autopilot's own largest rate of climb asks for that."""
    descent_angle_max_deg: Annotated[float, Field(gt=0.0, le=60.0)] = 10.0
    """Steepest descent; flatter where the autopilot's own largest rate of descent asks for that."""
    noise: Literal["usual", "paper"] = "usual"
    """Defaults of the keys that contain `std`: `usual` are the defaults below, those of a small aircraft with
    GNSS; `paper` is three times as much, with which Q is about as low as the paper's at a margin of 1 m."""
    acceleration_std_m_s2: Annotated[float, Field(ge=0.0, le=20.0)] = 0.3
    """Deviation of the aircraft from the commanded acceleration."""
    course_rate_std_rad_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.02
    """Deviation from the commanded rate of turn."""
    climb_rate_std_rad_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.01
    """Deviation from the commanded rate of the climb angle."""
    position_std_m: Annotated[float, Field(gt=0.0, le=1_000.0)] = 2.0
    """Deviation of the autopilot's horizontal position; the autopilot's own estimate replaces it if
    reported."""
    altitude_std_m: Annotated[float, Field(gt=0.0, le=1_000.0)] = 2.0
    """Deviation of the autopilot's altitude."""
    course_std_deg: Annotated[float, Field(gt=0.0, le=90.0)] = 2.0
    """Deviation of the autopilot's course."""
    climb_std_deg: Annotated[float, Field(gt=0.0, le=45.0)] = 1.0
    """Deviation of the autopilot's climb angle."""
    initial_position_std_m: Annotated[float, Field(gt=0.0, le=1_000.0)] = 2.0
    """Deviation of the position at the start of an offline plan."""


def _with_noise(given: object) -> object:
    """Return the section as written, with the defaults of a noise preset filled in."""
    if not isinstance(given, dict) or given.get("noise") != "paper":
        return given
    usual = {key: field.default for key, field in Vehicle.model_fields.items() if "_std_" in key}
    return {key: PAPER_NOISE * default for key, default in usual.items()} | given


class PlanningConfig(Section):
    """How plans are made, and when a plan replaces the flown path."""

    sensing_horizon_m: Length
    """The aircraft senses unlisted radars within this distance, and sub goals lie on a circle of this radius.
    A larger value makes plans turn away earlier and take longer to compute."""
    time_horizon_s: Seconds
    """Longest time between two plans; a mission in the autopilot covers three times as much. A smaller value
    makes plans and replaces missions more often."""
    total_planning_time_s: Seconds
    """The paper's limit for a whole plan. It is only compared with `time_horizon_s`; it ends no flight."""
    method: Annotated[str, Field(min_length=1, max_length=40, pattern=r"^[a-z][a-z0-9-]*$")] = "safe-rrt"
    """`safe-rrt`, a comparator, or [your own](own-planner.md); the error about any other name lists them."""
    certainty: Literal["shifted", "literal"] = "shifted"
    """Form of the certainty factor in threat levels: `literal` as printed in the paper, or `shifted`."""
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)] = 1
    """Seed of all random numbers."""
    planning_budget_s: Annotated[float, Field(gt=0.0, le=600.0)] = 1.0
    """Longest computing time of a plan in flight. A larger value finds more in narrow maps, but a plan must
    then begin farther ahead of the aircraft."""
    swap_margin_s: Annotated[float, Field(ge=0.0, le=600.0)] = 2.0
    """Added to the time of planning and upload: a plan begins that far ahead of the aircraft. With a larger
    value fewer missions arrive too late, but the reaction to changes is later."""
    max_iterations: Annotated[int, Field(ge=1, le=100_000_000)] = 60_000
    """Most iterations of one plan, if no clock stops it."""
    clearance_min_m: Annotated[float, Field(ge=0.0, le=10_000.0)] = 15.0
    """Distance that plans keep from obstacles and fences; gaps narrower than twice this value are closed. The
    independent check requires half of it plus the uncertainty of the position. No plan is made while the
    position is known to be wrong. If it is wrong by more than this value, only `clearance_wanted_m` keeps the
    aircraft away from obstacles."""
    clearance_wanted_m: Annotated[float, Field(ge=0.0, le=10_000.0)] = 60.0
    """Distance that plans keep from obstacles and fences if it costs little: one second one metre nearer
    costs as much as two and a half metres of path. A corner passed at 15 m then costs as much as about three
    seconds under threat. A position may be wrong by this much before the aircraft touches anything. Narrower
    gaps are still used. A value of at most `clearance_min_m`, such as `0`, has no effect."""
    threat_level_max: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0
    """Highest threat level on a path; a flown path that exceeds it is replaced. If no path stays below it,
    the path of least cost is flown. `1` is no limit: threats then have a cost, and a detour is flown if it
    costs less. A low limit near vehicles that can move replaces the mission many times."""
    price_seen: Annotated[float, Field(ge=0.0, le=1_000.0)] = 3.0
    """One second in sight of radars costs as much as this many seconds of detour. At `0` radars are not
    avoided. A second counts in part if the radar sees the aircraft less well."""
    price_pursued: Annotated[float, Field(ge=0.0, le=1_000.0)] = 3.0
    """One second in which a pursuer could threaten the aircraft costs as much as this many seconds of detour.
    It matters only if every path found can be threatened: a path that no pursuer can reach is flown at any
    cost."""
    price_near: Annotated[float, Field(ge=0.0, le=1_000.0)] = 6.0
    """One second next to an obstacle costs as much as this many seconds of detour. The price decreases
    linearly to zero at the distance `clearance_wanted_m`."""
    price_energy: Annotated[float, Field(ge=0.0, le=1_000.0)] = 0.35
    """One second at twice the power of cruise costs as much as this many seconds of detour. Power grows with
    the cube of the airspeed, so that below one third a faster flight costs less. From about `2` on the
    aircraft flies at cruise unless only a faster flight stays ahead of all pursuers; `airspeed_fast_m_s`
    limits the speed."""
    price_collision: Annotated[float, Field(ge=0.0, le=10_000.0)] = 20.0
    """Each unit of −log of the probability that a waypoint is free of collisions costs as much as this many
    seconds of detour: at 20, a waypoint that is free with 95 % costs one second."""
    seen_max_s: Annotated[float, Field(gt=0.0, le=100_000.0)] | None = None
    """Longest uninterrupted time in sight of radars on a path. A radar sees the aircraft where its membership
    is at least one half. By default there is no limit."""
    quality_min: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    """Least probability that a path is free of collisions, Q of (8); paths below it are refused. `0` refuses
    no path. The price of collisions asks for detours in any case."""
    swap_gain: Annotated[float, Field(ge=0.0, le=1.0)] = 0.05
    """Share by which a new path must cost less to replace a flown path that passes the check. At 0 every gain
    replaces it, at 1 only a path that fails is replaced."""


class RadarConfig(Section):
    """A static threat with the boundary h_B = K_R·L²."""

    name: Name
    """Name in messages."""
    east_m: Horizontal
    """East coordinate of the radar."""
    north_m: Horizontal
    """North coordinate of the radar."""
    up_m: Vertical = 0.0
    """Height of the radar."""
    max_threat_radius_m: Length
    """R_max: beyond this distance there is no threat."""
    boundary_coefficient_per_m: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    """K_R of the lower boundary h_B = K_R·L², below which the radar does not see."""
    model: Annotated[str, Field(max_length=40)] = ""
    """Where the radar sees, by [a model of another package](own-threat.md); by default all around."""
    model_values: Annotated[tuple[float, ...], Field(max_length=100)] = ()
    """Values that the model takes, in its order."""
    known_beforehand: bool = True
    """If false, the radar is unknown until the aircraft is within `sensing_horizon_m` of its area."""

    def radar(self) -> Radar:
        """Return the radar in the world's types; raises ThreatModelError if its model cannot be used."""
        place = float(self.east_m), float(self.north_m), float(self.up_m)
        reach_m, slope = float(self.max_threat_radius_m), float(self.boundary_coefficient_per_m)
        plain = Radar(self.name, place, reach_m, slope, is_listed=self.known_beforehand)
        return with_sight(plain, self.model, self.model_values)


class DynamicThreatConfig(Section):
    """A moving threat: its capabilities, and the start and behaviour of the simulated one."""

    name: Name
    """Name in messages; tracks are distinguished by their own identity."""
    east_m: Horizontal
    """East coordinate at which the simulated threat starts."""
    north_m: Horizontal
    """North coordinate at which the simulated threat starts."""
    up_m: Vertical = 0.0
    """Height at which the simulated threat starts."""
    speed_m_s: Annotated[float, Field(ge=0.0, le=340.0)]
    """Highest speed."""
    max_threat_radius_m: Length
    """RD_max: within this distance, and in sight, it is a threat."""
    turn_radius_m: Length = 15.0
    """Radius of its tightest turn."""
    behaviour: Literal["pursue", "drive", "stand"] = "pursue"
    """Behaviour of the simulated threat: pursue the aircraft, drive its route, or stand. Plans do not use
    it."""
    route_enu_m: Annotated[tuple[tuple[Horizontal, Horizontal], ...], Field(max_length=1_000)] = ()
    """With `behaviour: drive`: east and north of the points that it drives to in order; it stops at the
    last."""
    identity: Identity | None = None
    """Identity in reports, for example `icao:00ABCD`; by default a report is assigned by kind and
    position."""
    system_id: SystemId | None = None
    """System that reports it; by default any."""


class ObstacleConfig(Section):
    """An upright prism: corners [m] in order, each once, between base and top [m, up]."""

    name: Name
    """Name in messages."""
    polygon_enu_m: Annotated[
        tuple[tuple[Horizontal, Horizontal], ...], Field(min_length=3, max_length=10_000)
    ]
    """Corners, east and north, in order, each once."""
    base_m: Vertical
    """Height of its bottom."""
    top_m: Vertical
    """Height of its top."""


class SigningConfig(Section):
    """MAVLink 2 signing: files of mode 0600, and systems that are accepted without a signature."""

    key_file: Annotated[str, Field(min_length=1, max_length=1_000)]
    """File of 32 bytes or 64 hexadecimal digits, of mode 0600, in folders that nobody else may write to."""
    timestamp_file: Annotated[str, Field(min_length=1, max_length=1_000)] | None = None
    """File of the last timestamps; by default the name of the key file followed by `.times`."""
    link_id: Annotated[int, Field(ge=0, le=255)] = 0
    """Link id of our frames."""
    allow_unsigned: tuple[SystemId, ...] = ()
    """Systems that are accepted without a signature."""
    allow_mavlink1: bool = False
    """If true, these systems may also send MAVLink 1, which has no signatures; no other system may."""


class LinkConfig(Section):
    """Which systems the service listens to."""

    vehicle_system_id: SystemId | None = None
    """System id of the vehicle; by default that of the first autopilot that sends for a while. Needed in a
    team."""
    parameter_sources: tuple[SystemId, ...] = (255,)
    """Systems that may set parameters of this service; ground stations have 255."""
    track_sources: tuple[SystemId, ...] | None = None
    """Systems whose reports of other vehicles are accepted; by default all but the vehicle itself."""
    systems: tuple[SystemId, ...] | None = None
    """Systems whose messages are accepted at all; by default all."""
    stream_rate_hz: Annotated[float, Field(gt=0.0, le=100.0)] = 10.0
    """Rate at which the autopilot is asked to send its state."""
    source_rate_max_hz: Annotated[float, Field(gt=0.0, le=100_000.0)] = 200.0
    """Highest accepted rate of messages from each source but the vehicle's autopilot."""
    signing: SigningConfig | None = None
    """MAVLink 2 signing; by default nothing is signed or verified."""


class UseBy(Section):
    """Ages up to which received data is used; the service warns the pilot of older data.

    Without a position, or the number of the item being flown, the service makes no plan and changes no
    mission. It estimates bank, airspeed and wind from other data if they are missing.
    """

    position_s: Seconds = 1.5
    """Highest age of the aircraft's position."""
    attitude_s: Seconds = 1.5
    """Highest age of its attitude."""
    airspeed_s: Seconds = 1.5
    """Highest age of its airspeed."""
    wind_s: Seconds = 30.0
    """Highest age of the autopilot's wind estimate."""
    mission_item_s: Seconds = 5.0
    """Highest age of the number of the item being flown."""
    track_s: Seconds = 10.0
    """Highest age of a moving threat's position; later the threat may be wherever it could have moved to."""
    jump_confirm_s: Seconds = 30.0
    """A position that jumped is accepted after this time without another jump."""


class Takeover(Section):
    """When the service takes over in the air; until then the operator's mission is flown."""

    when: Literal["takeoff", "item", "height", "holding"] = "takeoff"
    """After the list's take-off item, after `item`, above the height `up_m`, or in the operator's holding
    circle."""
    item: Annotated[int, Field(ge=1, le=65_534)] | None = None
    """With `when: item`: number, as on the ground station, of the last item that the operator's mission
    flies."""
    up_m: Vertical | None = None
    """With `when: height`: height above which the service takes over."""


FROM_AUTOPILOT = "from_autopilot"


def _goals(value: object) -> object:
    """Return goals as written; ``from_autopilot`` stands for the waypoints of the operator's mission."""
    if value == FROM_AUTOPILOT:
        return ()
    if value == ():
        raise PydanticKnownError("too_short", {"field_type": "Tuple", "min_length": 1, "actual_length": 0})
    return value


class MissionConfig(Section):
    """A whole mission file."""

    name: Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")]
    """Name of the flight and its folder."""
    description: Annotated[str, Field(max_length=500)] = ""
    """Description for people."""
    dimension: Literal[2, 3]
    """`2`: the plan stays at the start's height; `3`: it climbs and descends."""
    unit_m: Annotated[float, Field(gt=0.0, le=10_000.0)]
    """Metres in one planning unit of the paper; the weights of the paper's costs refer to this unit."""
    origin: Origin
    """WGS84 point at which east, north and up are zero."""
    bounds: Bounds
    """Box that plans stay in."""
    start: Start
    """Where an offline plan and the simulator begin."""
    goals: Annotated[tuple[Goal, ...], Field(max_length=1_000), BeforeValidator(_goals)]
    """List of goals in order, or `from_autopilot` for the waypoints of the mission in the autopilot."""
    vehicle: Annotated[Vehicle, BeforeValidator(_with_noise)]
    """Performance and noise of the aircraft."""
    planning: PlanningConfig
    """How plans are made, and when they replace the flown path."""
    radars: tuple[RadarConfig, ...] = ()
    """Static threats."""
    dynamic_threats: tuple[DynamicThreatConfig, ...] = ()
    """Kinds of moving threats, and where simulated ones start."""
    obstacles: Annotated[tuple[ObstacleConfig, ...], Field(max_length=2_000)] = ()
    """Upright prisms to stay clear of."""
    simulation: Simulation = Simulation()
    """Weather of the simulator."""
    link: LinkConfig = LinkConfig()
    """Which systems the service listens to."""
    use_by: UseBy = UseBy()
    """Ages up to which received data is used."""
    authority: Authority = Authority()
    """What the service may do without asking the pilot."""
    takeover: Takeover = Takeover()
    """When the service takes over in the air."""
    energy: EnergyConfig | None = None
    """What flying costs, and what is on board; by default energy is not considered."""
    glide: GlideConfig | None = None
    """How far it glides without thrust, and where to; by default no field is sought."""
    terrain: TerrainConfig | None = None
    """The ground; by default none is known."""
    team: TeamConfig | None = None
    """Other aircraft that share their plans; by default there are none."""

    @property
    def goals_from_autopilot(self) -> bool:
        """Whether the goals are the operator's waypoints in the autopilot."""
        return not self.goals

    @property
    def team_members(self) -> tuple[int, ...]:
        """System ids of the members of the team; nobody without one."""
        return () if self.team is None else self.team.members

    @property
    def shares_goals(self) -> bool:
        """Whether the goals are divided among the members of a team."""
        return self.team is not None and self.team.share_goals

    @cached_property
    def frame(self) -> LocalFrame:
        """Local frame of east, north, up about the origin."""
        return LocalFrame(
            latitude_deg=float(self.origin.latitude_deg),
            longitude_deg=float(self.origin.longitude_deg),
            altitude_amsl_m=float(self.origin.altitude_amsl_m),
        )

    @cached_property
    def obstacle_list(self) -> tuple[Obstacle, ...]:
        """Obstacles in the world's types."""
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
        """Static threats in the world's types."""
        return tuple(entry.radar() for entry in self.radars)

    @cached_property
    def dynamic_threat_list(self) -> tuple[DynamicThreat, ...]:
        """Moving threats in the world's types."""
        return tuple(
            DynamicThreat(
                name=entry.name,
                position_enu_m=(float(entry.east_m), float(entry.north_m), float(entry.up_m)),
                speed_m_s=float(entry.speed_m_s),
                max_threat_radius_m=float(entry.max_threat_radius_m),
                turn_radius_m=float(entry.turn_radius_m),
                identity=entry.identity or "",
                system_id=entry.system_id,
            )
            for entry in self.dynamic_threats
        )
