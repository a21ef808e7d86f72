"""What a bag certifies of each topic: how many messages were written, and how many were lost."""

from __future__ import annotations

from typing import NamedTuple

from parallel_robot_model.configuration import plain_data


class Certificate(NamedTuple):
    """Messages of one topic.

    Attributes:
        written: How many are in the bag.
        lost: How many are known to be missing; None when that is not known.
    """

    written: int
    lost: int | None

    def __str__(self) -> str:
        """For people."""
        return f'written {self.written}, lost {"unknown" if self.lost is None else self.lost}'

    def dump(self) -> str:
        """As a bag holds it: JSON."""
        return plain_data.dump(self._asdict())


def lost(text: str) -> int:
    """Number of lost messages from the text in a bag; 0 when it does not say."""
    number = plain_data.mapping(text).get('lost')
    return number if type(number) is int and number > 0 else 0
