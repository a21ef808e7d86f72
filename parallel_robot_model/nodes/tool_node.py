"""The node of a command-line tool, which is in the ROS domain only for a while."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from parallel_robot_model.nodes import middleware


@contextmanager
def tool_node(name: str, transport: str = 'default', **options: Any) -> Iterator[Node]:
    """Start rclpy and make a node; both end with the context. Signals remain the tool's own.

    Args:
        name: Name of the node.
        transport: The parameter ``middleware``: ``'udp'`` or ``'default'``.
        options: Of :func:`rclpy.create_node`.

    Yields:
        The node.
    """
    with ExitStack() as stack:
        stack.callback(rclpy.try_shutdown)
        with middleware.explained(), middleware.transport(transport):
            rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
            node = rclpy.create_node(name, **options)
        stack.callback(node.destroy_node)
        yield node
