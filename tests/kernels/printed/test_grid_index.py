"""Nearest nodes by cells against a look at all of them, while the tree grows and is cut back."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.kernels.arrays import empty_index
from companion.kernels.printed import grid_index as b
from companion.kernels.workspace import empty_nearest

BOUNDS = np.array([0.0, 1000.0, -200.0, 500.0])
ALL = np.empty(0, dtype=np.int64)


class Index:
    def __init__(self, capacity):
        self.index = empty_index(capacity)

    @property
    def filled(self):
        return self.index.filled

    def follow(self, rows, n):
        b.follow(self.index, self.index.filled[0], rows, n, BOUNDS)

    def nearest(self, rows, x, y, k, active=ALL):
        """As :func:`nearest_by_cells` finds them, whatever the number of rows."""
        near = empty_nearest(16)
        found = b.nearest_by_cells(self.index, rows, BOUNDS, active, x, y, k, near)
        return near.rows[:found].tolist() if found >= 0 else None

    def ask(self, rows, n, x, y, k, active=ALL):
        near = empty_nearest(16)
        found = b.nearest(self.index, rows, n, BOUNDS, active, x, y, k, near)
        return near.rows[:found].tolist()


def by_looking(rows, n, x, y, k, active=ALL):
    """Rows by (distance, row), as NumPy sorts them."""
    d2 = (rows[:n, 0] - x) ** 2 + (rows[:n, 1] - y) ** 2
    which = np.arange(n) if active.size == 0 else np.flatnonzero(active[:n])
    return which[np.lexsort((which, d2[which]))][:k].tolist()


@settings(max_examples=80, deadline=None)
@given(st.integers(0, 2**32 - 1), st.booleans(), st.sampled_from([1, 3, 5, 15]))
def test_the_nearest_by_cells_are_the_nearest_of_all(seed, coarse, k):
    rng = np.random.default_rng(seed)
    index, rows, n = Index(400), np.zeros((400, 3)), 0
    for _ in range(12):
        # Places crowd together, lie outside the bounds, or coincide (on a coarse raster).
        grown = int(rng.integers(0, 80))
        centre, spread = rng.uniform(-200.0, 1200.0, 2), rng.choice([20.0, 200.0, 900.0])
        new = centre + spread * rng.standard_normal((grown, 2))
        if coarse:
            new = 100.0 * np.round(new / 100.0)
        n = int(rng.integers(max(0, n - 60), n + 1))
        index.follow(rows, n)
        grown = min(grown, 400 - n)
        rows[n : n + grown, :2] = new[:grown]
        n += grown
        index.follow(rows, n)
        assert index.filled[0] == n
        active = (rng.random(400) < rng.choice([0.05, 0.9])).astype(np.int64)
        for x, y in rng.uniform(-400.0, 1300.0, (6, 2)):
            assert index.nearest(rows, x, y, k) == by_looking(rows, n, x, y, k)
            assert index.nearest(rows, x, y, k, active) == by_looking(rows, n, x, y, k, active)
            near = empty_nearest(16)
            found = b.nearest_of_all(rows, n, active, x, y, k, near)
            assert near.rows[:found].tolist() == by_looking(rows, n, x, y, k, active)


def test_a_node_taken_back_and_replaced_is_noticed():
    index, rows = Index(4), np.array([[10.0, 0.0], [20.0, 0.0], [30.0, 0.0], [0.0, 0.0]])
    index.follow(rows, 3)
    assert index.nearest(rows, 31.0, 0.0, 1) == [2]
    rows[2] = 900.0, 400.0  # dropped, and another node put in its row
    index.follow(rows, 3)
    assert index.nearest(rows, 31.0, 0.0, 1) == [1]
    assert index.nearest(rows, 899.0, 400.0, 1) == [2]
    index.follow(rows, 0)
    assert index.nearest(rows, 31.0, 0.0, 1) == []


def test_what_is_no_number_is_put_somewhere_and_breaks_nothing():
    index, rows = Index(3), np.array([[np.nan, np.nan], [np.inf, -np.inf], [500.0, 100.0]])
    index.follow(rows, 3)
    assert index.filled[0] == 3
    assert index.nearest(rows, 500.0, 101.0, 1) == [2]


def test_an_index_of_a_tree_that_was_rearranged_is_made_anew():
    rng = np.random.default_rng(3)
    rows = np.column_stack([rng.uniform(0.0, 1000.0, 200), rng.uniform(-200.0, 500.0, 200)])
    index = Index(300)
    assert index.ask(rows, 200, 500.0, 100.0, 3) == by_looking(rows, 200, 500.0, 100.0, 3)
    rows[:199] = rows[np.r_[0:50, 51:200]]  # one row taken out of the middle, those after it moved up
    rows[180] = rows[3]  # and the last place kept by chance
    assert index.nearest(rows, *rows[120], 1) is None
    assert index.ask(rows, 199, *rows[120], 5) == by_looking(rows, 199, *rows[120], 5)
    assert index.ask(rows, 199, 10.0, -150.0, 5) == by_looking(rows, 199, 10.0, -150.0, 5)


def test_trees_larger_than_the_index_are_looked_through():
    rng = np.random.default_rng(4)
    rows = np.column_stack([rng.uniform(0.0, 1000.0, 200), rng.uniform(-200.0, 500.0, 200)])
    assert Index(100).ask(rows, 200, 500.0, 100.0, 3) == by_looking(rows, 200, 500.0, 100.0, 3)
