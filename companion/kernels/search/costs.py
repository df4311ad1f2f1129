"""The cost of a step (paper 4.4.1, formula (9)).

Symbols: ``p`` the state a step begins in, ``i`` a node's row.
"""

from __future__ import annotations

import math

from companion.kernels.aircraft.motion import wrapped
from companion.kernels.arrays import Float1D, Float2D, Scene, Search, Tree
from companion.kernels.native.kernel import inlined, kernel
from companion.kernels.threat.fuzzy_threat import line_threat
from companion.kernels.workspace import ThreatScene, ThreatScratch


@kernel
def turn_cost(state: Float1D, x: float, y: float, z: float) -> float:
    """P_y of (9): absolute course change plus climb angle from ``state`` (6,) to a point [rad].

    Descent is free.
    """
    dx, dy, dz = x - state[0], y - state[1], z - state[2]
    flat = math.sqrt(dx * dx + dy * dy)
    yaw = abs(wrapped(math.atan2(dy, dx) - state[3]))
    return min(math.pi, yaw + max(0.0, math.atan2(dz, flat)))


@inlined
def threats_at(scene: Scene, points: Float2D, scratch: ThreatScratch) -> ThreatScene:
    """Return the threats while the DTs are at ``points`` (D, 4) [m]."""
    return ThreatScene(scene.threats, points, scene.pursuers.reach, scene.model, scratch)


@inlined
def threats_when(tree: Tree, i: int, threats: ThreatScene) -> ThreatScene:
    """Return the same threats with the DTs where they can be when node ``i`` is reached."""
    return ThreatScene(threats.threats, tree.threat_point[i], threats.reach, threats.model, threats.scratch)


@kernel
def step_cost(
    p: Float1D, x: float, y: float, z: float, delta: float, search: Search, threats: ThreatScene
) -> float:
    """D_C of (9) from the state ``p`` (6,) to a point, lengths in planning units."""
    d = math.sqrt((x - p[0]) ** 2 + (y - p[1]) ** 2 + (z - p[2]) ** 2) / search.unit
    level = line_threat(p, x, y, z, p[5], delta, search.secondary, threats)
    return search.cost_distance * d + search.cost_turn * turn_cost(p, x, y, z) + search.cost_threat * level


@kernel
def cost_distance(
    tree: Tree, i: int, x: float, y: float, z: float, search: Search, threats: ThreatScene
) -> float:
    """:func:`step_cost` from node ``i``, with the DTs where they can be when it is reached."""
    return step_cost(tree.state[i], x, y, z, tree.delta[i], search, threats_when(tree, i, threats))
