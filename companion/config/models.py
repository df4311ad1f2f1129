"""The keys of a mission file, each with its unit, bounds and default.

Attribute names are the YAML keys. Nothing is converted on the way in: a number must be written as
a number, an unknown key is an error, and an instance never changes. What relates one key to
another is checked in ``companion.config.checks``. The reference page takes the texts behind the keys from
this file: pydantic would read them at each start.
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
Identity = Annotated[str, Field(max_length=80, pattern=r"^(icao|callsign|mmsi|rid|utm|system):[0-9A-Za-z]+$")]
SystemId = Annotated[int, Field(ge=1, le=255)]


class Section(BaseModel):
    """What all sections share: strict, closed and frozen."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


class Origin(Section):
    """WGS84 point at which east, north and up are zero; altitude above mean sea level."""

    latitude_deg: Annotated[float, Field(ge=-90.0, le=90.0)]
    """Of the origin, positive north."""
    longitude_deg: Annotated[float, Field(ge=-180.0, le=180.0)]
    """Of the origin, positive east."""
    altitude_amsl_m: Annotated[float, Field(ge=-500.0, le=9_000.0)]
    """Height of `up_m: 0` above mean sea level."""


class Bounds(Section):
    """Box the aircraft stays in: lowest and highest east, north and up [m]."""

    east_m: tuple[Horizontal, Horizontal]
    """Lowest and highest."""
    north_m: tuple[Horizontal, Horizontal]
    """Lowest and highest."""
    up_m: tuple[Vertical, Vertical]
    """Lowest and highest; plans keep between them."""


class Start(Section):
    """Where an offline plan and the simulator begin; course clockwise from north."""

    east_m: Horizontal
    """Where an offline plan and a simulated flight begin."""
    north_m: Horizontal
    """The same, north."""
    up_m: Vertical
    """The same; in the plane (`dimension: 2`) the height of the whole flight."""
    course_deg: CourseDegrees
    """Clockwise from north."""


class Goal(Section):
    """A point to reach, in the file's order; reached within the acceptance radius [m]."""

    east_m: Horizontal
    """Of the point to reach."""
    north_m: Horizontal
    """Of the point to reach."""
    up_m: Vertical
    """Of the point to reach."""
    acceptance_radius_m: Length = 60.0
    """Nearer than this it counts as reached."""


PAPER_NOISE = 3.0  # times that of a small aircraft: the paper's path qualities are of about this


class Vehicle(Section):
    """What the aircraft can do, and how well its motion and state are known (one sigma).

    `companion identify` tells the noise, the keys with `std` in them, of recorded flights.
    """

    airspeed_min_m_s: Speed
    """Slowest that is planned, true airspeed."""
    airspeed_max_m_s: Speed
    """Fastest that is planned."""
    airspeed_cruise_m_s: Speed
    """What missions command."""
    airspeed_fast_m_s: Speed | None = None
    """Fastest that missions command, where no slower path is safe from moving threats; left out,
    airspeed_max_m_s. Turns are then as wide as bank_max_deg makes them."""
    acceleration_max_m_s2: Annotated[float, Field(gt=0.0, le=100.0)]
    """Along the path."""
    turn_radius_min_m: Length
    """Of the tightest turn at cruise that the autopilot flies without losing height."""
    bank_max_deg: Annotated[float, Field(gt=0.0, le=60.0)] = 40.0
    """At most that of its turns: with the wind behind they are flown wider than turn_radius_min_m."""
    straight_length_min_m: Annotated[float, Field(ge=0.0, le=100_000.0)]
    """Between two turns (sl_min)."""
    penetration_speed_m_s: Speed
    """v_p of the non-membership function: faster than this lowers a threat."""
    climb_angle_max_deg: Annotated[float, Field(gt=0.0, le=60.0)] = 10.0
    """Steepest climb."""
    descent_angle_max_deg: Annotated[float, Field(gt=0.0, le=60.0)] = 10.0
    """Steepest descent."""
    noise: Literal["usual", "paper"] = "usual"
    """What the keys with `std` are that are left out: `usual`, the defaults below, those of a small aircraft
    with GNSS; or `paper`, three times these: with a margin of 1 m Q is then about as low as the paper's."""
    acceleration_std_m_s2: Annotated[float, Field(ge=0.0, le=20.0)] = 0.3
    """How far the aircraft strays from the commanded acceleration."""
    course_rate_std_rad_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.02
    """The same of its rate of turn."""
    climb_rate_std_rad_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.01
    """The same of its rate of climb angle."""
    position_std_m: Annotated[float, Field(gt=0.0, le=1_000.0)] = 2.0
    """How well the autopilot knows its place; its own figure is used where it tells one."""
    altitude_std_m: Annotated[float, Field(gt=0.0, le=1_000.0)] = 2.0
    """How well it knows its height."""
    course_std_deg: Annotated[float, Field(gt=0.0, le=90.0)] = 2.0
    """How well it knows its course."""
    climb_std_deg: Annotated[float, Field(gt=0.0, le=45.0)] = 1.0
    """How well it knows its climb angle."""
    initial_position_std_m: Annotated[float, Field(gt=0.0, le=1_000.0)] = 2.0
    """At the start of an offline plan."""


