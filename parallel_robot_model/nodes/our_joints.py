"""Whose joints a message is of: topics such as ``joint_states`` are shared by several robots."""

from __future__ import annotations

from parallel_robot_model.messages.layouts import joint_message
from parallel_robot_model.messages.topics import Topic
from parallel_robot_model.nodes.joint_reader import MAX_MESSAGE_BYTES

STAMPED = 12  # bytes of a message up to the end of its stamp
LOOKED_AT = 96  # bytes after it, by which a message is known again


class OurJoints:
    """Tells messages of our robot from those of others, as of a gripper on the same topic."""

    def __init__(self, topic: Topic, joints: tuple[str, ...]) -> None:
        """Prepare for the first message.

        Args:
            topic: Name and type of the topic.
            joints: Names of our joints.
        """
        self._type, self._joints = topic.type, set(joints)
        self._known = b'', 0  # begin and length of the last message that was ours

    def others(self, data: bytes) -> bool:
        """Whether a message names joints, and none of ours."""
        seen = data[STAMPED : STAMPED + LOOKED_AT], len(data)
        if seen == self._known:
            return False
        if len(data) > MAX_MESSAGE_BYTES:
            return False
        try:
            names, _, _ = joint_message(self._type, data)
        except ValueError:  # who reads it says what is wrong
            return False
        if names and not self._joints & set(names):
            return True
        self._known = seen
        return False
