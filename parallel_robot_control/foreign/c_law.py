"""A law as a C function of a shared library, see docs/c_law.md."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from ctypes import POINTER, byref, c_double, c_int32
from pathlib import Path
from typing import Any

from parallel_robot_control.foreign import process
from parallel_robot_model.common.errors import InputError

VERSION = 1  # of the header
HEADER = 'parallel_robot_law.h'
UPDATE, VERSIONED = 'law_update', 'law_version'
JOINTS, PERIOD = 'law_joints', 'law_period'  # optional

_ROW = POINTER(c_double)


def get_include() -> str:
    """The folder of the header of laws in C, for ``-I`` of a compiler.

    >>> import parallel_robot as pr
    >>> pr.get_include().rpartition('/')[2]
    'foreign'
    """
    return str(Path(__file__).parent)


class _Input(ctypes.Structure):
    """As law_input of the header."""

    _fields_ = (
        ('joints', c_int32),
        ('begins', c_int32),
        ('dt', c_double),
        ('position', _ROW),
        ('velocity', _ROW),
        ('reference_position', _ROW),
        ('reference_velocity', _ROW),
        ('reference_acceleration', _ROW),
        ('excess', _ROW),
        ('disturbance', _ROW),
        ('gravity', _ROW),
        ('M', _ROW),
        ('Q', _ROW),
    )


class _Output(ctypes.Structure):
    """As law_output of the header."""

    _fields_ = (('torque', _ROW), ('sliding_variable', _ROW), ('coupled_error', _ROW))


class CLaw:
    """A library that is loaded.

    Attributes:
        period: The only period that it can have [s]; 0 if it says none.
        multiples: Whether multiples of it will do, too.
        aged: Whether it takes the age of the state.
    """

    multiples = aged = False
    kinds = ()

    def __init__(self, file: str, joints: int, question: Any, answer: Any) -> None:
        """Load it.

        Args:
            file: The library.
            joints: Number of the joints, n.
            question: What is asked, see :mod:`parallel_robot_control.foreign.process`.
            answer: What it answers.

        Raises:
            InputError: it is none, or not for so many joints.
        """
        try:
            library = ctypes.CDLL(file)
        except OSError as error:
            raise InputError(f'{file} cannot be loaded: {error}') from None
        version = _number(library, VERSIONED, c_int32)
        if version is None or not hasattr(library, UPDATE):
            lacks = VERSIONED if version is None else UPDATE
            raise InputError(f'{file} has no {lacks}: a law includes {HEADER} and has {UPDATE}')
        if version != VERSION:
            raise InputError(f'{file} is made with version {version} of {HEADER}, not {VERSION}')
        own = _number(library, JOINTS, c_int32)
        if own is not None and own != joints:
            raise InputError(f'{file} is for {own} joints, not {joints}')
        self.period = float(_number(library, PERIOD, c_double) or 0.0)
        if not (0.0 <= self.period < math.inf):
            raise InputError(f'{file}: {PERIOD} must be a time, not {self.period:g}')
        self._update = getattr(library, UPDATE)
        self._update.argtypes, self._update.restype = [POINTER(_Input), POINTER(_Output)], c_int32
        places = [k * joints for k in range(process.ROWS)]
        places += [(process.ROWS + k * joints) * joints for k in range(2)]
        self._input = _Input(joints, 0, 0.0, *(_row(question, place) for place in places))
        self._output = _Output(*(_row(answer, k * joints) for k in range(process.FAULT)))

    def update(self, begins: bool, dt: float, _: float, __: Sequence[float]) -> float:
        """See :class:`parallel_robot_control.foreign.process.Loaded`."""
        self._input.begins, self._input.dt = begins, dt
        return float(self._update(byref(self._input), byref(self._output)))


def load(task: Any, question: Any, answer: Any) -> CLaw:
    """Load the library of a task."""
    return CLaw(task['file'], task['joints'], question, answer)


def _row(floats: Any, place: int) -> Any:
    """Pointer to one of some floats."""
    return ctypes.cast(byref(floats, ctypes.sizeof(c_double) * place), _ROW)


def _number(library: Any, name: str, kind: Any) -> Any:
    """A number of a library; None if it has none."""
    try:
        return kind.in_dll(library, name).value
    except ValueError:
        return None
