"""Arrays in compiled code: what is borrowed is counted nowhere, what lies on the stack is apart from all else."""

import sys
from typing import Any

import numpy as np
import pytest
from numba.core.errors import TypingError
from numba.typed import List
from numpy.typing import NDArray

from navbench.compiled import compiled
from navbench.memory import borrowed, scratch

Array = NDArray[np.float64]
Nested = tuple[Array, tuple[Array, float]]


@compiled
def given_back(array: Array) -> Array:
    return array


@compiled
def lent_and_given_back(array: Array) -> Array:
    return borrowed(array)


@compiled
def lent_list_and_array(numbers: Any, array: Array) -> float:
    lent, _ = borrowed((numbers, array))
    first: float = lent[0]
    return first


@compiled
def write_through(given: Nested) -> float:
    first, (second, number) = borrowed(given)
    first[0], second[1] = number, 2.0 * number
    found: float = first[0] + second[1]
    return found


@compiled
def both(count: int) -> tuple[float, float]:
    one, other = scratch((count, 3)), scratch((count,))
    for i in range(count):
        other[i] = -1.0
    for i in range(count):
        for k in range(3):
            one[i, k] = i + 0.5 * k
    return one.sum(), other.sum()


@compiled
def again(times: int) -> float:
    return sum([both(50)[0] for _ in range(times)])


def test_what_is_borrowed_is_the_same_memory_and_knows_no_owner() -> None:
    array = np.arange(3.0)
    before, lent = sys.getrefcount(array), lent_and_given_back(array)
    assert given_back(array) is array  # whose owner came with it
    assert lent is not array
    assert lent.base is None
    assert np.shares_memory(lent, array)
    assert sys.getrefcount(array) == before


def test_tuples_of_arrays_and_numbers_are_borrowed_as_a_whole_and_may_be_written_to() -> None:
    first, second = np.zeros(2), np.zeros(2)
    assert write_through((first, (second, 3.0))) == 9.0
    assert (first.tolist(), second.tolist()) == ([3.0, 0.0], [0.0, 6.0])


def test_what_is_counted_and_no_array_is_not_borrowed() -> None:
    with pytest.raises(TypingError):
        lent_list_and_array(List([1.0]), np.zeros(1))


def test_arrays_on_the_stack_do_not_overlap_and_are_given_back() -> None:
    wanted = sum(i + 0.5 * k for i in range(50) for k in range(3))
    assert both(50) == (wanted, -50.0)
    assert again(100_000) == 100_000 * wanted  # 160 MB, were they kept


def test_without_a_compiler_they_are_what_they_are_called() -> None:
    array = np.zeros(3)
    assert borrowed(array) is array
    assert scratch((2, 3)).shape == (2, 3)
