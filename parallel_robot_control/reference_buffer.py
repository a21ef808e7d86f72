"""References by stamp: stored while a state may need them, extrapolated to its stamp."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_control.contract import JointReference
from parallel_robot_control.messages import (
    NOT_UNDERSTOOD,
    joint_row,
    message_layout,
    parse_stamped,
)
from parallel_robot_model.common.units import NANOSECONDS, Array
from parallel_robot_model.compiler import (
    Boxed,
    entry_point,
    internal,
    kernel,
    read_row,
    vector,
    write_row,
)
from parallel_robot_model.messages import layouts

# A reference at a stamp between its samples: extrapolated with its own derivatives.


@internal
def extrapolated(reference: JointReference, time: float) -> JointReference:
    """The reference some time after its own [s], or before, with its acceleration held."""
    return JointReference(
        reference.position + time * (reference.velocity + 0.5 * time * reference.acceleration),
        reference.velocity + time * reference.acceleration,
        reference.acceleration,
    )


@internal
def reference_row(rows: Any, index: int, like: Array) -> JointReference:
    """A row of many references; `like` is any vector of shape (n,)."""
    return JointReference(
        read_row(rows.position, index, like),
        read_row(rows.velocity, index, like),
        read_row(rows.acceleration, index, like),
    )


@kernel
def extrapolate(age: int, reference: JointReference) -> JointReference:
    """A reference some time after its own stamp [ns], at constant acceleration."""
    return reference if age == 0 else extrapolated(reference, age / NANOSECONDS)


def extrapolate_rows(
    ages: NDArray[np.int64], position: Array, velocity: Array, acceleration: Array
) -> JointReference:
    """References some time after their own stamps, one per row.

    Args:
        ages: Times since their stamps [ns], shape (N,).
        position: Desired angles at their stamps [rad], shape (N, n).
        velocity: Their rates [rad/s], shape (N, n).
        acceleration: Their accelerations [rad/s^2], shape (N, n).
    """
    row = vector(np.zeros(position.shape[1]))
    rows = JointReference(*map(np.ascontiguousarray, (position, velocity, acceleration)))
    return _extrapolate_rows(ages, rows, row)


@kernel
def _extrapolate_rows(
    ages: NDArray[np.int64], rows: JointReference, template: Array
) -> JointReference:
    """See :func:`extrapolate_rows`; `template` is a vector of shape (n,)."""
    shape = rows.position.shape
    later = JointReference(np.empty(shape), np.empty(shape), np.empty(shape))
    for k in range(len(ages)):
        row = extrapolate(ages[k], reference_row(rows, k, template))
        write_row(later.position, k, row.position)
        write_row(later.velocity, k, row.velocity)
        write_row(later.acceleration, k, row.acceleration)
    return later


REFERENCE_FIELDS = ('position', 'velocity', 'acceleration')
SIZE = 10_000  # samples; when full, the oldest is dropped
FOUND, TOO_OLD, MISSING = 0, 1, 2
IN_ORDER, LATE, CONTRADICTS, BACK = range(4)  # order in which a reference comes
RESTART = NANOSECONDS // 2  # a jump of the stamps by more than this is a new run
FIRST, COUNT = 0, 1  # elements of the window


class Buffer(NamedTuple):
    """The arrays of a ReferenceBuffer, as the kernels take them, boxed."""

    stamps: NDArray[np.int64]
    rows: Array
    window: NDArray[np.int64]


class ReferenceBuffer:
    """References in the order of their stamps."""

    def __init__(self, joints: tuple[str, ...]) -> None:
        """Start empty, for the joints with these names."""
        self._stamps = np.zeros(SIZE, np.int64)
        self._rows = np.zeros((SIZE, 3, len(joints)))
        self._window = np.zeros(2, np.int64)
        # the Buffer for the kernels of this module
        self.compiled = Boxed(Buffer(self._stamps, self._rows, self._window))
        layout = layouts.joint_trajectory(joints)
        self._wire = message_layout(layout, REFERENCE_FIELDS, range(len(joints)))
        self._append = entry_point(append_message, self.compiled, self._wire, b'')

    def __len__(self) -> int:
        """Number of references."""
        return int(self._window[COUNT])

    @property
    def newest(self) -> int:
        """Stamp of the newest reference [ns]; the buffer must not be empty."""
        return int(self._stamps[self._at(len(self) - 1)])

    def read(self, data: bytes) -> bool:
        """Add the reference of a message in the layout of the suite, if it is the newest.

        Returns:
            Whether it was added.
        """
        return bool(self._append(self.compiled, self._wire, data))

    def add(self, stamp: int, reference: JointReference, lockstep: bool) -> int:
        """Add a reference that may not be the newest.

        In lockstep, an older one replaces those from its stamp on. Otherwise it does so only after
        a jump of the stamps: the others were wrong, or belonged to another run.

        Returns:
            IN_ORDER; BACK if others were replaced; LATE if it is discarded; CONTRADICTS if it is
            discarded and differs from the one with the same stamp.
        """
        order = IN_ORDER
        if len(self) and stamp <= self.newest:
            if not lockstep and self.newest - stamp < RESTART:
                existing = self.at(stamp)
                same = existing is None or all(map(np.array_equal, existing, reference))
                return LATE if same else CONTRADICTS
            self.drop_since(stamp)
            order = IN_ORDER if lockstep else BACK
        self.append(stamp, reference)
        return order

    def append(self, stamp: int, reference: JointReference) -> None:
        """Add one that is newer than all others."""
        if len(self) == SIZE:
            self._window[:] = self._at(1), SIZE - 1
        at = self._at(len(self))
        self._stamps[at], self._rows[at] = stamp, reference
        self._window[COUNT] += 1

    def at(self, stamp: int) -> JointReference | None:
        """The reference with exactly this stamp [ns]."""
        for k in reversed(range(len(self))):
            if self._stamps[self._at(k)] <= stamp:
                same = self._stamps[self._at(k)] == stamp
                return JointReference(*self._rows[self._at(k)]) if same else None
        return None

    def drop_since(self, stamp: int) -> None:
        """Drop the references from this stamp [ns] on."""
        while len(self) and self.newest >= stamp:
            self._window[COUNT] -= 1

    def _at(self, k: int) -> int:
        return int((self._window[FIRST] + k) % SIZE)


@kernel
def append_message(buffer: Any, wire: Any, data: bytes) -> bool:
    """Add the reference of a message of a known layout if it is finite and the newest."""
    stamp = parse_stamped(wire, data)
    if stamp == NOT_UNDERSTOOD:
        return False
    window, stamps, rows = buffer.window, buffer.stamps, buffer.rows
    count = window[COUNT]
    if count == SIZE or (count and stamp <= stamps[(window[FIRST] + count - 1) % SIZE]):
        return False
    at = (window[FIRST] + count) % SIZE
    for field in range(3):
        values = joint_row(wire, field)
        for i in range(len(values)):
            if not np.isfinite(values[i]):
                return False
            rows[at, field, i] = values[i]
    stamps[at] = stamp
    window[COUNT] += 1
    return True


@internal
def reference_at(
    buffer: Any, stamp: int, until: int, timeout: int, needs_newer: bool, row: Array
) -> tuple[int, int, JointReference]:
    """Newest reference not after `stamp`, extrapolated to it with its own derivatives.

    Older ones are dropped.

    Args:
        buffer: See ReferenceBuffer.compiled.
        stamp: Stamp of the state [ns].
        until: Stamp of the newest reference that counts [ns]; later ones are lost.
        timeout: Age above which it is not extrapolated but held at rest [ns].
        needs_newer: Whether the answer is MISSING until one with this stamp or a later one is here
            (lockstep), so that it does not depend on which message arrives first.
        row: Any vector of shape (n,).

    Returns:
        FOUND, TOO_OLD or MISSING; the stamp of the reference used [ns]; the reference.
    """
    window, stamps, rows = buffer.window, buffer.stamps, buffer.rows
    zero = np.zeros_like(row)
    nothing = JointReference(zero, zero, zero)
    first, count = window[FIRST], window[COUNT]
    if count == 0 or (needs_newer and stamps[(first + count - 1) % SIZE] < stamp):
        return MISSING, 0, nothing
    while count > 1 and stamps[(first + 1) % SIZE] <= min(stamp, until):
        first = (first + 1) % SIZE
        count -= 1
    window[FIRST], window[COUNT] = first, count
    used_stamp = stamps[first]
    if used_stamp > stamp:
        return MISSING, 0, nothing
    age = stamp - used_stamp
    newest = read_row(rows, first, vector((row, row, row)))
    if age > timeout:  # at rest where it was
        return TOO_OLD, used_stamp, JointReference(newest[0], zero, zero)
    return FOUND, used_stamp, extrapolate(age, JointReference(newest[0], newest[1], newest[2]))
