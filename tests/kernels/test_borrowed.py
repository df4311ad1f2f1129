"""Arrays without an owner: the same memory and no counting."""

import sys
from typing import NamedTuple

import numba as nb
import numpy as np

from companion.kernels.arrays import FloatArray
from companion.kernels.borrowed import borrowed


class Pair(NamedTuple):
    values: FloatArray
    number: float


@nb.njit
def doubled(pair):
    pair = borrowed(pair)
    pair.values[:] *= pair.number
    return pair.values.sum()


@nb.njit
def summed(table):
    rows = borrowed(table)
    total = 0.0
    for row in range(rows.shape[0]):
        part = rows[row]  # a view of a view
        total += part[0] + part[-1]
    return total


def test_the_memory_is_the_same_and_nobody_is_counted():
    values = np.arange(5.0)
    before = sys.getrefcount(values)
    for _ in range(1000):
        doubled(Pair(values, 1.0))
    # A call that counted once too often, or too seldom, would show a thousand times.
    assert abs(sys.getrefcount(values) - before) < 10
    assert doubled(Pair(values, 2.0)) == 20.0
    assert values.tolist() == [0.0, 2.0, 4.0, 6.0, 8.0]


def test_views_of_it_are_right():
    assert summed(np.arange(12.0).reshape(3, 4)) == (0 + 3) + (4 + 7) + (8 + 11)
