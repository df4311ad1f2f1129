"""Kernels called from Python and from each other: the same as the same code as Python."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.kernels.native.kernel import Kernel
from tests.kernels.native import sums
from tests.kernels.native.test_struct import part, whole


def as_python(function):
    return function.py_func if isinstance(function, Kernel) else function


def test_fields_of_every_kind_are_read_and_results_of_every_kind_come_back():
    made, out = whole(), np.zeros(2)
    assert sums.everything(made, out) == (0.5 * 2.0 * (5.0 + 50.0) + 30.0 + 8.0, 2, True)
    assert out.tolist() == [5.0, 50.0]
    assert made.counts.tolist() == [2]
    assert sums.is_larger(3, 2.5) is True
    assert sums.is_larger(2, 2.5) is False
    assert sums.nothing(out) is None
    assert out[0] == 1.0


def test_integers_do_for_numbers_and_numpys_scalars_too():
    assert sums.quotient(1, np.int64(4)) == 0.25
    assert sums.row_sum(part(), np.int64(0)) == 5.0


def test_an_inlined_one_can_be_called_as_well():
    assert sums.square(3.0) == 9.0


def test_a_division_by_zero_raises_through_calls():
    with pytest.raises(ZeroDivisionError):
        sums.quotient(1.0, 0.0)
    with pytest.raises(ZeroDivisionError):
        sums.quotient_of_called(1.0, 0.0)
    assert sums.quotient_of_called(1.0, 2.0) == 1.5  # and the next call is none the worse


def test_compiled_it_gives_infinity_where_that_is_asked_for():
    assert sums.ieee_quotient(-1.0, 0.0) == -math.inf


@given(st.floats(-1e3, 1e3), st.integers(-1000, 1000))
def test_functions_agree_with_pythons(a, i):
    assert sums.functions_of(a, i) == pytest.approx(as_python(sums.functions_of)(a, i), rel=1e-12, abs=1e-12)


def test_local_arrays():
    assert sums.with_local_arrays(3) == 0.25 + 2.0 + 0.25 + 3.0 + 1.0 + 5.0


@given(st.integers(0, 4), st.integers(0, 4))
def test_assignments_are_numpys(first, last):
    to, expected, row = np.zeros((7, 4)), np.zeros((7, 4)), np.array([1.0, 2.0, 3.0, 4.0])
    sums.assigned(to, row, first, last)
    as_python(sums.assigned)(expected, row, first, last)
    assert np.array_equal(to, expected)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((whole(), np.zeros((2, 2))), "everything: out: an array of 2 axes"),
        ((whole(), np.zeros(4)[::2]), "not C-contiguous"),
        ((part(), np.zeros(2)), "everything: whole: a Part: expected a Whole"),
        ((whole(),), r"everything: 1 arguments: expected 2, \('whole', 'out'\)"),
    ],
)
def test_compiled_wrong_arguments_are_refused_by_name(arguments, said):
    with pytest.raises(TypeError, match=said):
        sums.everything(*arguments)


def test_compiled_what_returns_more_than_numbers_is_for_kernels_alone():
    with pytest.raises(
        TypeError, match=r"sums\.pair_of returns a Pair: expected numbers to call it from Python"
    ):
        sums.pair_of(np.zeros(1))


def test_compiled_wrong_numbers_are_refused_by_name():
    with pytest.raises(TypeError, match=r"quotient\('a', 'b'\): \('one', 1.0\)"):
        sums.quotient("one", 1.0)
    with pytest.raises(TypeError, match="is_larger"):
        sums.is_larger(1.5, 1.0)
