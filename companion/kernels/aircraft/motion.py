"""One step of the aircraft: the control towards a target within all constraints (paper 2.2).

Symbols: ``state = [x, y, z, theta, phi, v]``, ``w`` turn rate, ``wp`` climb rate, ``a`` acceleration.
"""

from __future__ import annotations

import math

from companion.kernels.arrays import Float1D, Limits
from companion.kernels.native.kernel import inlined, kernel

OK, OUT_OF_BOUNDS, TOO_SLOW_OR_FAST = 0, 1, 2
SLOWEST = 0.1  # The ground speed counts as at least this share of the airspeed.
WIND_RESERVE = 1.1  # Limits are taken for a wind stronger by this factor.
STRAIGHT_RATE = 2e-3  # Up to this turn rate an edge counts as straight [rad/s].


@inlined
def wrapped(angle: float) -> float:
    """Return the angle in [-π, π]."""
    turned = angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)
    return min(math.pi, max(-math.pi, turned))  # the subtraction may round past the ends


@kernel
def turn_radius(v: float, limits: Limits) -> float:
    """Radius over the ground of the tightest turn at airspeed ``v``, which above cruise the bank may widen.

    Beard, McLain, *Small Unmanned Aircraft*, eq. 9.14, without a crab angle.
    """
    if v <= limits.v_cruise:
        return limits.r_min
    fastest = v + WIND_RESERVE * math.hypot(limits.wind_x, limits.wind_y)
    return max(limits.r_min, fastest * fastest / limits.sideways_max)


@kernel
def steer(
    state: Float1D, turn: int, straight: float, x: float, y: float, z: float, limits: Limits
) -> tuple[float, float, float]:
    """Control (a, w, wp) of one step towards (x, y, z).

    A turn goes on freely in its own direction; a new one, or one the other way, begins only after
    ``straight_min`` of straight flight. Where the rule forbids turning, the step flies straight.
    ``state`` (6,) at the start; ``turn`` and ``straight`` say what was flown before.
    """
    dx, dy, dz = x - state[0], y - state[1], z - state[2]
    wanted = wrapped(math.atan2(dy, dx) - state[3])
    a = min(limits.a_max, max(-limits.a_max, (limits.v_cruise - state[5]) / limits.tau))
    slow, fast = min(state[5], state[5] + a * limits.tau), max(state[5], state[5] + a * limits.tau)
    w_max = slow * math.cos(state[4]) / turn_radius(fast, limits)
    w = min(w_max, max(-w_max, wanted / limits.tau))
    sign = 1 if w > STRAIGHT_RATE else (-1 if w < -STRAIGHT_RATE else 0)
    if sign == 0 or (turn != 0 and sign != turn) or (turn == 0 and straight < limits.straight_min):
        w = 0.0
    wp = 0.0
    if limits.dimension == 3:
        phi = math.atan2(dz, math.sqrt(dx * dx + dy * dy))
        phi = min(limits.climb_max, max(-limits.descent_max, phi))
        wp = (phi - state[4]) / limits.tau
        wp = min(limits.pitch_rate_max, max(-limits.pitch_rate_max, wp))
    return a, w, wp


@kernel
def advance(state: Float1D, a: float, w: float, wp: float, tau: float, out: Float1D) -> None:
    """The state after ``tau`` seconds of constant control from ``state`` (6,), into ``out`` (6,)."""
    half = 0.5 * w * tau
    k = 1.0 if abs(half) < 1e-9 else math.sin(half) / half
    v, phi, theta = state[5] + 0.5 * a * tau, state[4] + 0.5 * wp * tau, state[3] + half
    flat = tau * v * math.cos(phi) * k
    out[0] = state[0] + flat * math.cos(theta)
    out[1] = state[1] + flat * math.sin(theta)
    out[2] = state[2] + tau * v * math.sin(phi)
    out[3] = wrapped(state[3] + w * tau)
    out[4] = state[4] + wp * tau
    out[5] = state[5] + a * tau


@kernel
def ground_speed(theta: float, v: float, limits: Limits) -> float:
    """Speed over the ground of an aircraft of level airspeed ``v`` on the course ``theta`` in the wind.

    The triangle of velocities; at least :data:`SLOWEST` of the airspeed, where the wind allows less.
    """
    east, north = math.cos(theta), math.sin(theta)
    along = limits.wind_x * east + limits.wind_y * north
    across = limits.wind_y * east - limits.wind_x * north
    return max(along + math.sqrt(max(v * v - across * across, 0.0)), SLOWEST * v)


@kernel
def slowness(p: Float1D, q: Float1D, limits: Limits) -> float:
    """Return the duration of the edge from state ``p`` (6,) to ``q`` (6,) over that in still air.

    Its course turns evenly; Simpson's rule over its beginning, middle and end.
    """
    if limits.wind_x == 0.0 and limits.wind_y == 0.0:
        return 1.0
    v = 0.5 * (p[5] + q[5]) * math.cos(0.5 * (p[4] + q[4]))
    middle = p[3] + 0.5 * wrapped(q[3] - p[3])
    return v * (
        1.0 / ground_speed(p[3], v, limits)
        + 4.0 / ground_speed(middle, v, limits)
        + 1.0 / ground_speed(q[3], v, limits)
    ) / 6.0  # fmt: skip


@kernel
def state_status(state: Float1D, limits: Limits) -> int:
    """``OK``, or which constraint ``state`` (6,) breaks."""
    b = limits.bounds
    if state[0] < b[0] or state[0] > b[1] or state[1] < b[2] or state[1] > b[3]:
        return OUT_OF_BOUNDS
    if state[2] < b[4] or state[2] > b[5]:
        return OUT_OF_BOUNDS
    if state[5] < limits.v_min - 1e-9 or state[5] > limits.v_max + 1e-9:
        return TOO_SLOW_OR_FAST
    return OK


@inlined
def straight_after(turn: int, straight: float, w: float, length: float) -> tuple[int, float]:
    """Turn sign and straight length carried on after an edge of turn rate ``w``."""
    if w > STRAIGHT_RATE:
        return 1, 0.0
    if w < -STRAIGHT_RATE:
        return -1, 0.0
    return 0, length if turn != 0 else straight + length


@inlined
def distance_to(state: Float1D, point: Float1D) -> float:
    """Distance of the position of ``state`` (≥ 3,) to ``point`` (≥ 3,) [m]."""
    return math.sqrt((state[0] - point[0]) ** 2 + (state[1] - point[1]) ** 2 + (state[2] - point[2]) ** 2)
