"""Relations between keys of a mission file. Each check yields the wrong key and what is expected of it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
import shapely

from companion.config.models import Goal, MissionConfig, ObstacleConfig, Start
from companion.config.sections.glide_section import FieldConfig
from companion.config.sections.terrain_section import TerrainConfig
from companion.config.source import KeyPath
from companion.errors import ThreatModelError
from companion.frames import FloatArray
from companion.kernels.arrays import Ground
from companion.mission.team.wire import SHARED_GOALS_MAX
from companion.planning.plugins.installed_planners import method_fault
from companion.planning.plugins.installed_threats import InstalledSight
from companion.world.ground.cell_lookup import cell_at
from companion.world.vehicle.energy import level_power_range

Finding = tuple[KeyPath, str]

_GRAVITY_M_S2 = 9.80665
_BANK_MAX_RAD = math.radians(60.0)  # Load factor 2; no autopilot's default exceeds it.
_AREA_MIN_M2 = 1e-3
MAP_TOLERANCE_M = 3.0  # A radar may lie this far below the ground of the map, which is not exact.
MODEL_TRIALS = 33  # Places along each side of the bounds at which a radar's model is tried.
ROUNDED = 0.005  # Rounding to three digits changes a number by at most this share.


def findings(config: MissionConfig) -> Iterator[Finding]:
    """Yield everything in a mission that contradicts another key, in the order of the file."""
    yield from _bounds(config)
    yield from _points_in_bounds(config)
    yield from _vehicle(config)
    yield from _planning(config)
    yield from _radars(config)
    yield from _names(config)
    yield from _obstacles(config)
    yield from _routes(config)
    yield from _points_in_obstacles(config)
    yield from _weather(config)
    yield from _takeover(config)
    yield from _energy(config)
    yield from _glide(config)
    yield from _team(config)
    yield from _terrain(config)


def _energy(config: MissionConfig) -> Iterator[Finding]:
    energy, vehicle = config.energy, config.vehicle
    if energy is None:
        if config.authority.turn_back:
            yield ("authority", "turn_back"), "false, since there is no section energy"
        return
    cruise, fastest = vehicle.airspeed_cruise_m_s, vehicle.airspeed_max_m_s
    if not cruise < fastest:
        expected = f"above airspeed_cruise_m_s, {cruise:g}: energy needs the power of two airspeeds"
        yield ("vehicle", "airspeed_max_m_s"), expected
        return
    low, high = level_power_range(cruise, energy.power_cruise_w, fastest)
    if not (1.0 - ROUNDED) * low <= energy.power_max_airspeed_w <= (1.0 + ROUNDED) * high:
        yield (
            ("energy", "power_max_airspeed_w"),
            f"between {low:.4g} and {high:.4g}: with power_cruise_w, {energy.power_cruise_w:g}, "
            "any other needs a negative drag",
        )
    if energy.reserve_wh > energy.capacity_wh:
        yield ("energy", "reserve_wh"), f"at most capacity_wh, {energy.capacity_wh:g}"


def _team(config: MissionConfig) -> Iterator[Finding]:
    members = config.team_members
    for index, member in enumerate(members):
        if member in members[:index]:
            yield ("team", "members", index), "each member once"
    if not config.shares_goals:
        return
    if not 1 <= len(config.goals) <= SHARED_GOALS_MAX:
        yield ("team", "share_goals"), f"1 to {SHARED_GOALS_MAX} goals in the mission file"
    places = [(goal.east_m, goal.north_m, goal.up_m) for goal in config.goals]
    for index, place in enumerate(places):
        if place in places[:index]:
            yield ("goals", index), "each shared goal once"


def _glide(config: MissionConfig) -> Iterator[Finding]:
    glide, vehicle = config.glide, config.vehicle
    if glide is None:
        if config.authority.glide:
            yield ("authority", "glide"), "a section glide as well: it says where to glide to"
        return
    low, cruise = vehicle.airspeed_min_m_s, vehicle.airspeed_cruise_m_s
    if not low <= glide.airspeed_m_s <= cruise:
        expected = f"between airspeed_min_m_s and airspeed_cruise_m_s, {low:g} to {cruise:g}"
        yield ("glide", "airspeed_m_s"), expected
    if config.simulation.wind_speed_m_s >= glide.airspeed_m_s:
        yield ("glide", "airspeed_m_s"), f"above the wind, {config.simulation.wind_speed_m_s:g}"
    areas = []
    for index, area in enumerate(glide.people):
        fault = _polygon_fault(area.polygon_enu_m)
        if fault is not None:
            yield ("glide", "people", index, "polygon_enu_m"), fault
        else:
            areas.append((area.name, shapely.Polygon(area.polygon_enu_m)))
    for index, place in enumerate(glide.fields):
        yield from _field_over_ground(config, index, place)
        for name, polygon in areas:
            if polygon.distance(shapely.Point(place.east_m, place.north_m)) <= place.radius_m:
                yield ("glide", "fields", index), f"a circle wholly outside of people, {name!r}"
        for obstacle in config.obstacles:
            if _is_inside(place, obstacle):
                yield ("glide", "fields", index), f"a point outside the obstacle {obstacle.name!r}"


def _field_over_ground(config: MissionConfig, index: int, place: FieldConfig) -> Iterator[Finding]:
    """Check that a field's height is given where no map has it, and that the map reaches there."""
    if (place.up_m is None) is (config.terrain is None):
        expected = "a height, since there is no section terrain"
        if config.terrain is not None:
            expected = "left out, since the map of the section terrain has it"
        yield ("glide", "fields", index, "up_m"), expected
    for key in ("east_m", "north_m"):
        low, high = getattr(config.bounds, key)
        if config.terrain is not None and not low <= getattr(place, key) <= high:
            yield ("glide", "fields", index, key), f"within bounds.{key}, {low:g} to {high:g}"


