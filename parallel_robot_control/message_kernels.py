"""Joint vectors from the bytes of a message, compiled: a Layout as the kernels take it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numba import types
from numba.experimental import structref

from parallel_robot_model.common.units import NANOSECONDS, Array
from parallel_robot_model.compiler import inner, kernel
from parallel_robot_model.messages import cdr
from parallel_robot_model.messages.cdr import ENCAPSULATION, SPARE

NOT_UNDERSTOOD = -1  # stamp that marks a message of another layout, or with an invalid stamp


@structref.register
class WireType(types.StructRef):  # type: ignore[misc]
    """Numba's type of a Wire."""


class Wire(structref.StructRefProxy):  # type: ignore[misc]
    """Where the numbers of one kind of message lie. Made by :func:`wire_of`."""


FIELDS = ('template', 'constants', 'stamp', 'starts', 'order', 'body', 'words', 'numbers', 'row')
structref.define_boxing(WireType, Wire)
structref.define_constructor(Wire, WireType, FIELDS)


@kernel
def _wire(
    template: Any,
    constants: Any,
    stamp: int,
    starts: Any,
    order: Any,
    body: Any,
    words: Any,
    numbers: Any,
    row: Any,
) -> Any:
    return Wire(template, constants, stamp, starts, order, body, words, numbers, row)


def wire_of(layout: cdr.Layout, fields: Sequence[str], order: Sequence[int]) -> Any:
    """Make what the kernels need from a layout.

    Args:
        layout: Layout of the messages.
        fields: Its joint vectors, in the order in which they will be read.
        order: Index of each of the wanted joints in them.
    """
    offset = len(ENCAPSULATION)  # CDR aligns from there, so in the body every number is aligned
    known: Any = layout.dtype.fields
    starts = [(known[name][1] - offset) // 8 if name in known else -1 for name in fields]
    body = np.zeros(-(-len(layout.template) // 8) * 8 + 8, np.uint8)
    return _wire(
        layout.template.copy(),
        layout.constants.astype(np.int64),
        (known['sec'][1] - offset) // 4 if layout.stamped else -1,
        np.array(starts, np.int64),
        np.array(order, np.int64),
        body,
        body.view(np.int32),
        body.view(np.float64),
        np.zeros(len(order)),
    )


@inner
def lay_open(wire: Any, data: bytes) -> bool:
    """Open a message for :func:`joint_row`; False if it has another layout."""
    template = wire.template
    if not len(template) <= len(data) < len(template) + SPARE:
        return False
    for i in wire.constants:
        if data[i] != template[i]:
            return False
    body = wire.body
    for i in range(len(template) - len(ENCAPSULATION)):
        body[i] = data[i + len(ENCAPSULATION)]
    return True


@inner
def open_message(wire: Any, data: bytes) -> int:
    """Open a message with a stamp for :func:`joint_row`.

    Returns:
        Its stamp [ns]; NOT_UNDERSTOOD if it has another layout or its stamp is invalid.
    """
    if not lay_open(wire, data):
        return NOT_UNDERSTOOD
    sec: Any = np.int64(wire.words[wire.stamp])
    nanosec = np.int64(wire.words[wire.stamp + 1])  # negative: 2^31 or more
    if not 0 <= nanosec < NANOSECONDS:
        return NOT_UNDERSTOOD
    return sec * NANOSECONDS + nanosec


@inner
def joint_row(wire: Any, field: int, missing: float = 0.0) -> Array:
    """A joint vector of the message that was opened last, shape (n,), valid until the next one.

    Args:
        wire: See Wire.
        field: Which one, from 0.
        missing: What its numbers are where the layout does not have it.
    """
    order, start, row = wire.order, wire.starts[field], wire.row
    for i in range(len(order)):
        row[i] = wire.numbers[start + order[i]] if start >= 0 else missing
    return row
