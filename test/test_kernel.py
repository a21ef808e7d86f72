"""Kernels: plain IEEE arithmetic, functions as values."""

import collections
import gc
from typing import Any, NamedTuple

import numpy as np
import pytest
from numba import typeof, types
from numba.core.runtime import rtsys
from numba.core.runtime._nrt_python import memsys_enable_stats

from parallel_robot_model.compiler import Boxed, FunctionValue, kernel, vector


class Constants(NamedTuple):
    """Constants, one of which Numba counts the references of."""

    counted: Any
    number: float


@kernel
def length(constants):
    """How long the counted one is."""
    return len(constants.counted)


@kernel
def twice(x):
    """2 x."""
    return 2.0 * x


@kernel
def square(x):
    """x^2."""
    return x * x


@kernel
def third(x):
    """Inexact, so that another order of evaluation would show."""
    return (x + 1e16) - 1e16 + x / 3.0


@kernel
def apply(function, x):
    """f(f(x))."""
    return function(function(x))


@kernel
def quotient(a, b):
    """a / b."""
    return a / b


def test_a_kernel_is_a_value_that_another_one_calls():
    doubled, squared = FunctionValue(twice, 1.0), FunctionValue(square, 1.0)
    assert apply(doubled, 3.0) == 12.0
    compiled = len(apply.signatures)
    assert apply(squared, 3.0) == 81.0
    assert len(apply.signatures) == compiled


def test_a_call_by_value_runs_the_same_code():
    by_value = FunctionValue(third, 1.0)
    for x in np.random.default_rng(5).standard_normal(100):
        assert apply(by_value, x) == third(third(x)) == plain(plain(x))


def plain(x):
    return (x + 1e16) - 1e16 + x / 3.0


def test_first_class_needs_no_compiling_anew():
    FunctionValue(twice, 1.0)
    before = len(twice.signatures)
    FunctionValue(twice, 7.0)
    assert len(twice.signatures) == before


def test_a_tuple_has_the_type_that_numba_gives_it():
    """Also where another class has its names, or its elements are of another size."""
    Other = collections.namedtuple('Constants', Constants._fields)
    vectors = [vector(each) for each in ([1.0], [1.0, 2.0], [[1.0], [2.0]])]
    contents = [1.0, 1, None, (1.0, 2), np.zeros(2), *vectors]
    values = [kind(content, 1.0) for kind in (Constants, Other) for content in contents]
    found = [typeof(value) for value in values]
    for value, kind in zip(values, found, strict=True):
        elements = [typeof(element) for element in value]
        assert kind is types.BaseTuple.from_types(elements, type(value)) is typeof(value)
    assert len(set(found)) == len(values)


def test_a_type_that_numba_does_not_know_is_refused_in_a_tuple_as_well():
    with pytest.raises(ValueError, match='Cannot determine Numba type'):
        typeof((1.0, object()))


def test_division_by_zero_is_that_of_ieee_754():
    assert quotient(1.0, 0.0) == np.inf
    assert np.isnan(quotient(0.0, 0.0))


@pytest.mark.parametrize(
    ('counted', 'made'), [('printed', 1), (np.arange(7.0), 0)], ids=['text', 'array']
)
def test_what_boxed_constants_hold_is_kept(counted, made):
    """A text by the copy in memory, an array by the object that is boxed."""
    boxed = Boxed(Constants(counted, 1.0))  # its kernel is compiled here
    memsys_enable_stats()
    gc.collect()  # what other tests have left would be freed meanwhile
    before = rtsys.get_allocation_stats()
    boxed = Boxed(Constants(counted, 1.0))
    for _ in range(100):
        assert length(boxed) == 7
    after = rtsys.get_allocation_stats()
    assert (after.mi_alloc - before.mi_alloc, after.mi_free - before.mi_free) == (made, 0)
