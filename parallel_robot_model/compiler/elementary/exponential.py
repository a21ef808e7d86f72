"""Exponential function and the hyperbolic tangent."""

from __future__ import annotations

import math

from parallel_robot_model.compiler.elementary import float_bits
from parallel_robot_model.compiler.elementary.float_bits import (
    SHIFT,
    bits_of,
    exact_sum,
    power_of_two,
    quotient,
)
from parallel_robot_model.compiler.kernels import inner, merged

LN_2, LN_2_REST = float_bits.parts(*float_bits.LN_2, 40)
PER_LN_2 = 1.0 / float_bits.rounded(*float_bits.LN_2)
OVERFLOW, UNDERFLOW = 709.782712893384, -745.1332191019412  # beyond, the result is inf or 0
SATURATED = 20.0  # the hyperbolic tangent is 1
TINY = 2.0**-54


@inner
def exp(x: float) -> float:
    """Exponential function, with an error of less than 1 unit in the last place.

    The argument less the nearest multiple of log 2 goes into a polynomial.

    Source:
        Cody, Waite (1980), Software manual for the elementary functions. The coefficients
        interpolate the function at Chebyshev's points, up to 1.001 log(2) / 2.
    """
    return limited_exponential(x, 0.0)


@merged
def limited_exponential(x: float, rest: float) -> float:
    """e^(x + rest) of any x, |rest| < 2^-40."""
    if x != x:
        return x
    if x > OVERFLOW:
        return math.inf
    if x < UNDERFLOW:
        return 0.0
    return exponential(x, rest)


@merged
def exponential(x: float, rest: float) -> float:
    """e^(x + rest) of an x for which that is neither 0 nor infinite."""
    k, high, low = _reduced(x, rest)
    value = 1.0 + high
    value += ((1.0 - value) + high) + low
    part = k >> 1
    return value * power_of_two(part) * power_of_two(k - part)


@inner
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


@merged
def _less_one(x: float) -> tuple[float, float]:
    """e^x - 1 as a sum, 0 <= x <= 2 SATURATED."""
    k, high, low = _reduced(x, 0.0)
    scale = power_of_two(k)
    value, error = exact_sum(scale - 1.0, scale * high)
    error += scale * low
    total = value + error
    return total, (value - total) + error


@merged
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
