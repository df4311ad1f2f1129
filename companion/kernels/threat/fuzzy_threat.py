"""Intuitionistic fuzzy threat model of radars and DTs (paper 3.1, 3.3; formulas (1)–(3)).

Symbols: ``mu`` membership, ``nu`` non-membership, ``cf`` certainty, ``r`` slant range, ``l``
horizontal range, ``alpha`` angle between velocity and the line to the threat, ``n_e`` threats the
aircraft is exposed to, ``delta`` δ_q in planning units.

Deviations from the paper, both stated where they act: the certainty's default form is shifted by
one so that it stays in [0, 1) (:func:`certainty`), and after the exposures are raised the
non-membership gives way so that μ + ν ≤ 1 (:func:`point_threat`).
"""

from __future__ import annotations

import math

from companion.kernels.arrays import Float1D, Float2D, ThreatModel
from companion.kernels.geometry.radar_shadow import is_hidden
from companion.kernels.native.kernel import inlined, kernel
from companion.kernels.workspace import MAX_THREATS, ThreatScene

# Value of the airborne flag for an aircraft that only passes: it is kept clear of in any direction.
PASSES = 2.0
FORM_SHIFTED, FORM_LITERAL, FORM_PROBABILISTIC = 0, 1, 2


@kernel
def membership(r: float, height: float, l: float, r_max: float, k_r: float) -> float:  # noqa: E741
    """μ of (1): exp(−R⁴/R_max⁴) above the detection boundary K_R·L² and inside R_max, else 0."""
    if r > r_max or height < k_r * l * l:
        return 0.0
    q = (r / r_max) ** 2
    return math.exp(-q * q)


@inlined
def speed_share(v: float, model: ThreatModel) -> float:
    """Return the speed's part of ν: 0 below the penetration speed, then sin(π(v − v_min)/(2(v_max − v_min))).

    The other part is :func:`turned_away`; the non-membership of paper 3.1 is their product.
    """
    if v < model.v_penetration or model.form == FORM_PROBABILISTIC:
        return 0.0
    share = min(1.0, (v - model.v_min) / (model.v_max - model.v_min))
    return math.sin(0.5 * math.pi * share)


@inlined
def certainty(n_e: float, delta: float, model: ThreatModel) -> float:
    """CF of (2).

    As printed, ``1 − (1/(ω_N·N_e + ω_δ·δ))^ω_C`` is negative for one threat and small δ (form
    ``literal``, clipped to [0, 1]). The default form ``shifted`` adds 1 to the bracket, which keeps
    it in [0, 1) and monotone in both arguments. Form ``probabilistic`` is 1.
    """
    if model.form == FORM_PROBABILISTIC:
        return 1.0
    base = model.weight_count * n_e + model.weight_delta * delta
    if model.form == FORM_SHIFTED:
        return 1.0 - (1.0 / (1.0 + base)) ** model.exponent
    if base <= 0.0:
        return 0.0
    return min(1.0, max(0.0, 1.0 - (1.0 / base) ** model.exponent))


@inlined
def weighted_pair(mu: float, nu: float, cf: float) -> tuple[float, float]:
    """[μ', ν'] = CF·[μ, ν], with ν' = 0 where μ' is 0 or 1, scaled down to a sum of at most 1."""
    mu, nu = cf * mu, cf * nu
    if mu <= 0.0 or mu >= 1.0:
        return mu, 0.0
    total = mu + nu
    if total > 1.0:
        return mu / total, nu / total
    return mu, nu


@inlined
def turned_away(dx: float, dy: float, dz: float, r: float, course: Float1D) -> float:
    """Return the direction's part of ν, sin²(α/2), for a threat at (dx, dy, dz), ``r`` away.

    ``course`` (3,) is the velocity's unit vector, α its angle with the line to the threat.
    From the half-angle identity sin²(α/2) = (1 − cos α)/2, which needs no inverse cosine.
    """
    if r == 0.0:
        return 0.0
    return 0.5 * (1.0 - (dx * course[0] + dy * course[1] + dz * course[2]) / r)


@inlined
def set_course(theta: float, phi: float, course: Float1D) -> None:
    """Unit vector of a direction and a climb angle, into ``course`` (3,)."""
    course[0] = math.cos(phi) * math.cos(theta)
    course[1] = math.cos(phi) * math.sin(theta)
    course[2] = math.sin(phi)


@kernel
def gather(x: float, y: float, z: float, share: float, scene: ThreatScene) -> int:
    """Write (μ, ν) of each threat with μ > 0, radars first, to ``scene.scratch.pairs``; return how many.

    ``scene.scratch.course`` is the velocity's unit vector, ``share`` its :func:`speed_share`.
    """
    n = 0
    course, out, points, reach = scene.scratch.course, scene.scratch.pairs, scene.points, scene.reach
    threats = scene.threats
    radars, known = threats.radars, threats.known
    for i in range(radars.shape[0]):
        if known[i] == 0 or n == MAX_THREATS:
            continue
        dx, dy, dz = radars[i, 0] - x, radars[i, 1] - y, radars[i, 2] - z
        flat = dx * dx + dy * dy
        r_max = radars[i, 3]
        if flat > r_max * r_max:
            continue
        r = math.sqrt(flat + dz * dz)
        mu = membership(r, -dz, math.sqrt(flat), r_max, radars[i, 4])
        if mu > 0.0 and not is_hidden(x, y, z, threats.shadows[i], threats.grid):
            out[n, 0] = mu
            out[n, 1] = share * turned_away(dx, dy, dz, r, course)
            n += 1
    for i in range(reach.shape[0]):
        if points[i, 3] == 0.0 or n == MAX_THREATS:
            continue
        dx, dy, dz = points[i, 0] - x, points[i, 1] - y, points[i, 2] - z
        r = math.sqrt(dx * dx + dy * dy + dz * dz)
        mu = membership(r, 0.0, 0.0, reach[i], 0.0)
        if mu > 0.0:
            out[n, 0] = mu
            out[n, 1] = 0.0 if points[i, 3] == PASSES else share * turned_away(dx, dy, dz, r, course)
            n += 1
    return n