def _terrain(config: MissionConfig) -> Iterator[Finding]:
    terrain = config.terrain
    if terrain is None:
        return
    sources = [key for key in ("file", "generated", "sample") if getattr(terrain, key) is not None]
    if len(sources) != 1:
        yield ("terrain",), "one of file, generated and sample"
        return
    yield from _heights_over_ground(config, terrain)
    # Many commands read no map, and PROJ takes long to import.
    from companion.config.sections.terrain_map import TerrainError, ground_of  # noqa: PLC0415

    try:
        ground = ground_of(config)
    except TerrainError as error:
        yield ("terrain", sources[0]), f"{error.expected}; found: {error.got}"
        return
    yield from _over_ground(config, ground)
    yield from _radars_over_ground(config, ground)


def _heights_over_ground(config: MissionConfig, terrain: TerrainConfig) -> Iterator[Finding]:
    least, most, wanted = terrain.height_min_m, terrain.height_max_m, terrain.height_wanted_m
    if least < config.planning.clearance_min_m:
        yield ("terrain", "height_min_m"), f"at least clearance_min_m, {config.planning.clearance_min_m:g}"
    if most is not None and most <= least:
        yield ("terrain", "height_max_m"), f"above height_min_m, {least:g}"
    if wanted is not None and not least <= wanted <= (math.inf if most is None else most):
        yield ("terrain", "height_wanted_m"), "between height_min_m and height_max_m"


def _over_ground(config: MissionConfig, ground: Ground) -> Iterator[Finding]:
    """Check start and goals against the highest and the lowest ground of their cells."""
    places: list[tuple[KeyPath, Start | Goal]] = [(("start",), config.start)]
    places += [(("goals", index), goal) for index, goal in enumerate(config.goals)]
    margin = config.planning.clearance_min_m
    for path, place in places:
        cell = cell_at(ground, place.east_m, place.north_m)
        low, high = ground.high[cell] + ground.least + margin, ground.low[cell] + ground.most - margin
        if not low <= place.up_m <= high:
            limits = f"{math.ceil(low)}" + ("" if math.isinf(high) else f" to {math.floor(high)}")
            yield (*path, "up_m"), f"a height over ground within its limits: {limits}"


def _radars_over_ground(config: MissionConfig, ground: Ground) -> Iterator[Finding]:
    """Check that no radar within the bounds lies below the ground: it would see nothing."""
    (west, east), (south, north) = config.bounds.east_m, config.bounds.north_m
    for index, radar in enumerate(config.radars):
        low = float(ground.low[cell_at(ground, radar.east_m, radar.north_m)])
        is_mapped = west <= radar.east_m <= east and south <= radar.north_m <= north
        if is_mapped and radar.up_m < low - MAP_TOLERANCE_M:
            yield ("radars", index, "up_m"), f"at least the height of the ground there, {math.ceil(low)}"


