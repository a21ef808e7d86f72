"""Names of classes of tuples, by which Numba tells them apart and machine code is found."""

from __future__ import annotations

from typing import Any


def distinguish(*kinds: type) -> None:
    """Name classes of tuples by module and name; other classes stay as they are.

    Numba's dispatcher tells NamedTuples apart by the names of class and fields, so the ``Memory``
    of one law could pass for that of another; every call then takes the slow path, ten times as
    long. Numba's type of a class keeps the name that the class had when Numba first saw it, and
    machine code is found by that name. So a class is named before any kernel makes such a tuple;
    otherwise it depends on the order of compilation whether its code is found.
    """
    for kind in kinds:
        if issubclass(kind, tuple):
            kind.__name__ = f'{kind.__module__}.{kind.__qualname__}'


def classes_of(module: Any) -> list[type]:
    """Classes of tuples that a module defines."""
    kinds = [kind for kind in vars(module).values() if isinstance(kind, type)]
    return [k for k in kinds if issubclass(k, tuple) and k.__module__ == module.__name__]
