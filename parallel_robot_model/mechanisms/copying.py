"""Filling and copying arrays element by element: compiled slices take longer, and may allocate."""

from __future__ import annotations

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import inner


@inner
def copy(x: Array, out: Array) -> None:
    """Copy an array of one dimension."""
    for i in range(len(out)):
        out[i] = x[i]


@inner
def copy_matrix(x: Array, out: Array) -> None:
    """Copy the first rows and columns of an array of two dimensions."""
    for i in range(out.shape[0]):
        for k in range(out.shape[1]):
            out[i, k] = x[i, k]


@inner
def clear(out: Array) -> None:
    """Fill an array of one dimension with zeros."""
    for i in range(len(out)):
        out[i] = 0.0


@inner
def clear_matrix(out: Array) -> None:
    """Fill an array of two dimensions with zeros."""
    for i in range(out.shape[0]):
        for k in range(out.shape[1]):
            out[i, k] = 0.0