def _with_noise(given: object) -> object:
    """An aircraft as written, with the noise of a preset filled in."""
    if not isinstance(given, dict) or given.get("noise") != "paper":
        return given
    usual = {key: field.default for key, field in Vehicle.model_fields.items() if "_std_" in key}
    return {key: PAPER_NOISE * default for key, default in usual.items()} | given


class PlanningConfig(Section):
    """How plans are made, and when the flown one is replaced."""

    sensing_horizon_m: Length
    """Radars that are not known beforehand are sensed from this near on, and sub goals lie on this circle:
    a larger one turns away earlier, and takes longer to plan."""
    time_horizon_s: Seconds
    """Longest time between two plans; a mission in the autopilot reaches three of these ahead. A shorter
    one plans and replaces missions more often."""
    total_planning_time_s: Seconds
    """The paper's limit for a whole plan; compared with `time_horizon_s`, and no flight is cut short by
    it."""
    method: Annotated[str, Field(min_length=1, max_length=40, pattern=r"^[a-z][a-z0-9-]*$")] = "safe-rrt"
    """`safe-rrt` or a comparator; the error about any other name lists them."""
    certainty: Literal["shifted", "literal"] = "shifted"
    """Form of the certainty factor in threat levels: `literal` as printed in the paper, or `shifted`."""
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)] = 1
    """Of all that is drawn at random."""
    planning_budget_s: Annotated[float, Field(gt=0.0, le=600.0)] = 1.0
    """How long one plan may take in flight: a longer one finds more in narrow maps, and a plan begins so
    much farther ahead."""
    swap_margin_s: Annotated[float, Field(ge=0.0, le=600.0)] = 2.0
    """Added to the time that planning and hand-over take: a plan begins that far ahead. A larger one has
    fewer missions come too late, and answers surprises later."""
    max_iterations: Annotated[int, Field(ge=1, le=100_000_000)] = 60_000
    """Iterations one plan may take, where no clock stops it."""
    clearance_min_m: Annotated[float, Field(ge=0.0, le=10_000.0)] = 15.0
    """Distance that plans keep from obstacles and fences; gaps narrower than twice this are closed to them.
    The check asks for half of it and the uncertainty of the place. Where the autopilot's own position may be
    wrong by more than this, nothing keeps the aircraft off but what there is of `clearance_wanted_m`: nothing
    is planned on a position that jumped, and the mission is flown beside where it should be."""
    clearance_wanted_m: Annotated[float, Field(ge=0.0, le=10_000.0)] = 60.0
    """Distance from obstacles and fences that plans are given where it costs little: a second a metre nearer
    counts like two and a half metres of way, so that a corner passed at 15 m is worth some three seconds
    under threat. By so much may a position be wrong before anything is touched. Narrower gaps are flown all
    the same; where it is no more than `clearance_min_m`, as `0`, nothing is asked for."""
    threat_level_max: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0
    """No place of a path may be above this threat level, and a flown path that comes above it is replaced.
    Where no path keeps below it, the one that costs least is flown all the same. `1` is no limit: threats
    cost, and a detour is flown as long as it is worth it. A low limit among vehicles that could drive
    replaces missions many times."""
    price_seen: Annotated[float, Field(ge=0.0, le=1_000.0)] = 3.0
    """A second in the sight of radars counts like this many seconds of detour. At `0` radars are not avoided;
    a path that is seen less and takes longer is flown as long as the price is worth it. A second is seen in
    part where a radar sees it less well."""
    price_pursued: Annotated[float, Field(ge=0.0, le=1_000.0)] = 3.0
    """A second in which a pursuer could threaten the aircraft counts like this many seconds of detour. It
    decides only where no path is found on which none could: one that none could bar is flown at any cost."""
    price_near: Annotated[float, Field(ge=0.0, le=1_000.0)] = 6.0
    """A second beside an obstacle counts like this many seconds of detour; a second at a distance between
    there and `clearance_wanted_m` counts in proportion."""
    price_energy: Annotated[float, Field(ge=0.0, le=1_000.0)] = 0.35
    """A second at twice the power of cruise counts like this many seconds of detour. Power grows with the
    cube of the airspeed, so that below a third a faster flight costs less. From some `2` on the aircraft
    stays at cruise unless only a faster flight is ahead of all pursuers; `airspeed_fast_m_s` bounds that."""
    price_collision: Annotated[float, Field(ge=0.0, le=10_000.0)] = 20.0
    """Each unit of −log of the probability that a waypoint is free of collisions counts like this many
    seconds of detour: at 20 a waypoint that is free with 95 % costs one second."""
    seen_max_s: Annotated[float, Field(gt=0.0, le=100_000.0)] | None = None
    """No path is in the sight of radars for longer than this without a break. A radar sees the aircraft where
    its membership is at least one half. Left out, there is no limit."""
    quality_min: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    """Least probability that a path touches nothing, Q of (8): with less it is refused, and no optimiser goes
    below it. Noise that is large for the gaps asks for detours anyhow; `0` refuses nothing."""
    swap_gain: Annotated[float, Field(ge=0.0, le=1.0)] = 0.05
    """Share by which a new path must be cheaper to replace one that still passes: at 0 every small gain is
    flown, at 1 only what fails is replaced."""