@kernel
def aggregate_overlap(n: int, delta: float, model: ThreatModel, pairs: Float2D) -> tuple[float, float]:
    """(μ, ν) of ``n`` threats at one point by IFWA with weights 1/n (paper 3.3).

    ``pairs`` (≥ n, 2) holds their (μ, ν) and is overwritten. Exposures are ordered by falling μ and each is
    raised by those before it, ``μ'_k = 1 − Π_{i ≤ k}(1 − μ_i)``; ν gives way where the sum would pass 1.
    """
    if n == 0:
        return 0.0, 0.0
    cf = certainty(n, delta, model)
    for i in range(n):
        pairs[i, 0], pairs[i, 1] = weighted_pair(pairs[i, 0], pairs[i, 1], cf)
    if n == 1:
        return pairs[0, 0], pairs[0, 1]
    for i in range(1, n):  # insertion sort: n is a handful
        mu, nu = pairs[i, 0], pairs[i, 1]
        j = i - 1
        while j >= 0 and pairs[j, 0] < mu:
            pairs[j + 1, 0], pairs[j + 1, 1] = pairs[j, 0], pairs[j, 1]
            j -= 1
        pairs[j + 1, 0], pairs[j + 1, 1] = mu, nu
    free, product_mu, product_nu = 1.0, 1.0, 1.0
    for i in range(n):
        free *= 1.0 - pairs[i, 0]
        product_mu *= free
        product_nu *= min(pairs[i, 1], free)
    return 1.0 - product_mu ** (1.0 / n), product_nu ** (1.0 / n)


@kernel
def point_threat(
    x: float, y: float, z: float, theta: float, phi: float, v: float, delta: float, scene: ThreatScene
) -> tuple[float, float]:
    """Aggregated (μ, ν) at one state."""
    set_course(theta, phi, scene.scratch.course)
    n = gather(x, y, z, speed_share(v, scene.model), scene)
    return aggregate_overlap(n, delta, scene.model, scene.scratch.pairs)


@kernel
def node_threat(
    state: Float1D, factor: Float2D, delta: float, normals: Float2D, levels: Float1D,
    scene: ThreatScene,
) -> float:  # fmt: skip
    """TI of a node: mean level over particles N(position, Σ) (paper 3.3.1).

    ``state`` (6,) of the node; ``factor`` (3, 3) lower Cholesky factor of the position covariance [m];
    ``normals`` (M, 3) the common standard-normal points; ``levels`` (≥ M,) receives each particle's level.
    """
    set_course(state[3], state[4], scene.scratch.course)
    share = speed_share(state[5], scene.model)
    total = 0.0
    for m in range(normals.shape[0]):
        a, b, c = normals[m, 0], normals[m, 1], normals[m, 2]
        x = state[0] + factor[0, 0] * a
        y = state[1] + factor[1, 0] * a + factor[1, 1] * b
        z = state[2] + factor[2, 0] * a + factor[2, 1] * b + factor[2, 2] * c
        n = gather(x, y, z, share, scene)
        mu, nu = aggregate_overlap(n, delta, scene.model, scene.scratch.pairs)
        levels[m] = max(mu - nu, 0.0)
        total += levels[m]
    return total / normals.shape[0]


@kernel
def line_threat(
    p: Float1D, x: float, y: float, z: float, v: float, delta: float, n_q: int, scene: ThreatScene
) -> float:
    """TI along a line: IFWA over ``n_q`` secondary nodes and the end node (paper 3.3.1).

    The line leads from ``p`` (≥ 3,) to (x, y, z) [m]. The products of powers are taken as sums of
    logarithms; one point with ν = 0 makes ν = 0.
    """
    px, py, pz = p[0], p[1], p[2]
    dx, dy, dz = x - px, y - py, z - pz
    set_course(math.atan2(dy, dx), math.atan2(dz, math.sqrt(dx * dx + dy * dy)), scene.scratch.course)
    share = speed_share(v, scene.model)
    weight = 1.0 / (n_q + 1)
    free, kept = 0.0, 0.0
    for k in range(1, n_q + 2):
        t = k * weight
        n = gather(px + t * dx, py + t * dy, pz + t * dz, share, scene)
        mu, nu = aggregate_overlap(n, delta, scene.model, scene.scratch.pairs)
        if mu >= 1.0:
            return 1.0
        if mu > 0.0:
            free += math.log1p(-mu)
        kept = kept + math.log(nu) if nu > 0.0 and kept > -math.inf else -math.inf
    return max(1.0 - math.exp(weight * free) - math.exp(weight * kept), 0.0)


@kernel
def success_over_exposures(damage: Float1D) -> float:
    """Success after all exposures, Π(1 − P_j) over ``damage`` (N,), the complement of (3)."""
    product = 1.0
    for j in range(damage.shape[0]):
        product *= 1.0 - damage[j]
    return product
