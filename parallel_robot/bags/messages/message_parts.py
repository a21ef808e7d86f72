"""Some messages of a topic: as bytes, and decoded."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Messages(NamedTuple):
    """Some messages of one topic and one length, in the order of the file.

    Attributes:
        log_times: When they were recorded [ns], shape (N,).
        payloads: The bytes, shape (N, L).
    """

    log_times: np.ndarray
    payloads: np.ndarray


class Samples(NamedTuple):
    """Decoded messages of a topic.

    Attributes:
        joints: Names in the messages; empty where the type has none.
        log_times: When they were recorded [ns], shape (N,).
        stamps: Stamps of their headers [ns], shape (N,); zero where the type has none.
        numbers: Fields by name, each shape (N, n), in the order of the joints.
    """

    joints: tuple[str, ...]
    log_times: np.ndarray
    stamps: np.ndarray
    numbers: dict[str, np.ndarray]

    def rows(self, chosen: np.ndarray) -> Samples:
        """Some of them, by their numbers or by a mask."""
        numbers = {name: values[chosen] for name, values in self.numbers.items()}
        return Samples(self.joints, self.log_times[chosen], self.stamps[chosen], numbers)
