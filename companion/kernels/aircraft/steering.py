"""The autopilot's lateral guidance (L1) and the track that it flies, with bank dynamics and wind.

Symbols: ``e, n`` the place east and north; ``psi`` the heading of the air velocity, clockwise from north;
``phi`` bank, positive to the right; ``v`` airspeed, level; ``vg`` ground speed; ``l1`` the L1 distance.

References
----------
Park, Deyst, How, "A New Nonlinear Guidance Logic for Trajectory Tracking", AIAA GNC 2004, equation 3, in
the form of ArduPilot's ``AP_L1_Control.cpp`` (period and damping for the distance), with its loiter law.
ArduPilot, ``Plane::set_target_altitude_proportion_terrain``, ``Plane::lookahead_adjustment`` and
``AP_Terrain::lookahead``: heights over ground. Versions up to 4.7 make a small descent at once, 4.8 along the
leg. The kernel makes it at once, which is the lower path of the two.
Beard, McLain, *Small Unmanned Aircraft*, 2012, eq. (9.14): the coordinated turn.
"""

from __future__ import annotations

import math

from companion.kernels.arrays import Float1D, Float2D, FollowedGround
from companion.kernels.native.kernel import kernel, local_floats
from companion.kernels.native.struct import Struct

GRAVITY = 9.80665
STEP = 0.05  # Step of the integration [s].
SLOWEST = 3.0  # Guidance takes the ground speed for at least this [m/s].
SHORTEST = 1.0  # A shorter leg has no direction [m].
HALF_PI = 0.5 * math.pi
SIN_45 = 0.7071  # Sine of 45°, the angle at which an aircraft far off meets its leg.


class SteeringLaw(Struct):
    """Parameters of an autopilot's guidance.

    ``period``, ``damping`` of the L1 loop; ``bank_max``, ``roll_rate_max`` and ``roll_time`` of the bank;
    ``coordination`` the rate of turn as a share of that of a coordinated turn;
    ``acceptance``, ``height_acceptance`` of a waypoint; ``waits_for_turns`` whether the distance is that of a
    right angle, and less before a lesser turn, as ArduPlane's; ``climb_rate_max``, ``sink_rate_max``;
    ``climb_slope_min`` and ``descent_slope_min`` the changes of height from which they are spread over their
    leg; ``airspeed`` commanded behind the first target, 0 for none, and the ``acceleration`` to it.
    """

    period: float
    damping: float
    bank_max: float
    roll_rate_max: float
    roll_time: float
    coordination: float
    acceptance: float
    height_acceptance: float
    waits_for_turns: bool
    climb_rate_max: float
    sink_rate_max: float
    climb_slope_min: float
    descent_slope_min: float
    airspeed: float
    acceleration: float