class RadarConfig(Section):
    """A static threat; the boundary coefficient is K_R of h_B = K_R·L² [1/m]."""

    name: Name
    """Used in messages."""
    east_m: Horizontal
    """Of the radar."""
    north_m: Horizontal
    """Of the radar."""
    up_m: Vertical = 0.0
    """Of the radar."""
    max_threat_radius_m: Length
    """R_max: beyond it there is no threat."""
    boundary_coefficient_per_m: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    """K_R of the lower boundary h_B = K_R·L²: below it the radar does not see."""
    known_beforehand: bool = True
    """If false, nothing is known of it before the aircraft itself is `sensing_horizon_m` from its area."""


class DynamicThreatConfig(Section):
    """A moving threat: where it starts, what it can do, and what the simulated one does."""

    name: Name
    """Used in messages; tracks are told apart by their own identity."""
    east_m: Horizontal
    """Where the simulated one starts."""
    north_m: Horizontal
    """The same, north."""
    up_m: Vertical = 0.0
    """The same, up."""
    speed_m_s: Annotated[float, Field(ge=0.0, le=340.0)]
    """How fast it can drive."""
    max_threat_radius_m: Length
    """RD_max: within it, and in sight, it is a threat."""
    turn_radius_m: Length = 15.0
    """How tightly it turns."""
    behaviour: Literal["pursue", "drive", "stand"] = "pursue"
    """What the simulated one does: hunt the aircraft, drive its route, or stand; no plan is told."""
    route_enu_m: Annotated[tuple[tuple[Horizontal, Horizontal], ...], Field(max_length=1_000)] = ()
    """With `behaviour: drive`: east and north of the places it drives to in order; it stops at the last."""
    identity: Identity | None = None
    """As it is reported, `icao:00ABCD` say; left out, it is told by kind and place."""
    system_id: SystemId | None = None
    """The system that reports it; left out, any."""


class ObstacleConfig(Section):
    """An upright prism: corners [m] in order, each once, between base and top [m, up]."""

    name: Name
    """Used in messages."""
    polygon_enu_m: Annotated[
        tuple[tuple[Horizontal, Horizontal], ...], Field(min_length=3, max_length=10_000)
    ]
    """Corners, east and north, in order, each once."""
    base_m: Vertical
    """Height of its bottom."""
    top_m: Vertical
    """Height of its top."""


class Simulation(Section):
    """Weather of the simulator."""

    wind_speed_m_s: Annotated[float, Field(ge=0.0, le=100.0)] = 0.0
    """Mean wind."""
    wind_from_deg: CourseDegrees = 0.0
    """Where it comes from, clockwise from north."""
    turbulence: Literal["none", "light", "moderate"] = "none"
    """Dryden turbulence on top."""


class SigningConfig(Section):
    """MAVLink 2 signing: files of mode 0600, and the systems that are believed unsigned.

    ``timestamp_file`` left out: the key file's name with ``.times`` behind it.
    """

    key_file: Annotated[str, Field(min_length=1, max_length=1_000)]
    """Of 32 bytes as they are, or as 64 hexadecimal digits; mode 0600, where nobody else may replace it."""
    timestamp_file: Annotated[str, Field(min_length=1, max_length=1_000)] | None = None
    """Where the last time stamps are kept; left out, the key file's name with `.times` behind it."""
    link_id: Annotated[int, Field(ge=0, le=255)] = 0
    """Of our frames."""
    allow_unsigned: tuple[SystemId, ...] = ()
    """Systems that are believed without a signature."""
    allow_mavlink1: bool = False
    """Whether those may speak MAVLink 1, which has no signatures; all others never may."""


