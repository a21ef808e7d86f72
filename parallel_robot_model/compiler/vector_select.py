"""Decisions without branches, in kernels: both results are computed, and one is taken."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types
from numba.extending import overload, type_callable

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler.kernels import inner, kernel
from parallel_robot_model.compiler.numba_parts import impl_ret_new_ref, lower_builtin
from parallel_robot_model.compiler.vectors import VectorType, aligned, pack, tuple_like


def select(condition: Any, a: Any, b: Any) -> Any:
    """`a` where a condition holds, else `b`: numbers, vectors and tuples of them."""
    if isinstance(a, tuple):
        parts = [select(condition, *pair) for pair in zip(a, b, strict=True)]
        return type(a)(*parts) if hasattr(a, '_fields') else tuple(parts)
    if isinstance(condition, np.ndarray):
        chosen = np.where(*aligned((condition, a, b)))
        return chosen.view(type(condition))
    return a if condition else b


@type_callable(select)
def _type_of_select(context: Any) -> Any:
    return lambda condition, a, b: _selected(condition, a, b)


def _selected(condition: Any, a: Any, b: Any) -> Any:
    """Type of a selection; None if there is none."""
    if not isinstance(condition, (types.Boolean, VectorType)):
        return None
    if isinstance(a, types.BaseTuple) and isinstance(b, types.BaseTuple):
        if len(a) != len(b):
            return None
        kinds = [_selected(condition, *pair) for pair in zip(a.types, b.types, strict=True)]
        return None if None in kinds else tuple_like(a, kinds)
    if isinstance(a, VectorType) and a == b and a.count == 0:
        return a  # the memory of a law that has none
    vectors = [kind for kind in (condition, a, b) if isinstance(kind, VectorType)]
    if vectors:
        if len({kind.count for kind in vectors}) > 1:
            return None
        inner = _selected(*(_element(kind) for kind in (condition, a, b)))
        return None if inner is None else VectorType(vectors[0].count, inner)
    if isinstance(a, types.Number) and isinstance(b, types.Number):
        if isinstance(a, types.Integer) and isinstance(b, types.Integer):
            return types.int64
        return types.float64
    a, b = types.unliteral(a), types.unliteral(b)
    return a if a == b else None


def _element(kind: Any) -> Any:
    return kind.element if isinstance(kind, VectorType) else kind


@lower_builtin(select, types.Any, types.Any, types.Any)
def _select(context: Any, builder: Any, signature: Any, values: Any) -> Any:
    result = _choose(context, builder, signature.args, values, signature.return_type)
    return impl_ret_new_ref(context, builder, signature.return_type, result)


def _choose(context: Any, builder: Any, kinds: Any, values: Any, to: Any) -> Any:
    (condition, a, b), (c, x, y) = kinds, values
    if isinstance(to, types.BaseTuple):
        parts = [
            _choose(
                context,
                builder,
                (condition, a.types[i], b.types[i]),
                (c, builder.extract_value(x, i), builder.extract_value(y, i)),
                to.types[i],
            )
            for i in range(len(to))
        ]
        return context.make_tuple(builder, to, parts)
    if isinstance(to, VectorType):
        parts = []
        for i in range(to.count):
            each = [
                builder.extract_value(value, i) if isinstance(kind, VectorType) else value
                for kind, value in zip(kinds, values, strict=True)
            ]
            parts.append(_choose(context, builder, tuple(map(_element, kinds)), each, to.element))
        return pack(context, builder, to, parts)
    x, y = context.cast(builder, x, a, to), context.cast(builder, y, b, to)
    result = builder.select(c, x, y)
    context.nrt.incref(builder, to, result)
    return result


@overload(select, strict=False)
def _select_of_arrays(condition: Any, a: Any, b: Any) -> Any:
    if isinstance(condition, types.Array):
        return lambda condition, a, b: np.where(condition, a, b)
    return None


def every(condition: Any) -> Any:
    """Whether a condition holds for all elements of a vector."""
    return np.all(condition)


def some(condition: Any) -> Any:
    """Whether a condition holds for an element of a vector."""
    return np.any(condition)


def _reduces(function: Any, instruction: str) -> None:
    @type_callable(function)
    def _type(context: Any) -> Any:
        return lambda x: x.element if isinstance(x, VectorType) else None

    @lower_builtin(function, VectorType)
    def _lower(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        result = builder.extract_value(values[0], 0)
        for i in range(1, signature.args[0].count):
            result = getattr(builder, instruction)(result, builder.extract_value(values[0], i))
        return result


@overload(every, strict=False)
def _every_of_array(condition: Any) -> Any:
    return (lambda condition: np.all(condition)) if isinstance(condition, types.Array) else None


@overload(some, strict=False)
def _some_of_array(condition: Any) -> Any:
    return (lambda condition: np.any(condition)) if isinstance(condition, types.Array) else None


_reduces(every, 'and_')
_reduces(some, 'or_')


@kernel
def clip(x: Any, low: Any, high: Any) -> Any:
    """`x` within its limits, element by element; NaN stays NaN."""
    return select(x > high, high, select(x < low, low, x))


@kernel
def largest(x: Any) -> Any:
    """Largest magnitude of the elements of a vector or an array of one dimension."""
    largest = abs(x[0])
    for i in range(1, len(x)):
        largest = max(largest, abs(x[i]))
    return largest


@inner
def is_finite(x: Array) -> bool:
    """Whether all elements of a vector are finite."""
    return every(x - x == 0.0)
