"""Values made of numbers, vectors and None: how they lie in memory, as kernels have them there."""

from __future__ import annotations

from typing import Any

import numpy as np

from parallel_robot_model.compiler.vectors import Vector


def plain_type(value: Any) -> np.dtype[Any] | None:
    """How a value lies in memory; None if it is made of something else, too."""
    if isinstance(value, tuple):
        parts = [plain_type(part) for part in value]
        if any(part is None for part in parts):
            return None
        return np.dtype([(f'f{k}', part) for k, part in enumerate(parts)], align=True)
    if isinstance(value, Vector):
        return np.dtype((value.dtype, value.shape))
    if value is None:
        return np.dtype(np.intp)  # a pointer that nobody follows
    if isinstance(value, bool | int | float | complex | np.number | np.bool_):
        return np.asarray(value).dtype
    return None


def plain(value: Any) -> Any:
    """A value as it is written to memory."""
    if isinstance(value, tuple):
        return tuple(map(plain, value))
    return 0 if value is None else value


def read_plain(record: Any, like: Any) -> Any:
    """A value as it lies in memory, of the type of `like`."""
    if isinstance(like, tuple):
        parts = [read_plain(record[k], part) for k, part in enumerate(like)]
        return type(like)(*parts) if hasattr(like, '_fields') else tuple(parts)
    if isinstance(like, Vector):
        return np.array(record).view(Vector)
    return None if like is None else record.item()
