"""Messages of machines with the other order of bytes."""

from __future__ import annotations

import numpy as np

from parallel_robot.bags.messages.message_parts import Messages
from parallel_robot.bags.messages.message_types import reserialize
from parallel_robot_model.messages.topics import Topic

BIG_ENDIAN = b'\x00\x00'  # first bytes of CDR
HEAD = 4  # bytes of the encapsulation


def little_endian(topic: Topic, messages: Messages) -> Messages:
    """Messages with those in big-endian CDR as little-endian CDR; broken ones as they are."""
    if messages.payloads.shape[1] <= HEAD:
        return messages
    big = ~messages.payloads[:, : len(BIG_ENDIAN)].any(axis=1)
    if not big.any():
        return messages
    payloads = messages.payloads.copy()
    for row in (payloads[k] for k in np.flatnonzero(big)):
        try:
            found = reserialize(row.tobytes(), topic.type)
        except Exception:  # in broken bytes, anything can go wrong
            continue
        if len(found) <= len(row):
            row[:] = 0
            row[: len(found)] = np.frombuffer(found, np.uint8)
    return Messages(messages.log_times, payloads)
