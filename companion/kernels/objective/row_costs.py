"""The objective J: what a flight costs, in seconds.

``J = ∫ (1 + p_seen·m + p_pursued·g + p_near·n + p_energy·e) dt + p_collision·Σ −log p_c``. A price says how
many seconds of detour a second of something is worth. The sum goes over the rows of a path.

Symbols: ``m`` exposure to radars, ``g`` danger from pursuers, ``n`` lack of clearance from prisms or of
height over ground, the larger of both, ``e`` power beyond that of cruise, ``p_c`` the probability that a row
is free of a collision.
"""

from __future__ import annotations

import math

from companion.kernels.aircraft.lqg_mp import collision_free, position_deviation, propagate
from companion.kernels.arrays import Float1D, Float3D, Game, Limits, Obstacles, Pursuers, Threats, Uncertainty
from companion.kernels.geometry.ground_surface import lack_of_height, over_ground
from companion.kernels.geometry.prism_distance import prism_bound, prism_clearance
from companion.kernels.geometry.radar_shadow import is_hidden
from companion.kernels.native.kernel import inlined, kernel
from companion.kernels.native.struct import Struct
from companion.kernels.printed.reachability import PASSING_STD, passing_place, passing_spread
from companion.kernels.search.growth import LEAST_CLEAR
from companion.kernels.threat.fuzzy_threat import membership
from companion.kernels.threat.near_aircraft import MARGIN_M, MARGIN_UP_M, WRONG_SIDE_M, cell_at
from companion.kernels.threat.pursuit_game import threatened_from
from companion.kernels.workspace import FilterScratch, PathRows

HEIGHT_HELD_M = 5.0  # Autopilots hold the height of a path within this.
HIGHER_SHARE = 0.1  # The share of the time in which the aircraft is higher than planned by nearly that.
SEEN = 0.5  # A second counts as in sight from this membership on.
CLIMB_STD = 0.25  # Standard deviation of the climb of an aircraft that flies on, as a share of the climb.
# Danger just inside a well clear volume, and in its middle. Just outside it is 1. With 1 inside as well,
# paths led through the rims of volumes.
AT_SURFACE, AT_CENTRE = 3.0, 7.0
# The same where an aircraft keeps its route for certain: beyond a few metres inside, no search passes it.
AT_KEPT_CENTRE = 100.0
DEVIATIONS_FREE = 6.0  # With this many standard deviations of clearance, −log p_c is below 1e-7.


class Prices(Struct):
    """Seconds of detour that a second of something is worth.

    ``seen`` by radars, ``pursued``, ``near`` a prism or the lowest height over ground, ``energy`` at twice
    the power of cruise; ``collision`` seconds for each unit of −log p_c. ``wanted`` is the clearance from
    prisms [m] beyond which nothing is near; ``cruise`` the airspeed [m/s] beyond which power is paid for.
    """

    seen: float
    pursued: float
    near: float
    energy: float
    collision: float
    wanted: float
    cruise: float


class Objective(Struct):
    """The data and limits from which J is computed.

    ``deviations`` (K,) is the largest standard deviation of the position [m] after each step of
    ``limits.tau`` seconds from ``start`` [s] on; the last one holds from then on.
    """

    prices: Prices
    obstacles: Obstacles
    threats: Threats
    game: Game
    pursuers: Pursuers
    limits: Limits
    deviations: Float1D
    start: float


@kernel
def exposure(x: float, y: float, z: float, threats: Threats) -> float:
    """The exposure m = 1 − Π(1 − μ) over the known radars, μ by (1), 0 where an obstacle hides the point.

    Less than :data:`HEIGHT_HELD_M` below a radar's sight, :data:`HIGHER_SHARE` of μ counts.
    """
    unseen = 1.0
    for i in range(threats.radars.shape[0]):
        if threats.known[i] == 0:
            continue
        dx, dy, dz = x - threats.radars[i, 0], y - threats.radars[i, 1], z - threats.radars[i, 2]
        flat, r_max = dx * dx + dy * dy, threats.radars[i, 3]
        if flat > r_max * r_max:
            continue
        away, level, k_r = math.sqrt(flat + dz * dz), math.sqrt(flat), threats.radars[i, 4]
        mu = membership(away, dz + HEIGHT_HELD_M, level, r_max, k_r)
        if mu > 0.0 and not is_hidden(x, y, z + HEIGHT_HELD_M, threats.shadows[i], threats.grid):
            if dz < k_r * level * level or is_hidden(x, y, z, threats.shadows[i], threats.grid):
                mu *= HIGHER_SHARE
            unseen *= 1.0 - mu
    return 1.0 - unseen


