"""Joints as a message tells them, of whatever publisher."""

from __future__ import annotations

import math
from typing import NamedTuple

from parallel_robot_model.messages.layouts import Reader

LONGEST = 1 << 16  # bytes of a message that is looked at


class JointAngle(NamedTuple):
    """Name, angle [rad] and rate [rad/s] of a joint; NaN for what is not told."""

    name: str
    angle: float
    rate: float


def read(data: bytes) -> tuple[JointAngle, ...]:
    """Joints of a serialised sensor_msgs/JointState, in its order; none if it is broken."""
    if len(data) > LONGEST:
        return ()
    try:
        message = Reader(data)
        message.header()
        names, angles, rates = message.texts(), message.numbers(), message.numbers()
    except ValueError:
        return ()
    told = [
        values.tolist() if len(values) == len(names) else [math.nan] * len(names)
        for values in (angles, rates)
    ]
    return tuple(map(JointAngle, names, *told))
