"""Structures: what lies in memory, and what is refused."""

import ctypes
import gc
import pickle
import struct
import weakref

import numpy as np
import pytest

from companion.kernels.native import kinds
from tests.kernels.native.sums import Pair, Part, Whole


def part(table=None, scale=2.0, rows=2):
    return Part(np.arange(6.0).reshape(2, 3) if table is None else table, scale, rows)


def whole(**changes):
    fields = {
        "part": part(), "is_on": True, "pair": Pair(np.array([1.0, 2.0]), 10.0),
        "counts": np.zeros(1, dtype=np.int64), "flags": np.array([[True, False, True]]),
        "block": np.arange(12.0).reshape(2, 2, 3),
    }  # fmt: skip
    return Whole(**fields | changes)


def words(structure, form):
    size = struct.calcsize(form)
    return struct.unpack(form, ctypes.string_at(structure.kernel_address, size))


def address(array):
    return array.__array_interface__["data"][0]


def test_words_by_hand():
    made = whole()
    assert words(made.part, "qqqdq") == (address(made.part.table), 2, 3, 2.0, 2)
    assert words(made, "qqqqdqqqqqqqqq") == (
        made.part.kernel_address, 1,
        address(made.pair.values), 2, 10.0,
        address(made.counts), 1,
        address(made.flags), 1, 3,
        address(made.block), 2, 2, 3,
    )  # fmt: skip


def test_offsets_are_those_of_the_words():
    offsets = [kinds.offset_of(Whole, name) for name in Whole.__annotations__]
    assert offsets == [0, 1, 2, 5, 7, 10]
    with pytest.raises(AttributeError, match="none"):
        kinds.offset_of(Whole, "none")


def test_what_a_structure_names_lives_as_long_as_it():
    made = part()
    table = weakref.ref(made.table)
    gc.collect()
    assert table() is not None
    del made
    gc.collect()
    assert table() is None


def test_a_structure_does_not_change_and_has_successors():
    made = whole()
    with pytest.raises(AttributeError, match=r"Whole\.is_on cannot be assigned"):
        made.is_on = False
    other = made._replace(is_on=False)
    assert (made.is_on, other.is_on) == (True, False)
    assert other.part is made.part
    assert other.kernel_address != made.kernel_address


@pytest.mark.parametrize(
    ("values", "named"),
    [((), {}), ((1.0,), {}), ((1.0, 2.0, 3, 4), {}), ((), {"table": 1, "scale": 2, "row": 3})],
)
def test_missing_and_unknown_fields_are_refused(values, named):
    with pytest.raises(TypeError, match=r"Part: .*: expected table, scale, rows, each once"):
        Part(*values, **named)
    with pytest.raises(TypeError, match="each once"):
        Part(np.zeros((1, 1)), 1.0, 1, scale=2.0)


def test_fields_come_in_their_order():
    made = part()
    table, scale, rows = made
    assert (table is made.table, scale, rows) == (True, 2.0, 2)


def test_a_pickled_one_lies_elsewhere_and_says_the_same():
    made = whole()
    copy = pickle.loads(pickle.dumps(made))
    assert copy.kernel_address != made.kernel_address
    assert copy.part.table.tolist() == made.part.table.tolist()
    assert words(copy.part, "qqqdq") == (address(copy.part.table), 2, 3, 2.0, 2)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (np.zeros(6), "Part.table: an array of 1 axes, dtype float64: expected a C-contiguous array of 2"),
        (np.zeros((2, 3), dtype=np.float32), "dtype float32: expected"),
        (np.zeros((3, 2)).T, "not C-contiguous: expected"),
        ([[0.0]], "Part.table: a list: expected"),
    ],
)
def test_arrays_of_another_type_are_refused_by_name(wrong, said):
    with pytest.raises(TypeError, match=said):
        part(wrong)


def test_other_wrong_fields_are_refused_by_name():
    with pytest.raises(TypeError, match=r"Whole\.part: a tuple: expected a Part"):
        whole(part=(1, 2, 3))
    with pytest.raises(TypeError, match=r"Whole.pair\[0\]: a list"):
        whole(pair=Pair([1.0], 1.0))
    with pytest.raises(TypeError, match=r"Whole\.pair: a tuple: expected 2 items"):
        whole(pair=(1.0,))
    with pytest.raises(TypeError, match="Part: "):
        part(rows=1.5)
    with pytest.raises(TypeError, match="Part: "):
        part(scale="much")


def test_annotations_that_kernels_do_not_know_are_refused():
    with pytest.raises(TypeError, match="is no type of a kernel"):
        kinds.kind_of(list[int])

    def without(a, b: float) -> float:
        return a + b

    with pytest.raises(TypeError, match="without: a: no annotation"):
        kinds.signature_of(without)
