"""Memory of any type whose fields kernels and Python read and write."""

from typing import NamedTuple

import numpy as np
import pytest

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import (
    Struct,
    arrays_of,
    as_arrays,
    as_vectors,
    kernel,
    plain_type,
    vector,
    vectors_of,
    write_row,
    zeros_of,
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
def written(struct, value):
    struct.one = value


@kernel
def found(struct):
    return struct.one


@kernel
def through_arrays(value):
    return vectors_of(arrays_of(value), value)


def same(value, other):
    if isinstance(value, tuple):
        return type(value) is type(other) and all(map(same, value, other))
    return np.array_equal(value, other)


@pytest.mark.parametrize('case', CASES)
def test_what_one_side_writes_the_other_reads(case):
    first, second = map(as_vectors, CASES[case])
    struct = Struct(Pair(first, first))

    def shows(value):
        values = found(struct), struct.one, struct.value.one
        return all(same(each, value) for each in values) and same(struct.other, first)

    assert shows(first)
    written(struct, second)
    assert shows(second)
    struct.one = first
    assert shows(first)


class Row(NamedTuple):
    count: int
    rows: object
    last: object


@kernel
def added(struct, value):
    struct.last.one = value
    write_row(struct.rows, struct.count, value)
    struct.count += 1


def test_a_copy_brings_back_arrays_and_structs_too():
    def made():
        return Struct(Row(0, np.zeros((3, 2)), Struct(Pair(vector((0.0, 0.0)), 1.5))))

    def shows(struct):
        return struct.count, struct.rows.tolist(), struct.last.one.tolist(), struct.last.other

    struct = made()
    added(struct, vector((1.0, 2.0)))
    before, copy = shows(struct), struct.copy()
    assert before == (1, [[1.0, 2.0], [0.0, 0.0], [0.0, 0.0]], [1.0, 2.0], 1.5)
    added(struct, vector((3.0, 4.0)))
    assert shows(struct) == (2, [[1.0, 2.0], [3.0, 4.0], [0.0, 0.0]], [3.0, 4.0], 1.5)
    other = made()
    for each in (struct, other):
        each.restore(copy)
        assert shows(each) == before
    added(other, vector((3.0, 4.0)))
    assert shows(struct) == before


def test_it_has_its_fields_alone():
    struct = Struct(Pair(1.0, 2.0))
    assert hasattr(struct, 'one') and not hasattr(struct, 'third')


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
def test_nothing_else_is_plain(value):
    assert plain_type(value) is None


class Inner(NamedTuple):
    rate: Array
    steps: int


class Outer(NamedTuple):
    known: bool
    size: float
    inner: Inner


def test_zeros_are_of_the_types_of_the_fields():
    zero = vector(np.zeros(2))
    begun = zeros_of(Outer, zero)
    assert [type(each) for each in begun] == [bool, float, Inner]
    assert begun.inner.rate is zero and type(begun.inner.steps) is int
