"""The 64 bits of a float as a whole number, and sums and products without an error."""

from __future__ import annotations

import math
import struct
from typing import Any

from llvmlite import ir
from numba import types

from parallel_robot_model.compiler.kernels import inline_llvm
from parallel_robot_model.compiler.numba_parts import in_kernels

SHIFT = 1.5 * 2.0**52  # x + SHIFT - SHIFT is the whole number nearest to x
FRACTION = 52  # bits
BIAS = 1023  # of the exponent
_HALF = 2.0**27 + 1.0  # halves the digits of a float


def bits_of(x: float) -> int:
    """Bits of a float, signed."""
    return int(struct.unpack('<q', struct.pack('<d', x))[0])


def float_of(bits: int) -> float:
    """The float that has these bits."""
    return float(struct.unpack('<d', struct.pack('<q', bits))[0])


@in_kernels(bits_of)
def _bits_of(context: Any, x: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.bitcast(values[0], ir.IntType(64))

    return (types.int64(x), generate) if x == types.float64 else None


@in_kernels(float_of)
def _float_of(context: Any, bits: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.bitcast(values[0], ir.DoubleType())

    return types.float64(types.int64), generate


@inline_llvm
def power_of_two(exponent: int) -> float:
    """2^exponent, for -1022 <= exponent <= 1023."""
    return float_of((exponent + BIAS) << FRACTION)


@inline_llvm
def exact_sum(a: float, b: float) -> tuple[float, float]:
    """a + b, and what rounding took from it.

    Source:
        Knuth (1969), The art of computer programming, volume 2, section 4.2.2.
    """
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


@inline_llvm
def halves(a: float) -> tuple[float, float]:
    """Two floats of 26 digits each whose sum is `a`, |a| < 2^996.

    Source:
        Veltkamp; Dekker (1971), A floating-point technique for extending the available precision.
    """
    large = a * _HALF
    high = large - (large - a)
    return high, a - high


@inline_llvm
def exact_product(a: float, b: float) -> tuple[float, float]:
    """a b, and what rounding took from it, by Dekker (1971)."""
    product = a * b
    a1, a2 = halves(a)
    b1, b2 = halves(b)
    return product, ((a1 * b1 - product) + a1 * b2 + a2 * b1) + a2 * b2


@inline_llvm
def quotient(over: float, rest: float, below: float, more: float) -> tuple[float, float]:
    """(over + rest) / (below + more) as a sum; the second floats are small."""
    value = over / below
    product, error = exact_product(value, below)
    return value, (((over - product) - error) + (rest - value * more)) / below


# Constants of the elementary functions, computed with whole numbers and then rounded.

DIGITS = 1300  # bits behind the point of numbers in this module; pi has to serve all floats
SHORT = 200  # bits behind the point of logarithms and arcus tangents


def _series(first: int, ratio: int, bits: int) -> int:
    """The sum of first ratio^k / (2 k + 1), k = 0, 1, ...; numbers times 2^bits."""
    total, term, k = 0, abs(first), 1
    while term:
        total += term // k if ratio > 0 or k % 4 == 1 else -(term // k)
        term = (term * abs(ratio)) >> bits
        k += 2
    return total if first > 0 else -total


def _pi() -> int:
    """pi 2^DIGITS, by Machin (1706): pi/4 = 4 arctan(1/5) - arctan(1/239)."""
    bits = DIGITS + 32
    fifth, small = (_series((1 << bits) // n, -((1 << bits) // (n * n)), bits) for n in (5, 239))
    return (16 * fifth - 4 * small) >> 32


def _arctangent(numerator: int, denominator: int) -> int:
    """arctan(numerator / denominator) 2^SHORT, of a ratio of at most 1."""
    # arctan t = 2 arctan(t / (1 + sqrt(1 + t^2))), three times: then the series is short.
    one = 1 << SHORT
    t = (numerator << SHORT) // denominator
    for _ in range(3):
        t = (t << SHORT) // (one + math.isqrt((one << SHORT) + t * t))
    return _series(t, -((t * t) >> SHORT), SHORT) << 3


def _logarithm(numerator: int, denominator: int) -> int:
    """log(numerator / denominator) 2^SHORT = 2 artanh((n - d) / (n + d)) 2^SHORT."""
    t = ((numerator - denominator) << SHORT) // (numerator + denominator)
    return 2 * _series(t, (t * t) >> SHORT, SHORT)


def rounded(number: int, bits: int) -> float:
    """The float nearest to number / 2^bits."""
    return number / (1 << bits)


def parts(number: int, bits: int, *digits: int) -> tuple[float, ...]:
    """Floats whose sum is number / 2^bits: cut behind so many binary places, and the rest."""
    found = []
    for places in digits:
        cut = number >> (bits - places)
        found.append(rounded(cut, places))
        number -= cut << (bits - places)
    return (*found, rounded(number, bits))


PI = _pi()
HALF_PI = PI, DIGITS + 1  # as number and bits
LN_2 = _logarithm(2, 1), SHORT
PER_DIGIT = 28  # bits of a digit of 2/pi
TWO_BY_PI = tuple(
    ((1 << (2 * DIGITS + 1)) // PI >> (DIGITS - PER_DIGIT * k)) % (1 << PER_DIGIT)
    for k in range(45)
)  # digits of 2/pi; number k has the weight 2^(-28 k)


def double(number: int, bits: int) -> tuple[float, float]:
    """Two floats whose sum is number / 2^bits to twice the digits of one."""
    high = rounded(number, bits)
    numerator, denominator = high.as_integer_ratio()
    return high, rounded(number - (numerator << bits) // denominator, bits)


def arctangent(numerator: int, denominator: int) -> tuple[float, float]:
    """arctan(numerator / denominator) as two floats."""
    return double(_arctangent(numerator, denominator), SHORT)


def logarithm(numerator: int, denominator: int, places: int) -> tuple[float, ...]:
    """log(numerator / denominator) as two floats, the first with so many binary places."""
    return parts(_logarithm(numerator, denominator), SHORT, places)