def _takeover(config: MissionConfig) -> Iterator[Finding]:
    takeover = config.takeover
    for key, when in (("item", "item"), ("up_m", "height")):
        is_given, is_wanted = getattr(takeover, key) is not None, takeover.when == when
        if is_given is not is_wanted:
            expected = "given" if is_wanted else "left out"
            yield ("takeover", key), f"{expected}, since takeover.when is {takeover.when}"
    if takeover.up_m is not None and not config.bounds.up_m[0] <= takeover.up_m <= config.bounds.up_m[1]:
        low, high = config.bounds.up_m
        yield ("takeover", "up_m"), f"within bounds.up_m, {low:g} to {high:g}"


def _bounds(config: MissionConfig) -> Iterator[Finding]:
    for key in ("east_m", "north_m", "up_m"):
        low, high = getattr(config.bounds, key)
        if not low < high:
            yield ("bounds", key), "the lowest value, then a higher one"


def _points_in_bounds(config: MissionConfig) -> Iterator[Finding]:
    places: list[tuple[KeyPath, Start | Goal]] = [(("start",), config.start)]
    places += [(("goals", index), goal) for index, goal in enumerate(config.goals)]
    for path, place in places:
        for key in ("east_m", "north_m", "up_m"):
            low, high = getattr(config.bounds, key)
            if not low <= getattr(place, key) <= high:
                yield (*path, key), f"within bounds.{key}, {low:g} to {high:g}"
    for index, goal in enumerate(config.goals):
        if config.dimension == 2 and goal.up_m != config.start.up_m:
            yield ("goals", index, "up_m"), f"the start's up_m, {config.start.up_m:g}, since dimension is 2"


def _vehicle(config: MissionConfig) -> Iterator[Finding]:
    vehicle = config.vehicle
    low, high = vehicle.airspeed_min_m_s, vehicle.airspeed_max_m_s
    if low > high:
        yield ("vehicle", "airspeed_min_m_s"), f"at most airspeed_max_m_s, {high:g}"
    for key in ("airspeed_cruise_m_s", "penetration_speed_m_s"):
        if not low <= getattr(vehicle, key) <= high:
            yield ("vehicle", key), f"between airspeed_min_m_s and airspeed_max_m_s, {low:g} to {high:g}"
    fast, cruise = vehicle.airspeed_fast_m_s, vehicle.airspeed_cruise_m_s
    if fast is not None and not cruise <= fast <= high:
        yield (
            ("vehicle", "airspeed_fast_m_s"),
            f"between airspeed_cruise_m_s and airspeed_max_m_s, {cruise:g} to {high:g}",
        )
    tightest = vehicle.airspeed_cruise_m_s**2 / (_GRAVITY_M_S2 * math.tan(_BANK_MAX_RAD))
    if vehicle.turn_radius_min_m < tightest:
        yield (
            ("vehicle", "turn_radius_min_m"),
            f"at least {tightest:.1f}: at airspeed_cruise_m_s tighter turns need over 60 degrees of bank",
        )


def _planning(config: MissionConfig) -> Iterator[Finding]:
    planning = config.planning
    if expected := method_fault(planning.method):
        yield ("planning", "method"), expected
    diameter = 2.0 * config.vehicle.turn_radius_min_m
    if planning.sensing_horizon_m <= diameter:
        yield (
            ("planning", "sensing_horizon_m"),
            f"more than twice vehicle.turn_radius_min_m, {diameter:g}: room to turn back",
        )
    if planning.total_planning_time_s < planning.time_horizon_s:
        yield (
            ("planning", "total_planning_time_s"),
            f"at least time_horizon_s, {planning.time_horizon_s:g}",
        )
    if planning.planning_budget_s + planning.swap_margin_s >= planning.time_horizon_s:
        key = "planning_budget_s" if "planning_budget_s" in planning.model_fields_set else "time_horizon_s"
        yield (
            ("planning", key),
            "planning_budget_s and swap_margin_s together below time_horizon_s: "
            "a plan must be ready before the next is due",
        )


def _radars(config: MissionConfig) -> Iterator[Finding]:
    for index, entry in enumerate(config.radars):
        if entry.model_values and not entry.model:
            yield ("radars", index, "model_values"), "left out, since the radar has no model"
        try:
            sight = entry.radar().lowest_seen_m
            if isinstance(sight, InstalledSight):
                sight.lowest_seen_m(_trial_places(config))
        except ThreatModelError as error:
            yield ("radars", index, "model"), f"a model that works: {error}"


