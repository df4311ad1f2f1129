"""LQG-MP: the a-priori distribution of the true state about the plan (paper 2.2).

Symbols: state ``s = [x, y, z, theta, phi, v]``, control ``u = [a, w, wp]``; ``A, B`` the motion
linearised about the nominal edge (noise enters with the control, so ``V = B``); ``H`` selects the
first five states; ``P`` error covariance of the Kalman filter, ``Λ`` covariance of its estimate about
the plan; the true state's covariance is ``Σ = P + Λ``.

References
----------
van den Berg, Abbeel, Goldberg, "LQG-MP: Optimized path planning for robots with motion uncertainty
and imperfect state information", IJRR 30(7), 2011, section IV.
Abramowitz, Stegun, 6.5.1 and 6.5.16 (incomplete gamma function at half-integer order).
"""

from __future__ import annotations

import math

from companion.kernels.arrays import Float1D, Float2D, Uncertainty
from companion.kernels.native.kernel import inlined, kernel
from companion.kernels.workspace import FilterScratch


@kernel
def linearise(
    theta: float, phi: float, v: float, a: float, w: float, wp: float, tau: float,
    motion: Float2D, control: Float2D,
) -> None:  # fmt: skip
    """Jacobians of one step about its nominal edge: ``motion`` (6, 6) A, ``control`` (6, 3) B.

    The step turns at a constant rate, so its chord has the mid-step direction and is shortened by
    ``sin(wτ/2)/(wτ/2)``.
    """
    tm, pm, vm = theta + 0.5 * w * tau, phi + 0.5 * wp * tau, v + 0.5 * a * tau
    half = 0.5 * w * tau
    k = 1.0 if abs(half) < 1e-9 else math.sin(half) / half
    ct, st, cp, sp = math.cos(tm), math.sin(tm), math.cos(pm), math.sin(pm)
    motion[:] = 0.0
    control[:] = 0.0
    for i in range(6):
        motion[i, i] = 1.0
    motion[0, 3], motion[1, 3] = -tau * vm * cp * k * st, tau * vm * cp * k * ct
    motion[0, 4], motion[1, 4], motion[2, 4] = -tau * vm * sp * k * ct, -tau * vm * sp * k * st, tau * vm * cp
    motion[0, 5], motion[1, 5], motion[2, 5] = tau * cp * k * ct, tau * cp * k * st, tau * sp
    for i in range(3):
        control[i, 0] = 0.5 * tau * motion[i, 5]
        control[i, 1] = 0.5 * tau * motion[i, 3]
        control[i, 2] = 0.5 * tau * motion[i, 4]
    control[5, 0], control[3, 1], control[4, 2] = tau, tau, tau


@inlined
def nearest_entry(value: float, first: float, spacing: float, n: int) -> int:
    """Index of the entry of an axis of ``n`` that is nearest to a value."""
    return min(n - 1, max(0, int(round((value - first) / spacing))))


@kernel
def look_up_gain(v: float, w: float, phi: float, theta: float, tables: Uncertainty, gain: Float2D) -> None:
    """LQR gain of the nearest tabulated (speed, turn rate, climb), turned to ``theta``, into ``gain`` (3, 6).

    The motion is the same in every direction, so the table holds direction 0 only and the position
    columns are rotated: ``L(θ) = L(0)·R(θ)ᵀ``.
    """
    axes, shape = tables.axes, tables.gains.shape
    i = nearest_entry(v, axes[0, 0], axes[0, 1], shape[0])
    j = nearest_entry(w, axes[1, 0], axes[1, 1], shape[1])
    k = nearest_entry(phi, axes[2, 0], axes[2, 1], shape[2])
    table = tables.gains[i, j, k]
    c, s = math.cos(theta), math.sin(theta)
    for row in range(3):
        gain[row, 0] = table[row, 0] * c - table[row, 1] * s
        gain[row, 1] = table[row, 0] * s + table[row, 1] * c
        for column in range(2, 6):
            gain[row, column] = table[row, column]


@kernel
def congruence(m: Float2D, c: Float2D, scratch: Float2D, out: Float2D) -> None:
    """``m·c·mᵀ`` of ``m`` (6, 6) and ``c`` (6, 6) into ``out`` (6, 6); ``scratch`` (6, 6) is overwritten."""
    for i in range(6):
        for j in range(6):
            total = 0.0
            for k in range(6):
                total += m[i, k] * c[k, j]
            scratch[i, j] = total
    for i in range(6):
        for j in range(i, 6):
            total = 0.0
            for k in range(6):
                total += scratch[i, k] * m[j, k]
            out[i, j] = total
            out[j, i] = total


@kernel
def information_gain(p: Float2D, measurement: Float1D, w: Float2D, chol: Float2D) -> None:
    """``w`` (6, 5) with ``w·wᵀ = K·S·Kᵀ``, the covariance a measurement takes out of ``p`` (6, 6).

    ``S = H·p·Hᵀ + N`` is factored ``L·Lᵀ`` and ``w = p·Hᵀ·L⁻ᵀ``. ``measurement`` (5,) the variances N;
    ``chol`` (5, 5) receives L, in its lower triangle.
    """
    for i in range(5):
        for j in range(i + 1):
            total = p[i, j]
            if i == j:
                total += measurement[i]
            for k in range(j):
                total -= chol[i, k] * chol[j, k]
            chol[i, j] = math.sqrt(total) if i == j else total / chol[j, j]
    for r in range(6):
        for j in range(5):
            total = p[r, j]
            for k in range(j):
                total -= w[r, k] * chol[j, k]
            w[r, j] = total / chol[j, j]


