"""What a relay does to the messages of a topic: lose, delay, hold up, or falsify their stamps."""

from __future__ import annotations

import random
import struct
from typing import NamedTuple

from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.messages import topics
from parallel_robot_model.messages.cdr import ENCAPSULATION
from parallel_robot_model.messages.layouts import header_stamp

TOPICS = {
    'states': topics.JOINT_STATES,
    'commands': topics.COMMANDS,
    'references': topics.REFERENCE,
}


def relayed(key: str) -> str:
    """Name of a topic behind the relay."""
    return f'relayed/{TOPICS[key].name}'


class Effect(NamedTuple):
    """What happens to each message."""

    drop: float = 0.0  # share of the messages that are lost, 0 to 1
    delay: float = 0.0  # time by which each is delayed [s]
    burst: float = 0.0  # time for which nothing passes, before all of it passes at once [s]
    every: float = 0.5  # time from the start of one burst to that of the next [s]
    shift: float = 0.0  # time that is added to the stamp [s]


class Line:
    """Decides when each message of a topic passes; they never overtake one another."""

    def __init__(self, seed: int) -> None:
        """Let everything pass; `seed` is that of the losses."""
        self._random = random.Random(seed)
        self._effect = Effect()
        self._since = 0.0
        self._last = 0.0

    def change(self, effect: Effect, now: float) -> None:
        """Apply another effect from `now` [s] on."""
        self._effect, self._since = effect, now

    def due(self, now: float) -> float | None:
        """When a message that comes at `now` passes [s]; None when it is lost."""
        effect = self._effect
        if effect.drop and self._random.random() < effect.drop:
            return None
        due = now + effect.delay
        phase = (now - self._since) % effect.every
        if phase < effect.burst:
            due += effect.burst - phase
        self._last = max(self._last, due)
        return self._last

    def falsify(self, data: bytes) -> bytes:
        """The message with its stamp shifted."""
        stamp = header_stamp(data) if self._effect.shift else None
        if stamp is None:
            return data
        shifted = stamp + round(self._effect.shift * NANOSECONDS)
        message = bytearray(data)
        struct.pack_into('<iI', message, len(ENCAPSULATION), *divmod(shifted, NANOSECONDS))
        return bytes(message)
