"""Costs of candidate sub goals (paper 4.2, formulas (4)–(6))."""

from __future__ import annotations

import math

import numpy as np

from companion.kernels.arrays import (
    DistanceField,
    Float1D,
    Float2D,
    Int1D,
    Limits,
    Obstacles,
    Pursuers,
    Scene,
    Threats,
)
from companion.kernels.geometry.distance_field import fill_distance_field
from companion.kernels.geometry.prism_distance import boxes_on_segment, clearance, distance_to_edge_squared
from companion.kernels.native.kernel import kernel
from companion.kernels.native.struct import Struct
from companion.kernels.threat.fuzzy_threat import point_threat
from companion.kernels.workspace import ThreatScene, threat_scene

FREE, OCCUPIED, CONSTRAINED, HIGH_RISK = 0, 1, 2, 3
FIELD_CELLS = 49  # Cells along each side of the distance field's square grid.
DETOUR_MAX = 1.25  # A candidate farther than this many horizons around obstacles is removed.
CLIMB_SHARE = 0.8  # This share of the climb angle remains for the path from a sub goal to the goal.


class Candidates(Struct):
    """Points of the horizon: ``points`` (S, 3) [m], what each costs, ``costs`` (S,), and why it is removed,
    ``reasons`` (S,).
    """  # noqa: D205

    points: Float2D
    costs: Float1D
    reasons: Int1D


class SubGoalWeights(Struct):
    """``gamma`` (4,) C_γ of (5); ``lengths`` (3,) L_γ of (6); ``level_max`` of a sub goal's threat."""

    gamma: Float1D
    lengths: Float1D
    level_max: float


class SubGoalScratch(Struct):
    """The scratch that the scores of sub goals need.

    ``distances`` is the field of the horizon's centre and ``radius`` the horizon's [m]. ``threats`` are
    those at the moment. ``boxes`` (O + 1, 2) is overwritten.
    """

    distances: DistanceField
    threats: ThreatScene
    radius: float
    boxes: Float2D


@kernel
def obstructed_length(
    p: Float1D, q: Float1D, obstacles: Obstacles, weights: Float1D, unit: float, scratch: Float2D
) -> float:
    """L of (6) from ``p`` (≥ 3,) to ``q`` (≥ 3,) [m], in planning units.

    Weighted length, heights and widths of the bounding boxes crossed, by ``weights`` (3,); ``scratch``
    (O, 2) is overwritten.
    """
    px, py, pz, qx, qy, qz = p[0], p[1], p[2], q[0], q[1], q[2]
    length = math.sqrt((qx - px) ** 2 + (qy - py) ** 2 + (qz - pz) ** 2)
    total = weights[0] * length
    for b in range(boxes_on_segment(px, py, pz, qx, qy, qz, obstacles, scratch)):
        total += weights[1] * scratch[b, 0] + weights[2] * scratch[b, 1]
    return total / unit


@kernel
def is_on_the_way(above: float, flat: float, limits: Limits) -> bool:
    """Return whether a goal ``flat`` metres away and ``above`` metres lower is within the climb angles."""
    if limits.dimension == 2:
        return True
    climb, descent = CLIMB_SHARE * limits.climb_max, CLIMB_SHARE * limits.descent_max
    return -flat * math.tan(climb) <= above <= flat * math.tan(descent)


@kernel
def radii_crossed(end: Float1D, x: float, y: float, threats: Threats, unit: float) -> tuple[float, int]:
    """Return the summed radii of known radars on the line from ``end`` (≥ 2,) [m] to a place, and how many.

    In planning units.
    """
    radii, crossed = 0.0, 0
    for r in range(threats.radars.shape[0]):
        r_max = threats.radars[r, 3]
        away = distance_to_edge_squared(threats.radars[r, 0], threats.radars[r, 1], end[0], end[1], x, y)
        if threats.known[r] == 1 and away <= r_max * r_max:
            radii += r_max / unit
            crossed += 1
    return radii, crossed


@kernel
def dynamic_radius(end: Float1D, x: float, y: float, later: float, pursuers: Pursuers, unit: float) -> float:
    """R_D of (5): how far the worst DT whose area the line from ``end`` (≥ 2,) [m] crosses comes by then.

    ``later`` seconds after the plan begins.
    """
    worst = 0.0
    for d in range(pursuers.count.shape[0]):
        at, reach = pursuers.position[d, 0], pursuers.reach[d]
        away = distance_to_edge_squared(at[0], at[1], end[0], end[1], x, y)
        if away <= reach * reach:
            gone = pursuers.model[d, 0] * later / unit
            worst = max(worst, math.sqrt(gone))
    return worst


