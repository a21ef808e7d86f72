"""The 64 bits of a float as a whole number, and sums and products without an error."""

from __future__ import annotations

import struct
from typing import Any

from llvmlite import ir
from numba import types

from parallel_robot_model.compiler.kernels import merged
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


@merged
def power_of_two(exponent: int) -> float:
    """2^exponent, for -1022 <= exponent <= 1023."""
    return float_of((exponent + BIAS) << FRACTION)


@merged
def exact_sum(a: float, b: float) -> tuple[float, float]:
    """a + b, and what rounding took from it.

    Source:
        Knuth (1969), The art of computer programming, volume 2, section 4.2.2.
    """
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


@merged
def halves(a: float) -> tuple[float, float]:
    """Two floats of 26 digits each whose sum is `a`, |a| < 2^996.

    Source:
        Veltkamp; Dekker (1971), A floating-point technique for extending the available precision.
    """
    large = a * _HALF
    high = large - (large - a)
    return high, a - high


@merged
def exact_product(a: float, b: float) -> tuple[float, float]:
    """a b, and what rounding took from it, by Dekker (1971)."""
    product = a * b
    a1, a2 = halves(a)
    b1, b2 = halves(b)
    return product, ((a1 * b1 - product) + a1 * b2 + a2 * b1) + a2 * b2


@merged
def quotient(over: float, rest: float, below: float, more: float) -> tuple[float, float]:
    """(over + rest) / (below + more) as a sum; the second floats are small."""
    value = over / below
    product, error = exact_product(value, below)
    return value, (((over - product) - error) + (rest - value * more)) / below
