"""Reads stamped joint vectors from messages of any publisher, by joint name."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.messages import cdr
from parallel_robot_model.messages.layouts import OWN, joint_message
from parallel_robot_model.messages.topics import Topic

MAX_MESSAGE_BYTES = 1 << 16  # bytes of a message that is looked at; one of 100 joints has 10 000


class JointReader:
    """Reads one topic; learns the byte layout of its publisher from the first message.

    Messages that cannot be used are counted with the reason, never passed on: joints that are
    missing or named twice, fields shorter than the names, values that are not finite, an invalid
    stamp.

    Attributes:
        problem: Why the last message that could not be used was none.
        layout: Byte layout of the last message; None when it was not understood.
        order: Index of each joint in the message.
    """

    def __init__(
        self,
        topic: Topic,
        joints: tuple[str, ...],
        fields: Sequence[str],
        counts: Counter[str],
        optional: Mapping[str, float] | None = None,
    ) -> None:
        """Prepare to read a topic.

        Args:
            topic: Name and type.
            joints: Names of the joints, in the order in which they are read.
            fields: Names of the fields: position, velocity, acceleration.
            counts: Counts the messages that cannot be used, by reason.
            optional: Fields that a message may lack, and what they are where it does, or has no
                finite number.
        """
        self._topic = topic
        self._joints = joints
        self._fields = fields
        self._counts = counts
        self._optional = optional or {}
        self.problem = ''
        self.layout: cdr.Layout | None = None
        self.order = list(range(len(joints)))
        # Learn the layout that the suite publishes, and import all that reading needs.
        self.read(OWN[topic.type](joints).encode())

    def read(self, data: bytes) -> tuple[int, list[np.ndarray]] | None:
        """Read one message.

        Returns:
            Stamp [ns] and one array of shape (n,) for each field, the optional ones last; None
            for a message that cannot be used.
        """
        records = self.layout.decode(data) if self.layout else None
        if records is None:
            problem = self._learn(data)
            records = self.layout.decode(data) if self.layout and not problem else None
            if records is None:
                self._refuse(problem or 'not understood')
                return None
        vectors = [records[name][0][self.order] for name in self._fields]
        for name, vector in zip(self._fields, vectors, strict=True):
            if not np.isfinite(vector).all():
                self._refuse(f'{name} is not finite')
                return None
        if records['nanosec'][0] >= NANOSECONDS:
            self._refuse('the stamp has more than a second in ns')
            return None
        vectors += [self._read_optional(records, *each) for each in self._optional.items()]
        return int(cdr.stamps_of(records)[0]), vectors

    def _refuse(self, problem: str) -> None:
        self.problem = problem
        self._counts[f'{self._topic.name}: {problem}'] += 1

    def _read_optional(self, records: np.ndarray, name: str, unknown: float) -> np.ndarray:
        if name not in (records.dtype.names or ()):
            return np.full(len(self._joints), unknown)
        values = records[name][0][self.order]
        return np.where(np.isfinite(values), values, unknown)

    def _learn(self, data: bytes) -> str:
        """Set layout and order for messages like this one, or say why it cannot be used."""
        self.layout = None
        if len(data) > MAX_MESSAGE_BYTES:
            return f'longer than {MAX_MESSAGE_BYTES} bytes'
        try:
            names, fields, layout = joint_message(self._topic.type, data)
        except ValueError:
            return 'not a message of its type'
        for joint in self._joints:
            if names.count(joint) != 1:
                return f'{joint} is {"missing" if joint not in names else "named twice"}'
        for name in self._fields:
            if name not in fields:
                return f'{name} is missing or short'
        self.order = [names.index(joint) for joint in self._joints]
        self.layout = layout()
        return ''
