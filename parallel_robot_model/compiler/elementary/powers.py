"""Exponential function, hyperbolic tangent, logarithm and powers."""

from __future__ import annotations

import math

import numpy as np

from parallel_robot_model.compiler.elementary import float_bits
from parallel_robot_model.compiler.elementary.float_bits import (
    FRACTION,
    SHIFT,
    bits_of,
    exact_product,
    exact_sum,
    float_of,
    power_of_two,
    quotient,
)
from parallel_robot_model.compiler.kernels import inline_llvm, internal

# Exponential function and the hyperbolic tangent.

LN_2, LN_2_REST = float_bits.parts(*float_bits.LN_2, 40)
PER_LN_2 = 1.0 / float_bits.rounded(*float_bits.LN_2)
OVERFLOW, UNDERFLOW = 709.782712893384, -745.1332191019412  # beyond, the result is inf or 0
SATURATED = 20.0  # the hyperbolic tangent is 1
TINY = 2.0**-54


@internal
def exp(x: float) -> float:
    """Exponential function, with an error of less than 1 unit in the last place.

    The argument less the nearest multiple of log 2 goes into a polynomial.

    Source:
        Cody, Waite (1980), Software manual for the elementary functions. The coefficients
        interpolate the function at Chebyshev's points, up to 1.001 log(2) / 2.
    """
    return limited_exponential(x, 0.0)


@inline_llvm
def limited_exponential(x: float, rest: float) -> float:
    """e^(x + rest) of any x, |rest| < 2^-40."""
    if x != x:
        return x
    if x > OVERFLOW:
        return math.inf
    if x < UNDERFLOW:
        return 0.0
    return exponential(x, rest)


@inline_llvm
def exponential(x: float, rest: float) -> float:
    """e^(x + rest) of an x for which that is neither 0 nor infinite."""
    k, high, low = _reduced(x, rest)
    value = 1.0 + high
    value += ((1.0 - value) + high) + low
    part = k >> 1
    return value * power_of_two(part) * power_of_two(k - part)


@internal
def tanh(x: float) -> float:
    """Hyperbolic tangent: E / (E + 2) with E = e^(2 x) - 1, both with a rest."""
    if abs(x) < TINY or x != x:
        return x
    if abs(x) > SATURATED:
        return math.copysign(1.0, x)
    high, low = _less_one(2.0 * abs(x))
    below, rest = exact_sum(high, 2.0)
    value, error = quotient(high, low, below, rest + low)
    return math.copysign(value + error, x)


@inline_llvm
def _less_one(x: float) -> tuple[float, float]:
    """e^x - 1 as a sum, 0 <= x <= 2 SATURATED."""
    k, high, low = _reduced(x, 0.0)
    scale = power_of_two(k)
    value, error = exact_sum(scale - 1.0, scale * high)
    error += scale * low
    total = value + error
    return total, (value - total) + error


@inline_llvm
def _reduced(x: float, rest: float) -> tuple[int, float, float]:
    """k, and a sum p such that e^(x + rest) = 2^k (1 + p)."""
    shifted = x * PER_LN_2 + SHIFT
    n = shifted - SHIFT
    first = x - n * LN_2
    rest = rest - n * LN_2_REST
    r = first + rest
    low = (first - r) + rest
    z = r * r
    w = z * z
    p = (
        ((0.5 + r * 0.1666666666666667) + z * (0.04166666666666667 + r * 0.008333333333326084))
        + w
        * (
            (0.0013888888888883711 + r * 0.0001984126987500228)
            + z * (2.480158732567746e-05 + r * 2.755725517000089e-06)
        )
        + (w * w)
        * ((2.755727347871858e-07 + r * 2.510531272962211e-08) + z * 2.0914755325893206e-09)
    )
    return bits_of(shifted) - bits_of(SHIFT), r, low * (1.0 + r) + z * p


# Logarithm and powers.

CENTRES, LOWEST, HIGHEST = 64, 45, 91  # of the mantissa, in units of 1/64
LEAST = bits_of(0.704)  # least mantissa: to twice that
NORMAL, RAISED = 2.0**-1022, 54  # numbers below are made larger by 2^54
RAISE = 2.0**RAISED
UPPER = -(1 << 21)  # bits of a float that leave it 32 digits
LARGEST = 2.0**66  # exponents from here on: only the power of 1 is neither 0 nor infinite
PLACES = 40  # of the first part of logarithms


