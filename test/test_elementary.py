"""Elementary functions of kernels against the C library in 80 bits; nothing of libm, no FMA."""

import itertools
import math
import re

import numba
import numpy as np
import pytest

from parallel_robot_model.compiler import arctangent, cosine, kernel, sine
from parallel_robot_model.compiler.elementary.names import OF_ONE, OF_TWO

COUNT = 100_000  # points of each range
ODD = [0.0, math.inf, math.nan, 5e-324, 1e-310, 2.0**-1022, 0.5, 1.0, 3.0, math.pi, 1e22, 1e308]
SPECIAL = np.array([*ODD, *(-each for each in ODD)])
HARD = 6381956970095103.0 * 2.0**797  # the float nearest to a multiple of pi/2
EXACT = {
    'sin': np.sin, 'cos': np.cos, 'tan': np.tan, 'asin': np.arcsin, 'acos': np.arccos,
    'atan': np.arctan, 'exp': np.exp, 'log': np.log, 'tanh': np.tanh,
    'atan2': np.arctan2, 'power': np.power,
}  # fmt: skip
LIBM = re.compile(r'@"?(?:llvm\.)?(a?sin|a?cos|a?tan2?|exp|log|pow|tanh|fma|fmuladd)\b')


def ranges(rng):
    """Numbers of all sizes, usual ones, and some near multiples of pi/2."""
    sizes = np.exp(rng.uniform(np.log(5e-324), np.log(1e308), COUNT))
    near = np.arange(1, COUNT) * (0.5 * np.pi)
    usual = rng.uniform(-10.0, 10.0, COUNT)
    signs = rng.choice([-1.0, 1.0], COUNT)
    one = 1.0 + signs * np.exp(rng.uniform(-36.0, -2.0, COUNT))
    unit = rng.uniform(-1.0, 1.0, COUNT)
    found = [SPECIAL, [HARD], sizes * signs, usual, near, np.nextafter(near, 0.0), one, unit]
    return np.concatenate([*found, rng.uniform(-750.0, 750.0, COUNT)])


def compiled(name, count):
    """A kernel that maps a function over arrays."""
    names = [f'x{k}' for k in range(count)]
    text = f'lambda {", ".join(names)}: f({", ".join(names)})'
    return numba.vectorize([('float64(' + ', '.join(['float64'] * count) + ')')])(
        eval(text, {'f': name})
    )


def units(found, exact):
    """Largest distance from the exact values, in units of the last place of their floats."""
    with np.errstate(all='ignore'):
        nearest = exact.astype(np.float64)
        apart = np.abs(found - exact) / np.spacing(np.abs(nearest))
    same = (found == nearest) | (np.isnan(found) & np.isnan(nearest))
    finite = np.isfinite(found) & np.isfinite(nearest)
    return float(np.max(np.where(finite, apart, np.where(same, 0.0, np.inf))))


@pytest.mark.parametrize('function', [*OF_ONE, *OF_TWO], ids=lambda each: each.py_func.__name__)
def test_the_error_is_below_one_unit_in_the_last_place(function):
    name, rng = function.py_func.__name__, np.random.default_rng(1)
    count = 2 if function in OF_TWO else 1
    arguments = [ranges(rng) for _ in range(count)]
    if count == 2:
        rng.shuffle(arguments[1])
        pairs = np.array([*itertools.product(SPECIAL, SPECIAL)]).T
        arguments = [np.append(*both) for both in zip(arguments, pairs, strict=True)]
        small = rng.uniform(-3.0, 3.0, (2, COUNT))
        arguments = [np.append(*both) for both in zip(arguments, small, strict=True)]
    wide = [each.astype(np.longdouble) for each in arguments]
    with np.errstate(all='ignore'):
        exact = EXACT[name](*wide)
    for spelled in (OF_ONE | OF_TWO)[function][:2]:
        with np.errstate(all='ignore'):
            found = compiled(spelled, count)(*arguments)
        assert units(found, exact) < 1.0
        zero = (exact == 0.0) & (found == 0.0)
        assert np.array_equal(np.signbit(found[zero]), np.signbit(exact[zero]))


def test_python_has_the_bits_of_kernels():
    x = np.random.default_rng(2).uniform(-4.0, 4.0, 1000)

    @kernel
    def one(a, b):
        return math.sin(a), math.cos(a), math.atan2(a, b)

    rows = np.array([one(a, b) for a, b in zip(x, x[::-1], strict=True)]).T
    assert np.array_equal(rows, [sine(x), cosine(x), arctangent(x, np.ascontiguousarray(x[::-1]))])


def test_kernels_call_no_libm_and_contract_nothing():
    @numba.njit(error_model='numpy')
    def every(x, y):
        a = math.sin(x) + np.cos(y) * math.tan(x) + np.exp(x) * math.log(y) + np.tanh(x)
        return a + abs(x) ** y + math.atan2(x, y) + np.arcsin(x) + math.acos(y) + np.arctan(x)

    every(0.5, 0.7)
    text = every.inspect_llvm(every.signatures[0])
    declared = [line for line in text.splitlines() if line.startswith('declare')]
    assert declared and not any(map(LIBM.search, declared))
    assert 'vfmadd' not in every.inspect_asm(every.signatures[0])
