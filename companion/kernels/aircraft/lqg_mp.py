"""LQG-MP: the a-priori distribution of the true state about the plan (SPEC 2, paper 2.2).

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

import numba as nb
import numpy as np

from companion.kernels.arrays import FloatArray, Uncertainty


@nb.njit(cache=True, nogil=True)
def linearise(
    theta: float, phi: float, v: float, a: float, w: float, wp: float, tau: float,
    motion: FloatArray, control: FloatArray,
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


@nb.njit(cache=True, nogil=True)
def look_up_gain(v: float, w: float, phi: float, theta: float, tables: Uncertainty, gain: FloatArray) -> None:
    """LQR gain (3, 6) of the nearest tabulated (speed, turn rate, climb), turned to ``theta``.

    The motion is the same in every direction, so the table holds direction 0 only and the position
    columns are rotated: ``L(θ) = L(0)·R(θ)ᵀ``.
    """
    index = np.empty(3, dtype=np.int64)
    values = (v, w, phi)
    for a in range(3):
        n = tables.gains.shape[a]
        index[a] = min(n - 1, max(0, int(round((values[a] - tables.axes[a, 0]) / tables.axes[a, 1]))))
    table = tables.gains[index[0], index[1], index[2]]
    c, s = math.cos(theta), math.sin(theta)
    for i in range(3):
        gain[i, 0] = table[i, 0] * c - table[i, 1] * s
        gain[i, 1] = table[i, 0] * s + table[i, 1] * c
        for j in range(2, 6):
            gain[i, j] = table[i, j]


@nb.njit(cache=True, nogil=True)
def congruence(m: FloatArray, c: FloatArray, scratch: FloatArray, out: FloatArray) -> None:
    """``out = m·c·mᵀ`` for matrices (6, 6)."""
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


@nb.njit(cache=True, nogil=True)
def information_gain(p: FloatArray, measurement: FloatArray, w: FloatArray) -> None:
    """``w`` (6, 5) with ``w·wᵀ = K·S·Kᵀ``, the covariance a measurement takes out of ``p``.

    ``S = H·p·Hᵀ + N`` is factored ``L·Lᵀ`` and ``w = p·Hᵀ·L⁻ᵀ``.
    """
    chol = np.zeros((5, 5))
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


@nb.njit(cache=True, nogil=True)
def propagate(
    state: FloatArray, a: float, w: float, wp: float, tau: float, tables: Uncertainty,
    p: FloatArray, l: FloatArray, p_out: FloatArray, l_out: FloatArray,  # noqa: E741
) -> None:  # fmt: skip
    """One edge of LQG-MP: ``P⁺ = P⁻ − K·S·Kᵀ`` and ``Λ⁺ = (A+BL)Λ(A+BL)ᵀ + K·S·Kᵀ``.

    ``state`` (6,) is the edge's start; ``p``, ``l`` (6, 6) come in, ``p_out``, ``l_out`` go out.
    """
    motion, control = np.empty((6, 6)), np.empty((6, 3))
    gain, scratch, taken = np.empty((3, 6)), np.empty((6, 6)), np.empty((6, 5))
    linearise(state[3], state[4], state[5], a, w, wp, tau, motion, control)
    look_up_gain(state[5], w, state[4], state[3] + 0.5 * w * tau, tables, gain)
    congruence(motion, p, scratch, p_out)
    for i in range(6):
        for j in range(6):
            for k in range(3):
                p_out[i, j] += control[i, k] * tables.process[k] * control[j, k]
                motion[i, j] += control[i, k] * gain[k, j]
    information_gain(p_out, tables.measurement, taken)
    congruence(motion, l, scratch, l_out)
    for i in range(6):
        for j in range(i, 6):
            total = 0.0
            for k in range(5):
                total += taken[i, k] * taken[j, k]
            p_out[i, j] -= total
            l_out[i, j] += total
            p_out[j, i], l_out[j, i] = p_out[i, j], l_out[i, j]


@nb.njit(cache=True, nogil=True)
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


@nb.njit(cache=True, nogil=True)
def position_deviation(p: FloatArray, l: FloatArray, dimension: int) -> float:  # noqa: E741
    """Largest standard deviation of the position part of Σ = P + Λ [m], in the plane or in space."""
    a, b, d = p[0, 0] + l[0, 0], p[1, 1] + l[1, 1], p[0, 1] + l[0, 1]
    if dimension == 2:
        return math.sqrt(max(0.0, 0.5 * (a + b) + math.sqrt(0.25 * (a - b) ** 2 + d * d)))
    return math.sqrt(
        max(0.0, largest_eigenvalue(a, b, p[2, 2] + l[2, 2], d, p[0, 2] + l[0, 2], p[1, 2] + l[1, 2]))
    )


@nb.njit(cache=True, nogil=True)
def position_factor(p: FloatArray, l: FloatArray, dimension: int, factor: FloatArray) -> None:  # noqa: E741
    """Lower Cholesky factor (3, 3) of the position part of Σ; the up row is 0 in the plane."""
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


@nb.njit(cache=True, nogil=True)
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
