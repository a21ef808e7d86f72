"""Statuses of the controller in a bag: law, fault and limits that acted, as stable codes."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from parallel_robot.bags.limits import MESSAGE, STATUSES, is_name
from parallel_robot.bags.messages.message_types import deserialize
from parallel_robot.bags.reading.bag_reader import Messages
from parallel_robot_control import messages
from parallel_robot_control.safety import limiting
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.messages.topics import STATUS, Topic

LIMIT_TEXT = {limiting.ACTED_CODE[bit]: text for bit, text in limiting.ACTED_TEXT.items()}


class ControllerStatus(NamedTuple):
    """A status of the controller.

    Attributes:
        stamp: When it began [ns].
        law: Active law.
        fault: Code of the fault, NO_FAULT without one.
        fault_text: The fault for people.
        limits: Codes of the limits that acted, until none had done so for a while.
        pose: The pose that the controller was told; empty when it was not.
    """

    stamp: int
    law: str
    fault: str
    fault_text: str
    limits: tuple[str, ...]
    pose: tuple[float, ...] = ()


def decoder(bag: Path) -> Callable[[Topic, Messages], list[tuple[int, ControllerStatus]]]:
    """Function that decodes statuses, each with its log time; leaves out what is not understood.

    It raises BagError when a bag has too many of them.

    Args:
        bag: The bag, for error messages.
    """
    left = STATUSES

    def decode(topic: Topic, found: Messages) -> list[tuple[int, ControllerStatus]]:
        nonlocal left
        left -= len(found.payloads)
        if left < 0:
            raise BagError(f'{bag} has more than {STATUSES} messages on {topic.name}')
        payloads = (row.tobytes() for row in found.payloads[:, : MESSAGE + 1])
        pairs = zip(found.log_times.tolist(), map(decoded, payloads), strict=True)
        return [(log_time, status) for log_time, status in pairs if status is not None]

    return decode


def decoded(message: bytes) -> ControllerStatus | None:
    """A message on ``controller/status``; None when it is broken or not the suite's."""
    try:
        array: Any = deserialize(message, STATUS.type)
        values = {item.key: item.value for item in array.status[0].values}
        law, text = values[messages.LAW], values[messages.FAULT]
        fault, codes = values[messages.FAULT_CODE], values[messages.LIMIT_CODES].split(',')
        pose = _numbers(values.get(messages.POSE, ''))
        stamp = array.header.stamp.sec * NANOSECONDS + array.header.stamp.nanosec
    except Exception:  # broken, or a topic of that name that is not the suite's
        return None
    names = (law, fault, *codes)
    if not (text.isprintable() and all(map(is_name, names))):
        return None
    return ControllerStatus(stamp, law, fault, text, tuple(filter(None, codes)), pose)


def _numbers(text: str) -> tuple[float, ...]:
    """Finite numbers with commas between them; none where there are others."""
    try:
        found = tuple(map(float, text.split(',')))
    except ValueError:
        return ()
    return found if all(map(math.isfinite, found)) else ()
