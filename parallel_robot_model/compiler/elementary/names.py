"""What kernels run where they call a function of ``math`` or ``numpy``, or raise to a power.

Numba would call those of the C library, or let LLVM compute those of constants by them. Only
kernels are concerned, and only floats of 64 bits and whole numbers.
"""

from __future__ import annotations

import math
import operator
from typing import Any

import numpy as np
from numba import types

from parallel_robot_model.compiler.elementary.angles import acos, asin, atan, atan2, cos, sin, tan
from parallel_robot_model.compiler.elementary.powers import exp, log, power, tanh
from parallel_robot_model.compiler.kernels import PYTHON, kernel
from parallel_robot_model.compiler.numba_parts import loops_of, lower_builtin
from parallel_robot_model.compiler.vectors import INTERPRETED, Vector

OF_ONE: dict[Any, tuple[Any, ...]] = {
    sin: (math.sin, np.sin), cos: (math.cos, np.cos), tan: (math.tan, np.tan),
    asin: (math.asin, np.arcsin), acos: (math.acos, np.arccos), atan: (math.atan, np.arctan),
    exp: (math.exp, np.exp), log: (math.log, np.log),
    tanh: (math.tanh, np.tanh),
}  # fmt: skip
OF_TWO: dict[Any, tuple[Any, ...]] = {
    atan2: (math.atan2, np.arctan2),
    power: (math.pow, np.power, operator.pow, operator.ipow, pow),
}
WHOLE = (types.int64, types.uint64)


def _register(function: Any, name: Any, count: int) -> None:
    def lower(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        floats = [
            context.cast(builder, value, kind, types.float64)
            for value, kind in zip(values, signature.args, strict=True)
        ]
        kind = types.Dispatcher(function)
        of = kind.get_call_type(context.typing_context, (types.float64,) * count, {})
        call = context.get_function(kind, of)
        result = call(builder, floats)
        context.add_linking_libs(getattr(call, 'libs', ()))
        return result

    if isinstance(name, np.ufunc):
        loops_of(name)['d' * count + '->d'] = lower
        return
    lower_builtin(name, *(types.float64,) * count)(lower)
    if count == 1:
        for kind in WHOLE:
            lower_builtin(name, kind)(lower)


def _of_elements(function: Any) -> Any:
    """A function of numbers as one of vectors, too, for Python."""
    of_each = np.vectorize(lambda *values: function(*map(float, values)), otypes=[np.float64])

    def called(*values: Any) -> Any:
        found = of_each(*values)
        return found.view(Vector) if found.ndim else np.float64(found)

    return called


if INTERPRETED:
    for _function, _names in (*OF_ONE.items(), *OF_TWO.items()):
        for _name in _names:
            PYTHON[_name] = _of_elements(_function) if isinstance(_name, np.ufunc) else _function
else:
    for _function, _names in (*OF_ONE.items(), *OF_TWO.items()):
        for _name in _names:
            _register(_function, _name, 2 if _function in OF_TWO else 1)


# Elementary functions for Python: of a number, or of an array element by element.


@kernel
def sine(x: Any) -> Any:
    """Sine of angles [rad]; as all here, the same bits on every processor."""
    return np.sin(x)


@kernel
def cosine(x: Any) -> Any:
    """Cosine of angles [rad]."""
    return np.cos(x)


@kernel
def arctangent(y: Any, x: Any) -> Any:
    """Angles of the directions (x, y) [rad]."""
    return np.arctan2(y, x)
