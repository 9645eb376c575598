"""Records: named numbers that kernels pass down by address, from Python or from their own stack."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from typing import NamedTuple

import numba
import numpy as np
import pytest
from numba.core.typing.typeof import typeof_impl

from phasemap._kernels.compilation import kernel
from phasemap._kernels.records import MOST_BYTES, assign, clear, column, numbers_of, record, rows_of, words_of


@record
class Pair:
    """Two numbers."""

    length: float
    count: int


@record
class Whole:
    """A record in a record, and a column."""

    one: Pair
    other: Pair
    row: np.ndarray = column(4)


@kernel
def fill(whole: Whole, value: float) -> float:
    """Fill all fields; returns a number of the column."""
    whole.one.length, whole.one.count = value, 3
    for j in range(len(whole.row)):
        whole.row[j] = value * j
    assign(whole.other, whole.one)
    whole.other.length += 1.0
    tail = whole.row[2:]
    tail[1] += 0.5
    return float(tail[1])


@kernel
def on_the_stack(value: float) -> tuple[float, float, float, int, float]:
    """Make a record, have it filled, and clear a part of it."""
    whole = Whole()
    empty = whole.one.length + whole.row[3]
    found = fill(whole, value)
    clear(whole.one)
    return empty, found, whole.one.length + whole.other.length, whole.other.count, whole.row[3]


@record
class Lengths:
    """A number, and some more."""

    first: float
    more: np.ndarray = column(3)


@kernel
def count_up(lengths: Lengths) -> int:
    """Number all numbers."""
    numbers = numbers_of(lengths)
    for j in range(len(numbers)):
        numbers[j] = j
    return len(numbers)


def test_the_numbers_of_a_record_are_its_memory() -> None:
    lengths = Lengths()
    assert count_up(lengths) == 4
    assert (lengths.first, lengths.more.tolist()) == (0.0, [1.0, 2.0, 3.0])


def test_a_record_on_the_stack_is_empty_at_first_and_changed_by_what_it_is_passed_to() -> None:
    assert on_the_stack(2.0) == (0.0, 6.5, 3.0, 3, 6.5)
    assert on_the_stack(4.0) == (0.0, 12.5, 5.0, 3, 12.5)


def test_a_record_that_python_makes_is_changed_in_place() -> None:
    whole = Whole()
    assert fill(whole, 2.0) == 6.5
    assert (whole.one.length, whole.other.length, whole.other.count) == (2.0, 3.0, 3)
    np.testing.assert_array_equal(whole.row, [0.0, 2.0, 4.0, 6.5])


class Rows(NamedTuple):
    """Records that are returned, in an array of words."""

    pairs: np.ndarray


pair_of = rows_of(Pair, Rows, "pairs")
PAIR_WORDS = words_of(Pair)


@kernel
def make_rows() -> Rows:
    """Make three records and change the first and the last."""
    rows = Rows(np.zeros((3, PAIR_WORDS)))
    pair_of(rows).length, pair_of(rows, 2).count = 1.5, 7
    assign(pair_of(rows, 1), pair_of(rows, 2))
    return rows


def test_rows_of_an_array_are_records_to_kernels_and_to_python() -> None:
    rows = make_rows()
    assert [(pair_of(rows, i).length, pair_of(rows, i).count) for i in range(3)] == [(1.5, 0), (0.0, 7), (0.0, 7)]
    pair_of(rows).count = 2
    assert pair_of(rows).count == 2


@pytest.mark.parametrize("copied", [copy.deepcopy, copy.copy, lambda one: pickle.loads(pickle.dumps(one))])
def test_a_copy_of_a_record_is_one_that_kernels_know_and_changes_by_itself(copied: Callable[[Whole], Whole]) -> None:
    first = Whole()
    first.row[:] = 7.0
    second = copied(first)
    assert list(second.row) == [7.0] * 4
    assert fill(second, 2.0) == 6.5
    assert list(first.row) == [7.0] * 4


def test_a_record_made_while_another_thread_compiles_adds_no_class_to_those_that_numba_goes_through() -> None:
    known = list(typeof_impl.registry)

    @record
    class Late:
        x: float

    assert numba.typeof(Late()) is Late.record_type  # type: ignore[attr-defined]
    assert list(typeof_impl.registry) == known


def test_a_record_that_is_too_large_for_a_stack_is_refused() -> None:
    with pytest.raises(TypeError, match="more than a stack"):

        @record
        class Large:
            row: np.ndarray = column(MOST_BYTES)


def test_a_field_that_has_the_name_of_a_method_is_refused() -> None:
    with pytest.raises(TypeError, match=r"Bad\.mean: in Python that is a method"):

        @record
        class Bad:
            mean: float