@kernel
def pursuit_danger(x: float, y: float, z: float, time: float, objective: Objective) -> float:
    """g: 1 where a pursuer could threaten the point by ``time`` [s], else how little of the slack is left.

    It falls from 1 at ``time = C(q)`` to 0 at ``game.slack`` seconds before it, since an aircraft is never
    quite on time. An aircraft that flies on counts by :func:`passing_danger`.
    """
    game, worst = objective.game, 0.0
    if game.vehicles.shape[0] == 0:
        return 0.0
    late = time + game.slack
    begins = threatened_from(game, x, y, z, time, late)
    if begins <= time:
        return 1.0
    if begins < late:
        worst = (late - begins) / game.slack
    near = objective.pursuers.near
    cell = cell_at(near, x, y, time)
    for i in range(near.ends[cell], near.ends[cell + 1]):
        worst = max(worst, passing_danger(objective.pursuers, near.listed[i], x, y, z, time))
    return worst


@kernel
def passing_danger(pursuers: Pursuers, d: int, x: float, y: float, z: float, time: float) -> float:
    """Danger from an aircraft that flies on at ``time`` [s].

    It rises from :data:`AT_SURFACE` to :data:`AT_CENTRE` in the well clear volume. Outside it falls from 1 to
    0 at a margin, which is wider on its wrong side (:mod:`companion.world.right_of_way`). The volume is wider
    by the standard deviation of where the aircraft will be. An aircraft that turns, or says where it flies
    next, may also fly straight on from now. The larger danger of the two counts.
    """
    last = pursuers.count[d] - 2
    worst = danger_if(passing_place(pursuers, d, time, last), pursuers, d, x, y, z, time)
    if last > 0 and pursuers.model[d, 7] == 0.0:
        now, soon, ahead = pursuers.position[d, 0], pursuers.position[d, last + 2], time - pursuers.time[d, 0]
        straight = (
            now[0] + ahead * (soon[0] - now[0]),
            now[1] + ahead * (soon[1] - now[1]),
            now[2] + ahead * (soon[2] - now[2]),
        )
        worst = max(worst, danger_if(straight, pursuers, d, x, y, z, time))
    return worst


@inlined
def danger_if(
    there: tuple[float, float, float], pursuers: Pursuers, d: int, x: float, y: float, z: float, time: float
) -> float:
    """Return the danger if aircraft ``d`` is ``there`` at ``time`` [m]."""
    climbed = 0.0 if pursuers.model[d, 7] else there[2] - pursuers.position[d, 0, 2]
    height = pursuers.model[d, 5] + PASSING_STD * math.hypot(pursuers.model[d, 6], CLIMB_STD * climbed)
    above = abs(there[2] - z) - height
    if above > MARGIN_UP_M:
        return 0.0
    radius = pursuers.model[d, 1] + passing_spread(pursuers, d, time)
    away = math.hypot(there[0] - x, there[1] - y)
    outside = away - radius
    if above <= 0.0 and outside <= 0.0:
        centre = AT_KEPT_CENTRE if pursuers.model[d, 7] else AT_CENTRE
        return AT_SURFACE + (centre - AT_SURFACE) * min(-above / height, -outside / radius)
    wrong = (x - there[0]) * pursuers.model[d, 10] + (y - there[1]) * pursuers.model[d, 11]
    margin = MARGIN_M + WRONG_SIDE_M * max(0.0, wrong) / max(away, 1.0)
    return max(0.0, 1.0 - max(above / MARGIN_UP_M, outside / margin))


@kernel
def energy_excess(v: float, prices: Prices) -> float:
    """e: power beyond cruise's as a share of it; drag makes power grow with the cube of the airspeed."""
    ratio = v / prices.cruise
    return max(0.0, ratio * ratio * ratio - 1.0)


@inlined
def collision_price(free: float, time: float, objective: Objective) -> float:
    """Return p_collision·(−log p_c) of a row with a clearance [m], passed at ``time`` [s]."""
    prices, limits, known = objective.prices, objective.limits, objective.deviations
    step = min(known.shape[0] - 1, max(0, int((time - objective.start) / limits.tau + 0.5)))
    if prices.collision == 0.0 or free >= DEVIATIONS_FREE * known[step]:
        return 0.0
    return -prices.collision * math.log(max(collision_free(free, known[step], limits.dimension), LEAST_CLEAR))