class LinkConfig(Section):
    """What is listened to.

    ``track_sources`` left out: tracks of every system but the own; ``systems`` left out: every system.
    ``source_rate_max_hz`` bounds the messages of each source but the own autopilot.
    """

    vehicle_system_id: SystemId | None = None
    """System id of the vehicle; left out, that of the first autopilot heard for a while."""
    parameter_sources: tuple[SystemId, ...] = (255,)
    """Systems that may set parameters of this service; ground stations are 255."""
    track_sources: tuple[SystemId, ...] | None = None
    """Systems whose sightings are believed; left out, every one but the own."""
    systems: tuple[SystemId, ...] | None = None
    """Systems that are listened to at all; left out, every one."""
    stream_rate_hz: Annotated[float, Field(gt=0.0, le=100.0)] = 10.0
    """At which the autopilot is asked for its state."""
    source_rate_max_hz: Annotated[float, Field(gt=0.0, le=100_000.0)] = 200.0
    """Messages taken of each source but the own autopilot."""
    signing: SigningConfig | None = None
    """MAVLink 2 signing; left out, nothing is signed or verified."""


class UseBy(Section):
    """Ages up to which what was heard is gone by; of what is older, the pilot hears.

    Without a position, or the item being flown, nothing is planned and no mission changed: what is flown
    stands. Bank, airspeed and wind are worked out from the rest instead.
    """

    position_s: Seconds = 1.5
    """Of the aircraft's position."""
    attitude_s: Seconds = 1.5
    """Of its attitude."""
    airspeed_s: Seconds = 1.5
    """Of its airspeed."""
    wind_s: Seconds = 30.0
    """Of the autopilot's estimate of the wind."""
    mission_item_s: Seconds = 5.0
    """Of the number of the item being flown."""
    track_s: Seconds = 10.0
    """Of a moving threat's position; it is believed to be wherever it could have got to since."""
    jump_confirm_s: Seconds = 30.0
    """How long a position that jumped has to go on without another jump, until it is believed."""


class Authority(Section):
    """What the service may do without asking the pilot.

    ``resume`` tells whether it goes on after the pilot has left the mission mode and come back;
    ``allow_rtl`` whether the last step of the emergency strategy may change the mode, where the way home
    keeps clear; ``keep_ready`` whether a mission is prepared in the autopilot while the pilot flies.
    """

    resume: Literal["auto", "never"] = "auto"
    """Whether the service goes on when the pilot, having left the mission mode, comes back to it."""
    allow_rtl: bool = False
    """Whether the last step of the emergency strategy may select return to launch."""
    keep_ready: bool = False
    """Whether, while the pilot flies, a checked mission is kept in the autopilot for the way back to AUTO."""


class Takeover(Section):
    """From when on, in the air, the service flies; until then the mission is the operator's.

    ``item`` belongs to ``when: item``, ``up_m`` to ``when: height``.
    """

    when: Literal["takeoff", "item", "height", "holding"] = "takeoff"
    """After the list's take-off item, after an item, above a height, or in the operator's holding circle."""
    item: Annotated[int, Field(ge=1, le=65_534)] | None = None
    """Number of the item that is flown by the operator to its end, as the ground station shows it."""
    up_m: Vertical | None = None
    """Height from which on it is taken over."""


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
    """Names the flight and its folder."""
    description: Annotated[str, Field(max_length=500)] = ""
    """For people."""
    dimension: Literal[2, 3]
    """`2`: the plan stays at the start's height; `3`: it climbs and descends."""
    unit_m: Annotated[float, Field(gt=0.0, le=10_000.0)]
    """Metres in one planning unit of the paper, to which the weights of its costs belong."""
    origin: Origin
    """WGS84 point at which east, north and up are zero."""
    bounds: Bounds
    """Box that plans stay in."""
    start: Start
    """Where an offline plan and the simulator begin."""
    goals: Annotated[tuple[Goal, ...], Field(max_length=1_000), BeforeValidator(_goals)]
    """A list, reached in its order, or `from_autopilot`: the waypoints of the mission in the autopilot."""
    vehicle: Annotated[Vehicle, BeforeValidator(_with_noise)]
    """What the aircraft can do."""
    planning: PlanningConfig
    """How plans are made and replaced."""
    radars: tuple[RadarConfig, ...] = ()
    """Static threats."""
    dynamic_threats: tuple[DynamicThreatConfig, ...] = ()
    """Moving threats: what kinds there are, and where simulated ones start."""
    obstacles: Annotated[tuple[ObstacleConfig, ...], Field(max_length=2_000)] = ()
    """Upright prisms to stay clear of."""
    simulation: Simulation = Simulation()
    """Weather of the simulator."""
    link: LinkConfig = LinkConfig()
    """What is listened to."""
    use_by: UseBy = UseBy()
    """Ages up to which what was heard is gone by."""
    authority: Authority = Authority()
    """What the service may do without asking the pilot."""
    takeover: Takeover = Takeover()
    """From when on, in the air, the service flies."""

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
                is_listed=entry.known_beforehand,
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
                identity=entry.identity or "",
                system_id=entry.system_id,
            )
            for entry in self.dynamic_threats
        )
