"""The test whether a DT reaches a node through one node of its tree (paper 3.2.2, Fig. 2).

A PathTree node is *reachable* through a TTree node when some point ``q_B`` at the distance RD_max from
it is seen from it, lies on a free straight way from the TTree node and is reached in time. A DT on the
ground has its ``q_B`` on the horizontal circle about the node's ground projection. An airborne one has
a sphere about the node: it climbs or sinks towards the node's height as far as its time allows, and
``q_B`` lies on the sphere's circle at that height.

Symbols: ``p`` a TTree node, ``(x, y, z)`` a PathTree node, ``v`` the DT's speed, ``slack`` the time between
the two nodes' time stamps.
"""

from __future__ import annotations

import math

from companion.kernels.aircraft.dubins import distance_to_point
from companion.kernels.arrays import Float1D, Obstacles
from companion.kernels.geometry.line_of_sight import line_blocked
from companion.kernels.native.kernel import kernel_numpy_errors

NUM_BEARINGS = 16  # Bearings at which q_B is sought, first those nearest to the TTree node.
EYE_M = 2.0  # Sight lines start this far above the ground.
# An airborne DT climbs at most by this share of its speed: more than aircraft and most drones do.
AIR_CLIMB = 0.5
NUM_HALVINGS = 4  # The way on from q_B is halved up to this often, where its end is blocked or unseen.


@kernel_numpy_errors
def way_length(
    px: float, py: float, pz: float, heading: float, rho: float, airborne: bool, x: float, y: float, z: float
) -> float:
    """Shortest way of a DT from a pose to a point [m]: a Dubins path in the plane.

    An airborne one climbs or sinks meanwhile: a rise that takes longer than the way counts instead.
    """
    flat = distance_to_point(px, py, heading, x, y, rho)
    return max(flat, abs(z - pz) / AIR_CLIMB) if airborne else flat


@kernel_numpy_errors
def go_on(
    x: float, y: float, z: float, spare: float, airborne: bool, prisms: Obstacles, out: Float1D
) -> None:
    """Move on from q_B towards the node, as far as the DT comes.

    ``out`` (6,) holds q_B in its first half and receives where the DT then is in the other [m].
    ``spare`` is the way [m] it has left on reaching q_B. It goes straight for the point below the node,
    or at its own height where airborne, as far as that is free and the node stays in sight at its end;
    else it waits at q_B. Where the whole way is barred the end is found by halving, so it may stop
    short by 1/16 of the way. The turn that it may need at q_B is not counted: the answer errs on the
    near side.
    """
    bx, by, bz = out[0], out[1], out[2]
    out[3], out[4], out[5] = bx, by, bz
    dx, dy = x - bx, y - by
    left = math.sqrt(dx * dx + dy * dy)
    if left == 0.0 or spare <= 0.0:
        return
    eye = 0.0 if airborne else EYE_M
    share = min(1.0, spare / left)
    good, bad, tried = 0.0, share, share
    for _ in range(NUM_HALVINGS + 1):
        nx, ny = bx + tried * dx, by + tried * dy
        if line_blocked(bx, by, bz, nx, ny, bz, prisms) or line_blocked(nx, ny, bz + eye, x, y, z, prisms):
            bad = tried
        else:
            good = tried
            out[3], out[4] = nx, ny
            if good == share:
                return
        tried = 0.5 * (good + bad)


@kernel_numpy_errors
def circle_within_reach(pz: float, z: float, model: Float1D, slack: float) -> tuple[float, float]:
    """Height of the circle on which q_B lies, and its radius [m]; ``model`` (5,) a DT's."""
    if model[3] == 0.0:
        return pz, model[1]
    rise = max(0.0, AIR_CLIMB * model[0] * slack)
    bz = min(pz + rise, max(pz - rise, z))
    return bz, math.sqrt(max(0.0, model[1] * model[1] - (z - bz) ** 2))


@kernel_numpy_errors
def gets_near(
    p: Float1D, heading: float, model: Float1D, slack: float, x: float, y: float, z: float,
    prisms: Obstacles, out: Float1D,
) -> bool:  # fmt: skip
    """Return whether a DT reaches a node through a TTree node within ``slack`` (paper Fig. 2).

    A TTree node inside the circle that sees the node is its own q_B. ``p`` (3,) the TTree node [m];
    ``model`` (5,) the DT's speed, RD_max, turn radius, airborne flag, step length; ``out`` (6,) receives
    q_B, or the circle's nearest point where none is found, and then the nearest position of the DT [m].
    """
    px, py, pz, v, airborne = p[0], p[1], p[2], model[0], model[3] > 0.0
    dx, dy = px - x, py - y
    away = math.sqrt(dx * dx + dy * dy)
    bz, radius = circle_within_reach(pz, z, model, slack)
    inside = away <= radius
    share = 0.0 if away == 0.0 else radius / away
    out[0], out[1], out[2] = (px, py, bz) if inside else (x + share * dx, y + share * dy, bz)
    if slack < 0.0 or away - radius > v * slack or (airborne and abs(z - bz) > model[1]):
        return False
    eye = 0.0 if airborne else EYE_M
    if (
        inside
        and not line_blocked(px, py, bz + eye, x, y, z, prisms)
        and not (bz != pz and line_blocked(px, py, pz, px, py, bz, prisms))
    ):
        go_on(x, y, z, v * slack, airborne, prisms, out)
        return True
    return gets_to_a_bearing(p, heading, model, slack, x, y, z, prisms, out)


@kernel_numpy_errors
def gets_to_a_bearing(
    p: Float1D, heading: float, model: Float1D, slack: float, x: float, y: float, z: float,
    prisms: Obstacles, out: Float1D,
) -> bool:  # fmt: skip
    """:func:`gets_near` over the bearings of the circle, those nearest to the TTree node first.

    ``p`` (3,), ``model`` (5,) and ``out`` (6,) as there.
    """
    px, py, pz, v, airborne = p[0], p[1], p[2], model[0], model[3] > 0.0
    bz, radius = circle_within_reach(pz, z, model, slack)
    eye = 0.0 if airborne else EYE_M
    dx, dy = px - x, py - y
    inside = math.sqrt(dx * dx + dy * dy) <= radius
    base = math.atan2(dy, dx)
    for k in range(NUM_BEARINGS):
        turn = ((k + 1) // 2) * (1.0 if k % 2 == 1 else -1.0)
        angle = base + turn * 2.0 * math.pi / NUM_BEARINGS
        bx, by = x + radius * math.cos(angle), y + radius * math.sin(angle)
        if (bx - px) ** 2 + (by - py) ** 2 > (v * slack) ** 2:
            if not inside:
                return False  # bearings go outwards: the rest is farther still
            continue
        needed = distance_to_point(px, py, heading, bx, by, model[2])  # climbing goes on meanwhile
        if needed > v * slack or line_blocked(bx, by, bz + eye, x, y, z, prisms):
            continue
        if line_blocked(px, py, pz, bx, by, bz, prisms):
            continue
        out[0], out[1] = bx, by
        go_on(x, y, z, v * slack - needed, airborne, prisms, out)
        return True
    return False
