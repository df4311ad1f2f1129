"""The ground of a mission file: read once, for the planner, the check and the simulator."""

from __future__ import annotations

import functools
import math
from pathlib import Path

from companion.assurance.surroundings.ground_heights import GroundHeights
from companion.config.models import MissionConfig
from companion.config.sections.terrain_section import TerrainConfig
from companion.frames import LocalFrame
from companion.kernels.arrays import Ground
from companion.types.elevation import ElevationPosts
from companion.world.ground.autopilot_ground import AutopilotGround, ClimbAhead
from companion.world.ground.elevation_file import TerrainError, posts_over, read_posts
from companion.world.ground.generated_ground import generated_posts, sample_posts
from companion.world.ground.ground_cells import ground_cells, spacing_m
from companion.world.ground.served_heights import ServedHeights
from companion.world.obstacles import NO_GROUND

CACHED_MAPS_MAX = 4
SERVED_M = 6_000.0  # An autopilot is served heights up to this distance beyond the bounds.
WANTED_MORE_M = 10.0  # The default of height_wanted_m is height_min_m and this.
COARSE_M = 150.0  # Posts farther apart do not show the ground that an aircraft flies over.

__all__ = ["TerrainError", "ground_heights_of", "ground_of", "posts_of", "served_heights_of", "spacing_m"]


def posts_of(mission: MissionConfig) -> ElevationPosts | None:
    """Return the posts over the bounds and a little more; None without a section ``terrain``.

    Raises
    ------
    TerrainError
        If the map cannot be used.
    """
    if mission.terrain is None:
        return None
    return _posts(mission.terrain, mission.frame, _flat_bounds(mission))


def ground_of(mission: MissionConfig) -> Ground:
    """Return the ground for the planner; without a section ``terrain`` it lies too deep to matter.

    What is left over ground counts like a distance from an obstacle: it is ``clearance_min_m`` at the limits
    of height over ground.

    Raises
    ------
    TerrainError
        If the map cannot be used.
    """
    if mission.terrain is None:
        return NO_GROUND
    margin = float(mission.planning.clearance_min_m)
    return _ground(mission.terrain, mission.frame, _flat_bounds(mission), margin)


def ground_heights_of(mission: MissionConfig) -> GroundHeights | None:
    """Return the ground for the independent check; None without a section ``terrain``.

    Raises
    ------
    TerrainError
        If the map cannot be used.
    """
    terrain = mission.terrain
    if terrain is None:
        return None
    return _ground_heights(terrain, mission.frame, _flat_bounds(mission))


def served_heights_of(mission: MissionConfig) -> ServedHeights | None:
    """Return heights for an autopilot that asks; None without a section ``terrain``.

    A file is read some way beyond the bounds, as far as it reaches.
    """
    if mission.terrain is None:
        return None
    return ServedHeights(_wider_posts(mission.terrain, mission.frame, _flat_bounds(mission)))


def autopilot_ground_of(
    mission: MissionConfig, spacing_m: float, look_ahead: ClimbAhead
) -> AutopilotGround | None:
    """Return the ground as an ArduPilot stores it that was served; None without a section ``terrain``.

    Parameters
    ----------
    mission : MissionConfig
        The mission file.
    spacing_m : float
        Distance of the stored heights from each other [m].
    look_ahead : ClimbAhead
        How the autopilot climbs ahead of rising ground.
    """
    if mission.terrain is None:
        return None
    ground = _autopilot_ground(mission.terrain, mission.frame, _flat_bounds(mission), spacing_m)
    return ground.looking(look_ahead)


def _geoid_m(terrain: TerrainConfig) -> float:
    return float(terrain.geoid_height_m) if terrain.datum == "ellipsoid" else 0.0


def _flat_bounds(mission: MissionConfig) -> tuple[float, float, float, float]:
    east, north = mission.bounds.east_m, mission.bounds.north_m
    return float(east[0]), float(east[1]), float(north[0]), float(north[1])


@functools.lru_cache(maxsize=CACHED_MAPS_MAX)
def _posts(
    terrain: TerrainConfig, frame: LocalFrame, bounds: tuple[float, float, float, float]
) -> ElevationPosts:
    """Return the posts: of a file, those over the bounds and a few around."""
    posts = _wider_posts(terrain, frame, bounds)
    if terrain.file is not None:
        posts = posts_over(posts, bounds)
    apart = spacing_m(posts, bounds)
    if apart > COARSE_M:
        raise TerrainError(f"posts {apart:.0f} m apart", f"a map with posts at most {COARSE_M:.0f} m apart")
    return posts


@functools.lru_cache(maxsize=CACHED_MAPS_MAX)
def _wider_posts(
    terrain: TerrainConfig, frame: LocalFrame, bounds: tuple[float, float, float, float]
) -> ElevationPosts:
    """Read a file some way beyond the bounds, as far as it reaches, or compute posts."""
    if terrain.generated is not None:
        generated = terrain.generated
        return generated_posts(generated.kind, generated.seed, generated.relief_m, frame, bounds)
    if terrain.sample is not None:
        return sample_posts(frame)
    return read_posts(Path(terrain.file or ""), frame, bounds, _geoid_m(terrain), beyond_m=SERVED_M)


@functools.lru_cache(maxsize=CACHED_MAPS_MAX)
def _autopilot_ground(
    terrain: TerrainConfig, frame: LocalFrame, bounds: tuple[float, float, float, float], spacing_m: float
) -> AutopilotGround:
    """Return the ground as an ArduPilot stores it."""
    return AutopilotGround(ServedHeights(_wider_posts(terrain, frame, bounds)), frame, bounds, spacing_m)


@functools.lru_cache(maxsize=CACHED_MAPS_MAX)
def _ground(
    terrain: TerrainConfig, frame: LocalFrame, bounds: tuple[float, float, float, float], margin_m: float
) -> Ground:
    """Return the cells of the ground."""
    least, most = float(terrain.height_min_m), terrain.height_max_m
    wanted = terrain.height_wanted_m or min(least + WANTED_MORE_M, most or math.inf)
    return ground_cells(
        _posts(terrain, frame, bounds),
        bounds,
        least_m=least - margin_m,
        wanted_m=float(wanted),
        most_m=math.inf if most is None else float(most) + margin_m,
        drivable=math.tan(math.radians(terrain.drivable_slope_deg)),
    )


@functools.lru_cache(maxsize=CACHED_MAPS_MAX)
def _ground_heights(
    terrain: TerrainConfig, frame: LocalFrame, bounds: tuple[float, float, float, float]
) -> GroundHeights:
    """Return the ground for the independent check."""
    most = math.inf if terrain.height_max_m is None else float(terrain.height_max_m)
    return GroundHeights(_posts(terrain, frame, bounds), float(terrain.height_min_m), most)
