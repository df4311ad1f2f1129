"""Kernels that only tests call."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from companion.kernels.arrays import Float1D, Float2D, Float3D, Int1D
from companion.kernels.native.kernel import (
    inlined,
    kernel,
    kernel_numpy_errors,
    local_floats,
    local_ints,
    local_table,
)
from companion.kernels.native.kinds import Array
from companion.kernels.native.struct import Struct

HALF = 0.5
Bool2D = Annotated[NDArray[np.bool_], Array("b", 2)]


class Pair(NamedTuple):
    values: Float1D
    weight: float


class Part(Struct):
    table: Float2D
    scale: float
    rows: int


class Whole(Struct):
    part: Part
    is_on: bool
    pair: Pair
    counts: Int1D
    flags: Bool2D
    block: Float3D


@inlined
def square(x: float) -> float:
    return x * x


@kernel
def row_sum(part: Part, i: int) -> float:
    total = 0.0
    for j in range(part.table.shape[1]):
        total += square(part.table[i, j])
    return HALF * part.scale * total


@kernel
def everything(whole: Whole, out: Float1D) -> tuple[float, int, bool]:
    """Reads each field of each kind, through another structure and a tuple."""
    total = 0.0
    for i in range(whole.part.rows):
        out[i] = row_sum(whole.part, i)
        total += out[i]
    for value in whole.pair.values:
        total += whole.pair.weight * value
    for i in range(whole.flags.shape[0]):
        for j in range(whole.flags.shape[1]):
            if whole.flags[i, j]:
                whole.counts[0] += 1
    total += whole.block[1, 0, 2]
    return total, whole.counts[0], whole.is_on


@kernel
def quotient(a: float, b: float) -> float:
    return a / b


@kernel_numpy_errors
def ieee_quotient(a: float, b: float) -> float:
    return a / b


@kernel
def quotient_of_called(a: float, b: float) -> float:
    return 1.0 + quotient(a, b)


@kernel
def is_larger(n: int, limit: float) -> bool:
    return n > limit


@inlined
def pair_of(values: Float1D) -> Pair:
    return Pair(values, 1.0)


@kernel
def nothing(out: Float1D) -> None:
    out[0] = 1.0


@kernel
def functions_of(a: float, i: int) -> tuple[float, float, float, float, int]:
    """Functions whose code comes from the C library, and Python's own rounding and remainders."""
    smooth = math.atan2(a, 2.0) + math.erf(a) + math.log1p(abs(a)) + math.hypot(a, 1.0) + math.exp(-abs(a))
    powers = abs(a) ** 1.5 + a**2 + math.tan(0.1 * a) + math.asin(math.sin(a)) + math.acos(math.cos(a))
    return smooth, powers, a % 3.0, float(round(a) + math.floor(a) + math.ceil(a)), i % 7 + i // 7


@kernel
def with_local_arrays(n: int) -> float:
    floats, ints, table = local_floats(4), local_ints(4), local_table(2, 3)
    floats[:] = 0.25
    ints[:] = n
    table[:] = 1.0
    table[1, 2] = 5.0
    part = floats[1:3]
    part[0] = 2.0
    return floats[0] + floats[1] + floats[2] + ints[3] + table[0, 2] + table[1, 2]


@kernel
def assigned(to: Float2D, row: Float1D, first: int, last: int) -> None:
    """Rows, slices and columns are assigned, from arrays and from numbers."""
    to[0] = row
    to[1, first:last] = row[first:last]
    to[2:4] = to[0:2]
    to[4, :] = 7
    to[5:, 0] = -1.5
