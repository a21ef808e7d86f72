"""Memory of any type that kernels read and write in place, and drop or keep what they wrote."""

from typing import NamedTuple

import numpy as np
import pytest

from parallel_robot_model.compiler import (
    KeptValue,
    arrays_of,
    as_arrays,
    as_vectors,
    begin,
    keep,
    kernel,
    plain_type,
    present,
    propose,
    vector,
    vectors_of,
)


class Pair(NamedTuple):
    one: object
    other: object


WHOLE, FLAGS = np.arange(4), np.array([True, False, True])
CASES = {
    'float': (1.5, -2.5),
    'whole number': (3, 4),
    'flag, number, flag': ((True, 0.5, False), (False, 1.5, True)),
    'vector': (np.zeros(3), np.arange(3.0)),
    'matrix in tuples': (
        Pair((True, np.eye(3)), Pair(2, 0.5)),
        Pair((False, 2.0 * np.eye(3)), Pair(-2, 1.5)),
    ),
    'whole numbers and flags': (Pair(WHOLE, FLAGS), Pair(WHOLE + 1, ~FLAGS)),
    'empty': (Pair(np.zeros(0), ()), Pair(np.zeros(0), ())),
    'nothing': (None, None),
}


@kernel
def proposed(kept, value):
    propose(kept, value, value)


@kernel
def found(kept, like):
    return present(kept, like)


@kernel
def kept_by_a_kernel(kept):
    keep(kept)


@kernel
def begun_by_a_kernel(kept):
    begin(kept)


@kernel
def through_arrays(value):
    return vectors_of(arrays_of(value), value)


def same(value, other):
    if isinstance(value, tuple):
        return type(value) is type(other) and all(map(same, value, other))
    return np.array_equal(value, other)


@pytest.mark.parametrize('case', CASES)
def test_what_is_proposed_is_present_once_it_is_kept(case):
    first, second = map(as_vectors, CASES[case])
    kept = KeptValue(first)

    def shows(value):
        return same(found(kept, first), value) and same(kept.value, value)

    assert shows(first)
    for value in (second, first, second):
        proposed(kept, value)
    assert shows(first)
    kept_by_a_kernel(kept)
    assert shows(second)
    proposed(kept, first)
    assert shows(second)
    kept_by_a_kernel(kept)
    assert shows(first)
    proposed(kept, second)
    kept_by_a_kernel(kept)
    begun_by_a_kernel(kept)
    assert shows(first)


def test_a_copy_brings_back_what_was_present():
    kept = KeptValue(vector((1.0, 2.0)))
    proposed(kept, vector((3.0, 4.0)))
    kept_by_a_kernel(kept)
    before, begun = kept.copy(), kept.begun
    proposed(kept, vector((5.0, 6.0)))
    kept_by_a_kernel(kept)
    for copy, value in ((before, [3.0, 4.0]), (begun, [1.0, 2.0])):
        other = KeptValue(vector((0.0, 0.0)))
        for each in (kept, other):
            each.restore(copy)
            assert each.value.tolist() == value


def test_an_array_of_another_size_is_not_read():
    @kernel
    def longer(value):
        return vectors_of(np.zeros(5), value)

    assert np.isnan(longer(vector((1.0, 2.0)))).all()


@pytest.mark.parametrize('case', CASES)
def test_vectors_as_arrays_and_back_are_the_same(case):
    for value in map(as_vectors, CASES[case]):
        assert same(through_arrays(value), value)
        assert same(as_vectors(as_arrays(value)), value)


@pytest.mark.parametrize('value', ['text', [1.0], np.zeros(3, np.float32), (1.0, {})])
def test_nothing_else_is_kept(value):
    assert plain_type(value) is None
    with pytest.raises(TypeError, match='made of numbers, vectors and None'):
        KeptValue(value)