def _trial_places(config: MissionConfig) -> FloatArray:
    """Return places (N, 2) over the bounds at which a radar's model is tried [m]."""
    sides = (np.linspace(*limits, MODEL_TRIALS) for limits in (config.bounds.east_m, config.bounds.north_m))
    return np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)


def _names(config: MissionConfig) -> Iterator[Finding]:
    kinds = {
        "radars": [entry.name for entry in config.radars],
        "dynamic_threats": [entry.name for entry in config.dynamic_threats],
        "obstacles": [entry.name for entry in config.obstacles],
    }
    for kind, names in kinds.items():
        yield from _names_apart((kind,), names)
    if config.glide is not None:
        yield from _names_apart(("glide", "fields"), [entry.name for entry in config.glide.fields])
        yield from _names_apart(("glide", "people"), [entry.name for entry in config.glide.people])


def _names_apart(path: KeyPath, names: Sequence[str]) -> Iterator[Finding]:
    firsts: dict[str, int] = {}
    for index, name in enumerate(names):
        first = firsts.setdefault(name, index)
        if first < index:
            where = ".".join(map(str, path))
            yield (*path, index, "name"), f"a name of its own; {where}.{first} has this one"


def _obstacles(config: MissionConfig) -> Iterator[Finding]:
    for index, obstacle in enumerate(config.obstacles):
        expected = _polygon_fault(obstacle.polygon_enu_m)
        if expected is not None:
            yield ("obstacles", index, "polygon_enu_m"), expected
        if not obstacle.base_m < obstacle.top_m:
            yield ("obstacles", index, "base_m"), f"below top_m, {obstacle.top_m:g}"


def _routes(config: MissionConfig) -> Iterator[Finding]:
    for index, threat in enumerate(config.dynamic_threats):
        path: KeyPath = ("dynamic_threats", index)
        is_given, is_wanted = bool(threat.route_enu_m), threat.behaviour == "drive"
        if is_given is not is_wanted:
            expected = "at least one place" if is_wanted else "left out"
            yield (
                ("dynamic_threats", index, "route_enu_m"),
                f"{expected}, since behaviour is {threat.behaviour}",
            )
        elif is_given:
            way = shapely.LineString([(threat.east_m, threat.north_m), *threat.route_enu_m])
            for obstacle in config.obstacles:
                if obstacle.base_m <= 0.0 and way.intersects(shapely.Polygon(obstacle.polygon_enu_m)):
                    yield (*path, "route_enu_m"), f"straight legs clear of the obstacle {obstacle.name!r}"


def _polygon_fault(corners: Sequence[tuple[float, float]]) -> str | None:
    following = (*corners[1:], corners[0])
    if any(corner == other for corner, other in zip(corners, following, strict=True)):
        return "each corner once, the first not repeated at the end"
    polygon = shapely.Polygon(corners)
    if polygon.convex_hull.area < _AREA_MIN_M2:
        return "corners that enclose an area"
    if not polygon.is_valid:
        return f"edges that do not cross or touch ({shapely.is_valid_reason(polygon)})"
    return None


def _points_in_obstacles(config: MissionConfig) -> Iterator[Finding]:
    places: list[tuple[KeyPath, Start | Goal]] = [(("start",), config.start)]
    places += [(("goals", index), goal) for index, goal in enumerate(config.goals)]
    for path, place in places:
        for obstacle in config.obstacles:
            if _is_inside(place, obstacle):
                yield path, f"a point outside the obstacle {obstacle.name!r}"


def _is_inside(place: Start | Goal | FieldConfig, obstacle: ObstacleConfig) -> bool:
    if place.up_m is not None and not obstacle.base_m <= place.up_m <= obstacle.top_m:
        return False
    polygon = shapely.Polygon(obstacle.polygon_enu_m)
    return bool(polygon.covers(shapely.Point(place.east_m, place.north_m)))


def _weather(config: MissionConfig) -> Iterator[Finding]:
    cruise = config.vehicle.airspeed_cruise_m_s
    if config.simulation.wind_speed_m_s >= cruise:
        yield (
            ("simulation", "wind_speed_m_s"),
            f"less than vehicle.airspeed_cruise_m_s, {cruise:g}: the aircraft must make headway",
        )