@inlined
def lack_of_clearance(x: float, y: float, z: float, from_prisms: float, objective: Objective) -> float:
    """N of J: 0 where nothing is near, 1 at a prism or at the lowest height over ground.

    ``from_prisms`` is the clearance from prisms [m].
    """
    wanted, lack = objective.prices.wanted, lack_of_height(x, y, z, objective.obstacles.ground)
    return max(lack, (wanted - from_prisms) / wanted) if from_prisms < wanted else lack


@kernel
def prism_clearance_up_to(x: float, y: float, z: float, enough: float, obstacles: Obstacles) -> float:
    """Clearance from prisms [m], or ``enough`` if a lower bound already shows that there is as much."""
    if prism_bound(x, y, z, obstacles) >= enough:
        return enough
    return prism_clearance(x, y, z, obstacles, enough)


@kernel
def row_cost(state: Float1D, time: float, dt: float, danger: float, objective: Objective) -> float:
    """J of the last ``dt`` seconds before the state ``state`` (6,), which is passed at ``time`` [s].

    ``danger`` is :func:`pursuit_danger` then and there.
    """
    prices, x, y, z = objective.prices, state[0], state[1], state[2]
    enough = max(prices.wanted, DEVIATIONS_FREE * objective.deviations[-1])
    from_prisms = prism_clearance_up_to(x, y, z, enough, objective.obstacles)
    free = max(0.0, min(from_prisms, over_ground(x, y, z, objective.obstacles.ground)))
    rate = 1.0 + prices.energy * energy_excess(state[5], prices) + prices.pursued * danger
    if prices.seen > 0.0:
        rate += prices.seen * exposure(x, y, z, objective.threats)
    rate += prices.near * lack_of_clearance(x, y, z, from_prisms, objective)
    return rate * dt + collision_price(free, time, objective)


@kernel
def rows_cost(rows: PathRows, first: int, n: int, objective: Objective) -> float:
    """J of the edges that end in rows ``first`` to ``n - 1``; row 0 has none."""
    total = 0.0
    for k in range(max(first, 1), n):
        state, time = rows.states[k], rows.times[k]
        danger = pursuit_danger(state[0], state[1], state[2], time, objective)
        total += row_cost(state, time, time - rows.times[k - 1], danger, objective)
    return total


@kernel
def most_danger(rows: PathRows, n: int, objective: Objective) -> float:
    """Return the largest :func:`pursuit_danger` on a path of ``n`` rows."""
    worst = 0.0
    for k in range(n):
        state = rows.states[k]
        worst = max(worst, pursuit_danger(state[0], state[1], state[2], rows.times[k], objective))
    return worst


@kernel
def rows_seen(rows: PathRows, n: int, threats: Threats) -> float:
    """Return the integral of m over a path of ``n`` rows [s]."""
    total = 0.0
    for k in range(1, n):
        x, y, z = rows.states[k, 0], rows.states[k, 1], rows.states[k, 2]
        total += (rows.times[k] - rows.times[k - 1]) * exposure(x, y, z, threats)
    return total


@kernel
def longest_seen(rows: PathRows, n: int, threats: Threats) -> float:
    """Return the longest unbroken time in sight over a path of ``n`` rows [s]."""
    longest, run = 0.0, 0.0
    for k in range(1, n):
        is_seen = exposure(rows.states[k, 0], rows.states[k, 1], rows.states[k, 2], threats) >= SEEN
        run = run + rows.times[k] - rows.times[k - 1] if is_seen else 0.0
        longest = max(longest, run)
    return longest


@kernel
def fill_deviations(
    state: Float1D, errors: Float3D, estimates: Float3D, tables: Uncertainty, tau: float, dimension: int,
    deviations: Float1D, scratch: FilterScratch,
) -> None:  # fmt: skip
    """Largest standard deviation of the position after each step of straight flight [m].

    It goes into ``deviations`` (K,), the present one first. ``state`` (6,) is where the flight begins;
    ``errors`` and ``estimates`` (2, 6, 6) hold P and Λ there in their first rows, and are overwritten.
    """
    straight = (0.0, 0.0, 0.0)
    for step in range(deviations.shape[0]):
        now, then = step % 2, 1 - step % 2
        deviations[step] = position_deviation(errors[now], estimates[now], dimension)
        propagate(
            state, straight, tau, tables, errors[now], estimates[now], errors[then], estimates[then], scratch
        )