@kernel
def propagate(
    state: Float1D, control: tuple[float, float, float], dt: float, tables: Uncertainty,
    p: Float2D, l: Float2D, p_out: Float2D, l_out: Float2D, work: FilterScratch,  # noqa: E741
) -> None:  # fmt: skip
    """One edge of LQG-MP: ``P⁺ = P⁻ − K·S·Kᵀ`` and ``Λ⁺ = (A+BL)Λ(A+BL)ᵀ + K·S·Kᵀ``.

    ``state`` (6,) is the edge's start, ``control`` a, w, wp, flown for ``dt`` seconds; ``p`` (6, 6) and
    ``l`` (6, 6) come in, ``p_out`` (6, 6) and ``l_out`` (6, 6) go out.
    """
    a, w, wp = control
    motion, into, gain, taken = work.motion, work.control, work.gain, work.taken
    linearise(state[3], state[4], state[5], a, w, wp, dt, motion, into)
    look_up_gain(state[5], w, state[4], state[3] + 0.5 * w * dt, tables, gain)
    congruence(motion, p, work.product, p_out)
    for i in range(6):
        for j in range(6):
            for k in range(3):
                p_out[i, j] += into[i, k] * tables.process[k] * into[j, k]
                motion[i, j] += into[i, k] * gain[k, j]
    information_gain(p_out, tables.measurement, taken, work.factor)
    congruence(motion, l, work.product, l_out)
    for i in range(6):
        for j in range(i, 6):
            total = 0.0
            for k in range(5):
                total += taken[i, k] * taken[j, k]
            p_out[i, j] -= total
            l_out[i, j] += total
            p_out[j, i], l_out[j, i] = p_out[i, j], l_out[i, j]


@kernel
def largest_eigenvalue(a: float, b: float, c: float, d: float, e: float, f: float) -> float:
    """Largest eigenvalue of the symmetric matrix [[a, d, e], [d, b, f], [e, f, c]].

    Trigonometric solution of the characteristic cubic (Smith, CACM 4(4), 1961).
    """
    off = d * d + e * e + f * f
    mean = (a + b + c) / 3.0
    if off == 0.0:
        return max(a, b, c)
    spread = math.sqrt(((a - mean) ** 2 + (b - mean) ** 2 + (c - mean) ** 2 + 2.0 * off) / 6.0)
    ba, bb, bc = (a - mean) / spread, (b - mean) / spread, (c - mean) / spread
    bd, be, bf = d / spread, e / spread, f / spread
    det = ba * (bb * bc - bf * bf) - bd * (bd * bc - bf * be) + be * (bd * bf - bb * be)
    angle = math.acos(min(1.0, max(-1.0, 0.5 * det))) / 3.0
    return mean + 2.0 * spread * math.cos(angle)


@kernel
def position_deviation(p: Float2D, l: Float2D, dimension: int) -> float:  # noqa: E741
    """Largest standard deviation of the position part of Σ = P + Λ [m], in the plane or in space.

    ``p`` (6, 6) is P and ``l`` (6, 6) Λ.
    """
    a, b, d = p[0, 0] + l[0, 0], p[1, 1] + l[1, 1], p[0, 1] + l[0, 1]
    if dimension == 2:
        return math.sqrt(max(0.0, 0.5 * (a + b) + math.sqrt(0.25 * (a - b) ** 2 + d * d)))
    return math.sqrt(
        max(0.0, largest_eigenvalue(a, b, p[2, 2] + l[2, 2], d, p[0, 2] + l[0, 2], p[1, 2] + l[1, 2]))
    )


@kernel
def position_factor(p: Float2D, l: Float2D, dimension: int, factor: Float2D) -> None:  # noqa: E741
    """Lower Cholesky factor of the position part of Σ, into ``factor`` (3, 3) [m].

    ``p`` (6, 6) is P and ``l`` (6, 6) Λ; the up row is 0 in the plane.
    """
    factor[:] = 0.0
    s00, s10, s11 = p[0, 0] + l[0, 0], p[1, 0] + l[1, 0], p[1, 1] + l[1, 1]
    factor[0, 0] = math.sqrt(max(s00, 0.0))
    if factor[0, 0] > 0.0:
        factor[1, 0] = s10 / factor[0, 0]
    factor[1, 1] = math.sqrt(max(s11 - factor[1, 0] ** 2, 0.0))
    if dimension == 2:
        return
    s20, s21, s22 = p[2, 0] + l[2, 0], p[2, 1] + l[2, 1], p[2, 2] + l[2, 2]
    if factor[0, 0] > 0.0:
        factor[2, 0] = s20 / factor[0, 0]
    if factor[1, 1] > 0.0:
        factor[2, 1] = (s21 - factor[2, 0] * factor[1, 0]) / factor[1, 1]
    factor[2, 2] = math.sqrt(max(s22 - factor[2, 0] ** 2 - factor[2, 1] ** 2, 0.0))


@kernel
def collision_free(distance: float, deviation: float, dimension: int) -> float:
    """p_c: probability mass of the ellipsoid of ``c = distance/deviation`` deviations, P(n/2, c²/2).

    Closed forms: ``1 − exp(−c²/2)`` for n = 2, ``erf(c/√2) − c·√(2/π)·exp(−c²/2)`` for n = 3.
    """
    if distance <= 0.0:
        return 0.0
    if deviation <= 0.0:
        return 1.0
    c = distance / deviation
    if c > 12.0:
        return 1.0
    tail = math.exp(-0.5 * c * c)
    if dimension == 2:
        return 1.0 - tail
    return max(0.0, math.erf(c / math.sqrt(2.0)) - c * math.sqrt(2.0 / math.pi) * tail)
