"""Values of several runs as lanes, for kernels that advance all of them at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from parallel_robot_base.errors import InputError
from parallel_robot_compiler.boxed import Boxed
from parallel_robot_compiler.vector_types import Lanes, LaneVector, Vector


def side_by_side(values: Sequence[Any], integers: bool = False) -> Any:
    """One value of lanes from the values of the runs.

    Numbers become Lanes, vectors LaneVectors, tuples tuples of these.

    Args:
        values: One of each run: numbers, vectors, texts, and tuples of them.
        integers: Whether integers and booleans may differ, too: those of a state, not those of a
            configuration, by which kernels branch.

    Raises:
        InputError: texts or integers differ, or one run has more values than another.
    """
    first = values[0]
    if isinstance(first, Boxed):
        return Boxed(side_by_side([value.value for value in values], integers))
    if isinstance(first, tuple):
        if len({len(value) for value in values}) > 1:
            raise InputError('runs side by side must have as many values as each other')
        parts = [side_by_side(part, integers) for part in zip(*values, strict=True)]
        return type(first)(*parts) if hasattr(first, '_fields') else tuple(parts)
    if isinstance(first, Vector):
        stacked = np.stack([np.asarray(value) for value in values], axis=-1)
        return np.ascontiguousarray(stacked).view(LaneVector) if first.size else first
    if isinstance(first, (float, np.floating)):
        return np.array(values, np.float64).view(Lanes)
    if integers and isinstance(first, (bool, int, np.integer, np.bool_)):
        kind = np.bool_ if isinstance(first, (bool, np.bool_)) else np.int64
        return np.array(values, kind).view(Lanes)
    if any(value != first for value in values):
        raise InputError(f'runs side by side must agree in {first!r}')
    return first


def lane_of(value: Any, lane: int) -> Any:
    """One run of what a kernel returned for lanes: arrays whose last axis they are."""
    if isinstance(value, tuple):
        parts = [lane_of(part, lane) for part in value]
        return type(value)(*parts) if hasattr(value, '_fields') else tuple(parts)
    if isinstance(value, LaneVector):
        return np.ascontiguousarray(value[..., lane]).view(Vector)
    if isinstance(value, Lanes):
        return value[lane].item()
    return value