@kernel
def why_removed(
    p: Float1D, end: Float1D, goal: Float1D, radius: float, level: float, level_max: float,
    distances: DistanceField, scene: Scene,
) -> int:  # fmt: skip
    """``FREE``, or the first reason to remove the point ``p`` (3,) [m].

    ``end`` (6,) state at the end of the last local path, ``goal`` (3,) [m], ``radius`` of the horizon [m];
    ``level`` of threat at the point.

    The paper leaves open which flight constraints remove a point. Here: bounds, climb and descent
    angle to it and (:func:`is_on_the_way`) from it, and a way round obstacles inside the horizon.
    """
    limits, b = scene.limits, scene.limits.bounds
    x, y, z = p[0], p[1], p[2]
    dx, dy, dz = x - end[0], y - end[1], z - end[2]
    phi = math.atan2(dz, math.sqrt(dx * dx + dy * dy))
    if clearance(x, y, z, scene.obstacles, 2.0 * limits.margin + 1.0) < limits.margin:
        return OCCUPIED
    if not (b[0] <= x <= b[1] and b[2] <= y <= b[3] and b[4] <= z <= b[5]):
        return CONSTRAINED
    if phi > limits.climb_max + 1e-9 or phi < -limits.descent_max - 1e-9:
        return CONSTRAINED
    if not is_on_the_way(z - goal[2], math.hypot(goal[0] - x, goal[1] - y), limits):
        return CONSTRAINED
    if distances.field[
        int(round((x - end[0] + radius) / distances.cell)), int(round((y - end[1] + radius) / distances.cell))
    ] > (DETOUR_MAX * radius):
        return CONSTRAINED
    return HIGH_RISK if level > level_max else FREE


def score(
    candidates: Candidates, end: Float1D, goal: Float1D, elapsed: float, weights: SubGoalWeights,
    scene: Scene,
) -> None:  # fmt: skip
    """Cost (5) of every candidate and why it is removed, if it is; a removed one keeps its cost.

    ``end`` (6,) state at the end of the last local path, reached after ``elapsed`` seconds; ``goal`` (3,)
    [m]. The DTs are taken to be where their trees begin.
    """
    radius, pursuers = float(np.linalg.norm(candidates.points[0] - end[:3])), scene.pursuers
    field, cell = np.empty((FIELD_CELLS, FIELD_CELLS)), 2.0 * radius / (FIELD_CELLS - 1)
    distances = DistanceField(field, end[:2] - radius, cell, 0.0, 0.0)
    fill_distance_field(end, radius, scene.limits.margin, scene.limits.bounds, scene.obstacles, distances)
    positions = np.ones((len(pursuers.count), 4))
    positions[:, :3] = pursuers.position[:, 0]
    threats = threat_scene(scene.threats, positions, pursuers.reach, scene.model)
    scratch = np.empty((len(scene.obstacles.heights) + 1, 2))
    fill_scores(
        candidates, end, goal, elapsed, weights, scene, SubGoalScratch(distances, threats, radius, scratch)
    )


@kernel
def fill_scores(
    candidates: Candidates, end: Float1D, goal: Float1D, elapsed: float, weights: SubGoalWeights,
    scene: Scene, work: SubGoalScratch,
) -> None:  # fmt: skip
    """:func:`score` with what it needs: ``end`` (6,) and ``goal`` (3,) as there."""
    points, gamma, pursuers, distances = candidates.points, weights.gamma, scene.pursuers, work.distances
    obstacles, model, limits, scratch = scene.obstacles, scene.model, scene.limits, work.boxes
    for s in range(points.shape[0]):
        p = points[s]
        x, y, z = p[0], p[1], p[2]
        dx, dy, dz = x - end[0], y - end[1], z - end[2]
        flat = math.sqrt(dx * dx + dy * dy)
        length = math.sqrt(flat * flat + dz * dz)
        cost = gamma[0] * obstructed_length(end, p, obstacles, weights.lengths, model.unit, scratch)
        cost += gamma[1] * obstructed_length(p, goal, obstacles, weights.lengths, model.unit, scratch)
        radii, crossed = radii_crossed(end, x, y, scene.threats, model.unit)
        if crossed > 0:
            cost += gamma[2] * radii / crossed
        later = elapsed + length / max(end[5], 1.0)
        candidates.costs[s] = cost + gamma[3] * dynamic_radius(end, x, y, later, pursuers, model.unit)
        mu, nu = point_threat(
            x, y, z, math.atan2(dy, dx), math.atan2(dz, flat), limits.v_cruise, 0.0, work.threats
        )
        level = mu - nu
        reason = why_removed(p, end, goal, work.radius, level, weights.level_max, distances, scene)
        candidates.reasons[s] = reason
