"""Diagnostics of a node: its message, its rate and its share of a processor."""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

# Keys that other programs read; all others are for people.
STATE_INDEX = 'state index'  # of the plant's last published state; absent while it is held
OUTSIDE = 'outside the workspace'  # whether the plant's robot was driven out: True or False


def diagnostics_message(
    node: Node, values: Mapping[str, Any], warnings: Collection[str], alarm: str
) -> DiagnosticArray:
    """The diagnostics of a node as a message.

    Args:
        node: The node.
        values: Key to value.
        warnings: Those of the keys that tell of something unusual.
        alarm: What is wrong; empty for nothing.
    """
    level = DiagnosticStatus.WARN if warnings else DiagnosticStatus.OK
    status = DiagnosticStatus(
        level=DiagnosticStatus.ERROR if alarm else level,
        name=f'{node.get_name()}: loop',
        message=alarm or ', '.join(warnings) or 'ok',
        hardware_id=node.get_fully_qualified_name(),
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )
    message = DiagnosticArray(status=[status])
    message.header.stamp = node.get_clock().now().to_msg()
    return message


class Usage:
    """Measures the rate of a node and what it uses of its processor, from call to call."""

    def __init__(self) -> None:
        """Begin to measure."""
        self._time = time.monotonic()  # s
        self._busy = time.process_time()  # s
        self._samples = 0

    def measure(self, samples: int | None) -> dict[str, str]:
        """Entries of the diagnostics since the last call.

        Args:
            samples: How many the node has handled since its start; None if it has no rhythm.
        """
        now, busy = time.monotonic(), time.process_time()
        seconds, used = now - self._time, busy - self._busy
        handled = (samples or 0) - self._samples
        self._time, self._busy, self._samples = now, busy, samples or 0
        rate = {} if samples is None else {'rate [Hz]': f'{handled / seconds:.1f}'}
        return rate | {'processor [%]': f'{100.0 * used / seconds:.1f}'}