@kernel
def _wrapped(angle: float) -> float:
    """Return an angle between -π and π [rad]."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


@kernel
def _l1_distance(speed: float, law: SteeringLaw) -> float:
    """Distance ahead at which the path is steered for, at a speed over the ground [m]."""
    return max(law.damping * law.period * speed / math.pi, 1.0)


@kernel
def _pull(angle: float, speed: float, law: SteeringLaw) -> float:
    """Acceleration to the right that turns by an angle to the point at the L1 distance [m/s²]."""
    turn = max(-HALF_PI, min(HALF_PI, _wrapped(angle)))
    return 4.0 * law.damping**2 * speed * speed / _l1_distance(speed, law) * math.sin(turn)


@kernel
def leg_acceleration(
    e: float, n: float, ve: float, vn: float, begin: Float1D, end: Float1D, law: SteeringLaw
) -> float:
    """Acceleration to the right along a leg [m/s²], from ``begin`` (3,) to ``end`` (3,).

    ``ve``, ``vn``: velocity over the ground. Far before the leg it is begun at its start; far past its
    end it is turned back to that.
    """
    speed = max(math.sqrt(ve * ve + vn * vn), SLOWEST)
    course = math.atan2(ve, vn)
    l1 = _l1_distance(speed, law)
    de, dn = end[0] - begin[0], end[1] - begin[1]
    length = math.sqrt(de * de + dn * dn)
    to_end = math.atan2(end[0] - e, end[1] - n)
    if length < SHORTEST:
        return _pull(to_end - course, speed, law)
    ue, un = de / length, dn / length
    ae, an = e - begin[0], n - begin[1]
    progress, lateral = ae * ue + an * un, ae * un - an * ue
    gap = math.sqrt(ae * ae + an * an)
    if gap > l1 and progress < -SIN_45 * gap:
        return _pull(math.atan2(-ae, -an) - course, speed, law)
    if progress > length + 3.0 * speed:
        return _pull(to_end - course, speed, law)
    intercept = math.asin(max(-SIN_45, min(SIN_45, lateral / l1)))
    return _pull(math.atan2(ue, un) - intercept - course, speed, law)


@kernel
def circle_acceleration(e: float, n: float, ve: float, vn: float, circle: Float1D, law: SteeringLaw) -> float:
    """Acceleration to the right onto and round ``circle`` (4,) [m/s²]: its centre, and radius.

    The radius is positive clockwise. Outside, the centre is steered for until the circle's own law turns
    more strongly.
    """
    speed = max(math.sqrt(ve * ve + vn * vn), SLOWEST)
    side = 1.0 if circle[3] >= 0.0 else -1.0
    radius = max(abs(circle[3]), 1.0)
    oe, on = e - circle[0], n - circle[1]
    gap = max(math.sqrt(oe * oe + on * on), 1.0)
    capture = _pull(math.atan2(-oe, -on) - math.atan2(ve, vn), speed, law)
    outward = (ve * oe + vn * on) / gap
    tangent = side * (ve * on - vn * oe) / gap
    frequency = 2.0 * math.pi / law.period
    spring = (gap - radius) * frequency**2 + outward * 2.0 * law.damping * frequency
    if tangent < 0.0:
        spring = max(spring, 0.0)
    turning = side * (spring + tangent * tangent / max(0.5 * radius, gap))
    if gap > radius and side * capture < side * turning:
        return capture
    return turning


@kernel
def moved(state: Float1D, wind: tuple[float, float], acceleration: float, law: SteeringLaw) -> None:
    """Fly one step: ``state`` (6,) e n up psi phi v is moved on; its height stays."""
    wanted = max(-law.bank_max, min(law.bank_max, math.atan(acceleration / GRAVITY)))
    rate = max(-law.roll_rate_max, min(law.roll_rate_max, (wanted - state[4]) / max(law.roll_time, STEP)))
    bank = state[4] + rate * STEP
    v = max(state[5], SLOWEST)
    turn = law.coordination * GRAVITY * math.tan(0.5 * (state[4] + bank)) / v * STEP
    middle = state[3] + 0.5 * turn
    state[0] += (v * math.sin(middle) + wind[0]) * STEP
    state[1] += (v * math.cos(middle) + wind[1]) * STEP
    state[3] += turn
    state[4] = bank


@kernel
def _share(state: Float1D, begin: Float1D, end: Float1D) -> float:
    """Return the share of the leg ``begin`` (3,) – ``end`` (3,) behind ``state`` (6,); 1 abeam the end."""
    de, dn = end[0] - begin[0], end[1] - begin[1]
    square = de * de + dn * dn
    if square < SHORTEST * SHORTEST:
        return 1.0
    return ((state[0] - begin[0]) * de + (state[1] - begin[1]) * dn) / square


@kernel
def _height(share: float, begin: Float1D, end: Float1D, law: SteeringLaw) -> float:
    """Height to be flown at a share of the leg from ``begin`` (3,) to ``end`` (3,) [m]."""
    change = end[2] - begin[2]
    if -law.descent_slope_min < change < law.climb_slope_min:
        return end[2]
    return begin[2] + change * max(0.0, min(1.0, share))


@kernel
def ground_up(x: float, y: float, ground: FollowedGround) -> float:
    """Height of the ground at a place, bilinear; beyond the grid that of its edge [m]."""
    n, m, side = ground.up.shape[0], ground.up.shape[1], ground.grid[2]
    u = max(0.0, min(n - 1.0, (x - ground.grid[0]) / side))
    v = max(0.0, min(m - 1.0, (y - ground.grid[1]) / side))
    i, j = min(n - 2, int(u)), min(m - 2, int(v))
    u, v = u - i, v - j
    west = ground.up[i, j] + v * (ground.up[i, j + 1] - ground.up[i, j])
    east = ground.up[i + 1, j] + v * (ground.up[i + 1, j + 1] - ground.up[i + 1, j])
    return west + u * (east - west)


@kernel
def _height_over_ground(
    state: Float1D, share: float, begin: Float1D, end: Float1D, law: SteeringLaw, ground: FollowedGround
) -> float:
    """Height to be flown at a share of the leg from ``begin`` (3,) to ``end`` (3,), over ground [m]."""
    first = begin[2] - ground_up(begin[0], begin[1], ground)
    change = end[2] - ground_up(end[0], end[1], ground) - first
    part = 1.0 if -law.descent_slope_min < change < 0.0 else max(0.0, min(1.0, share))
    return first + part * change + ground_up(state[0], state[1], ground)


@kernel
def _climb_ahead(
    state: Float1D, speed: float, begin: Float1D, end: Float1D, law: SteeringLaw, ground: FollowedGround
) -> float:
    """Height that steep ground ahead adds on the leg from ``begin`` (3,) to ``end`` (3,) [m]."""
    de, dn = end[0] - state[0], end[1] - state[1]
    away = math.sqrt(de * de + dn * dn)
    left, here = min(away, ground.look_ahead), ground_up(state[0], state[1], ground)
    climb, along, most = ground.climb_rate / max(speed, SLOWEST), 0.0, 0.0
    while left > 0.0:
        along += ground.step
        left -= ground.step
        up = ground_up(state[0] + de / away * along, state[1] + dn / away * along, ground)
        most = max(most, up - here - climb * along)
    first = begin[2] - ground_up(begin[0], begin[1], ground)
    change = end[2] - ground_up(end[0], end[1], ground) - first
    return max(0.0, most + change) if change <= -law.descent_slope_min else most


@kernel
def _begin_leg(state: Float1D, begin: Float1D, places: Float2D, target: int, law: SteeringLaw) -> None:
    """Begin the leg to a target of ``places`` (M + 1, 3) at ``begin`` (3,).

    If an ArduPlane at ``state`` (6,) is already abeam the target, the leg begins where it is
    (``Plane::set_next_WP``): ``begin`` is overwritten then.
    """
    if law.waits_for_turns and target < len(places) and _share(state, begin, places[target]) >= 1.0:
        begin[:] = state[:3]


@kernel
def _turn_at(begin: Float1D, places: Float2D, target: int, circle: Float1D, law: SteeringLaw) -> float:
    """Return the turn at a target, as a share of a right angle and at most 1.

    The leg to it begins at ``begin`` (3,). ``places`` (M + 1, 3) has the target and what follows; behind the
    last of them comes ``circle`` (4,), if it has a radius.
    """
    last = len(places) - 1
    if not law.waits_for_turns or target > last or (target == last and circle[3] == 0.0):
        return 1.0
    e, n = places[target, 0], places[target, 1]
    after_e = places[target + 1, 0] if target < last else circle[0]
    after_n = places[target + 1, 1] if target < last else circle[1]
    turn = math.atan2(after_e - e, after_n - n) - math.atan2(e - begin[0], n - begin[1])
    return min(1.0, abs(_wrapped(turn)) / HALF_PI)


@kernel
def _is_reached(
    state: Float1D, share: float, end: Float1D, speed: float, turn_share: float, law: SteeringLaw
) -> bool:
    """Return whether ``end`` (3,) counts as reached at ``state`` (6,): near or abeam, and near its height."""
    if abs(state[2] - end[2]) > law.height_acceptance:
        return False
    away = math.sqrt((end[0] - state[0]) ** 2 + (end[1] - state[1]) ** 2)
    acceptance = law.acceptance
    if law.waits_for_turns:  # ``AP_L1_Control::turn_distance``
        acceptance = turn_share * min(acceptance, _l1_distance(speed, law))
    return share >= 1.0 or away <= acceptance


@kernel
def fly_targets(
    state: Float1D, wind: tuple[float, float], places: Float2D, circle: Float1D,
    law: SteeringLaw, ground: FollowedGround, every: int, rows: Float2D,
) -> None:  # fmt: skip
    """Fly leg by leg, then round a circle; one state in ``every`` steps is written to ``rows`` (K, 7).

    ``state`` (6,) e n up psi phi v is overwritten. ``places`` (M + 1, 3) the start of the first leg, and the
    targets. ``circle`` (4,) centre and signed radius of what follows the last; radius 0: its leg goes on.
    A row is e, n, up, course over the ground, bank, climb angle, and the number of the target: M behind
    the last. Heights of targets follow the ``ground`` if it has a step; the circle is level.
    """
    target, begin, end = 1, local_floats(3), local_floats(3)
    begin[:] = places[0]
    last = len(places) - 1
    turn_share = _turn_at(begin, places, target, circle, law)
    climbed, ahead = 0.0, 0.0
    for row in range(len(rows)):
        ve = state[5] * math.sin(state[3]) + wind[0]
        vn = state[5] * math.cos(state[3]) + wind[1]
        speed = math.sqrt(ve * ve + vn * vn)
        rows[row, 0], rows[row, 1], rows[row, 2] = state[0], state[1], state[2]
        rows[row, 3], rows[row, 4] = math.atan2(ve, vn), state[4]
        rows[row, 5], rows[row, 6] = math.atan2(climbed, max(speed, SLOWEST)), float(target - 1)
        if ground.step > 0.0:
            ahead = _climb_ahead(state, speed, begin, places[target], law, ground) if target <= last else 0.0
        for _ in range(every):
            ve = state[5] * math.sin(state[3]) + wind[0]
            vn = state[5] * math.cos(state[3]) + wind[1]
            if target <= last:
                share = _share(state, begin, places[target])
                speed = math.sqrt(ve * ve + vn * vn)
                if _is_reached(state, share, places[target], speed, turn_share, law):
                    if target < last or circle[3] != 0.0:
                        begin[:] = places[target]
                    target += 1
                    _begin_leg(state, begin, places, target, law)
                    turn_share = _turn_at(begin, places, target, circle, law)
            if target > last and circle[3] != 0.0:
                wanted = circle[2]
                pull = circle_acceleration(state[0], state[1], ve, vn, circle, law)
            else:
                end[:] = places[min(target, last)]
                share = _share(state, begin, end)
                if ground.step > 0.0:
                    wanted = _height_over_ground(state, share, begin, end, law, ground) + ahead
                else:
                    wanted = _height(share, begin, end, law)
                if target > last:  # It flies on along its line.
                    end[0] += 1e3 * (end[0] - begin[0])
                    end[1] += 1e3 * (end[1] - begin[1])
                pull = leg_acceleration(state[0], state[1], ve, vn, begin, end, law)
            climbed = max(-law.sink_rate_max, min(law.climb_rate_max, (wanted - state[2]) / STEP))
            state[2] += climbed * STEP
            if target > 1 and law.airspeed > 0.0:
                gain = law.acceleration * STEP
                state[5] += max(-gain, min(gain, law.airspeed - state[5]))
            moved(state, wind, pull, law)
