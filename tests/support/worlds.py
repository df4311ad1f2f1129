"""Small worlds, planner problems and plain oracles for tests."""

import functools
import math

import numpy as np
import shapely

from companion.kernels.arrays import DistanceField, Scene, ThreatModel, empty_pursuers
from companion.kernels.workspace import workspace
from companion.planning.problem import GoalRegion, Problem, StartState, initial_covariances
from companion.planning.settings import PlannerSettings
from companion.types.threat import TrackState
from companion.world.obstacles import packed_obstacles
from companion.world.pursuit import pursuit_game
from companion.world.snapshot import first_snapshot
from companion.world.threats import packed_threats
from companion.world.vehicle.lqg import uncertainty_tables
from companion.world.vehicle.vehicle_model import VehicleModel

BOUNDS = (0.0, 1500.0, 0.0, 1500.0, 50.0, 250.0)
VEHICLE = VehicleModel()
SHIFTED, LITERAL, PROBABILISTIC = 0, 1, 2


@functools.cache
def tables(dimension):
    """LQG-MP tables of the vehicle, made once for all tests."""
    return uncertainty_tables(VEHICLE, 1.0, dimension)


def packed(obstacles, bounds=(-600.0, 600.0, -600.0, 600.0, 0.0, 300.0)):
    return packed_obstacles(obstacles, bounds)


def threat_model(form=SHIFTED, **changes):
    values = {
        "weight_count": 0.7,
        "weight_delta": 0.3,
        "exponent": 1.0,
        "form": form,
        "v_min": 12.5,
        "v_max": 37.5,
        "v_penetration": 25.0,
        "unit": 25.0,
    }
    return ThreatModel(**{**values, **changes})


def scene_of(limits, *, obstacles=None, threats=None, pursuers=None, model=None, search=None, bounds=None):
    """What kernels read; nothing in the way and nothing that threatens where it is not given."""
    bounds = tuple(limits.bounds) if bounds is None else bounds
    obstacles = packed([], bounds) if obstacles is None else obstacles
    if pursuers is None:
        pursuers = empty_pursuers(1, np.empty((0, 5)), np.array(bounds))
    return Scene(
        pursuers=pursuers,
        obstacles=obstacles,
        walls=obstacles,
        threats=packed_threats([], obstacles, bounds) if threats is None else threats,
        model=threat_model() if model is None else model,
        limits=limits,
        tables=tables(limits.dimension),
        search=small_settings().search(limits, 25.0, 100.0, bars_pursued=False) if search is None else search,
        distances=DistanceField(np.full((1, 1), np.inf), np.zeros(2), 1.0, 0.0, 0.0),
        game=pursuit_game((), obstacles, None, bounds, 0.0),
    )


def work_for(capacity, num_threats=0):
    """Scratch for a tree of so many nodes, with the vehicle's particles."""
    return workspace(capacity, num_threats, len(tables(2).normals))


def track(east, north, *, speed=20.0, radius=200.0, velocity=(0.0, 0.0), airborne=False, up=0.0, stamp=0.0):
    return TrackState(
        stamp,
        "system:42",
        (east, north, up),
        (*velocity, 0.0),
        np.eye(4),
        speed,
        radius,
        15.0,
        airborne,
        stamp,
    )


def small_settings(**changes):
    values = {
        "sensing_horizon_m": 600.0,
        "max_iterations": 12_000,
        "sub_task_iterations": 1000,
        "optimise_iterations": 60,
        "tree_capacity": 2500,
    }
    return PlannerSettings(**{**values, **changes})


def problem(
    obstacles=(),
    radars=(),
    tracks=(),
    *,
    dimension=2,
    start=(100.0, 100.0, 150.0),
    direction=math.pi / 4,
    goal=(1350.0, 1350.0, 150.0),
    seed=1,
    bounds=BOUNDS,
    **changes,
):
    snapshot = first_snapshot(
        dimension=dimension, unit_m=25.0, bounds=bounds, obstacles=obstacles, radars=radars
    )
    if tracks:
        snapshot = snapshot.with_tracks(0.0, tracks)
    asked = small_settings(**changes)
    snapshot = snapshot.with_known(snapshot.sensed(*start[:2], asked.sensing_horizon_m))
    covariance = initial_covariances(VEHICLE, 2.0, 2.0)
    begin = StartState(0.0, start, direction, 0.0, 25.0, covariance, np.zeros((6, 6)))
    return Problem(begin, (GoalRegion(goal, 60.0),), snapshot, VEHICLE, asked, seed)


def is_blocked(p, q, obstacles):
    """Whether a segment meets a prism: its piece between base and top against the polygon, by shapely."""
    p, q = np.asarray(p, dtype=float), np.asarray(q, dtype=float)
    for obstacle in obstacles:
        low, high = 0.0, 1.0
        rise = q[2] - p[2]
        if abs(rise) < 1e-12:
            if not obstacle.base_m <= p[2] <= obstacle.top_m:
                continue
        else:
            fractions = sorted(((obstacle.base_m - p[2]) / rise, (obstacle.top_m - p[2]) / rise))
            low, high = max(low, fractions[0]), min(high, fractions[1])
            if low > high:
                continue
        ends = np.array([p + low * (q - p), p + high * (q - p)])[:, :2]
        shape = shapely.Point(ends[0]) if np.array_equal(*ends) else shapely.LineString(ends)
        if shapely.Polygon(obstacle.polygon_enu_m).intersects(shape):
            return True
    return False