def _near(j: int) -> int:
    """The inverse of a centre, in units of 1/512."""
    return round(512 * CENTRES / j)


INVERSE = np.array([_near(max(j, 1)) / 512.0 for j in range(HIGHEST + 1)])
LOGARITHM = np.array(
    [
        float_bits.logarithm(512, _near(j), PLACES) if j >= LOWEST else (0.0, 0.0)
        for j in range(HIGHEST + 1)
    ]
)


@internal
def log(x: float) -> float:
    """Natural logarithm, with an error of less than 1 unit in the last place.

    That of a power of two, that of a centre near the mantissa, and a polynomial of what is left.

    Source:
        Tang (1990), Table-driven implementation of the logarithm function, ACM TOMS 16(4). The
        coefficients interpolate the function at Chebyshev's points, up to 1/64.
    """
    if not 0.0 < x < math.inf:
        if x == 0.0:
            return -math.inf
        return x if x > 0.0 else math.nan
    return _any_logarithm(x)[0]


@internal
def power(x: float, y: float) -> float:
    """x^y, with an error of less than 1 unit in the last place: e^(y log x) with two floats.

    Special values are those of IEEE 754.
    """
    if NORMAL <= x < math.inf and abs(y) < LARGEST:
        high, low = _logarithm(x, 0)
        product, error = exact_product(y, high)
        if abs(product) < OVERFLOW - 1.0:
            return exponential(product, error + y * low)
    return _special_power(x, y)


@internal
def _special_power(x: float, y: float) -> float:
    """x^y of any two numbers."""
    if y == 0.0 or x == 1.0:
        return 1.0
    if x != x or y != y:
        return math.nan
    size = abs(x)
    whole = np.floor(y) == y
    negative = math.copysign(1.0, x) < 0.0 and whole and np.floor(0.5 * y) != 0.5 * y
    if size == 1.0:
        value = 1.0
    elif size == 0.0 or size == math.inf or abs(y) >= LARGEST:
        value = math.inf if (size > 1.0) == (y > 0.0) else 0.0
    else:
        high, low = _any_logarithm(size)
        product, error = exact_product(y, high)
        value = limited_exponential(product, error + y * low)
    if x < 0.0 and not whole and size < math.inf:
        return math.nan
    return -value if negative else value


@inline_llvm
def _any_logarithm(x: float) -> tuple[float, float]:
    """Natural logarithm of a positive number as a sum."""
    return _logarithm(x * RAISE, RAISED) if x < NORMAL else _logarithm(x, 0)


@inline_llvm
def _logarithm(x: float, shift: int) -> tuple[float, float]:
    """Natural logarithm of x / 2^shift as a sum, x >= NORMAL."""
    bits = bits_of(x)
    k = (bits - LEAST) >> FRACTION
    mantissa = float_of(bits - (k << FRACTION))
    j = int(mantissa * CENTRES + 0.5)
    inverse = INVERSE[j]
    upper = float_of(bits_of(mantissa) & UPPER)
    # mantissa * inverse - 1 = r + r_rest, without an error.
    r, r_rest = exact_sum(upper * inverse - 1.0, (mantissa - upper) * inverse)
    r_upper = float_of(bits_of(r) & UPPER << 6)
    half = 0.5 * r_upper * r_upper
    half_rest = 0.5 * (r - r_upper) * (r + r_upper)
    z = r * r
    p = (
        (0.3333333333333333 + r * -0.2500000000001592)
        + z * (0.20000000000014476 + r * -0.16666666144953557)
        + (z * z) * ((0.14285713811427228 + r * -0.12504273547730665) + z * 0.11114996169705095)
    )
    n = float(k - shift)
    value, first = exact_sum(n * LN_2 + LOGARITHM[j, 0], r)
    value, second = exact_sum(value, -half)
    rest = n * LN_2_REST + LOGARITHM[j, 1]
    rest += (first + second) + (r_rest * (1.0 - r) - half_rest) + (r * z) * p
    total = value + rest
    return total, (value - total) + rest
