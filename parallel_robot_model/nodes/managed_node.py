"""The life cycle of a node that the tools of ROS configure, activate and deactivate."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy._rclpy_pybind11 import RCLError
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node

from parallel_robot_model.common.errors import first_line


class Lifecycle(LifecycleNodeMixin):  # type: ignore[misc]
    """Offers the services of a managed node in the name of another node.

    Attributes:
        active: Whether the node is active.
    """

    def __init__(
        self,
        node: Node,
        activate: Callable[[], str],
        deactivate: Callable[[], None],
        shut_down: Callable[[], None],
    ) -> None:
        """Begin unconfigured.

        Args:
            node: The node that is managed.
            activate: Called to make it active; says why that is refused, or nothing.
            deactivate: Called to make it inactive.
            shut_down: Called to end it, when it is inactive.
        """
        # What rclpy's mixin takes from the node that it is mixed with.
        self.handle, self._services = node.handle, node._services
        self.default_callback_group = node.default_callback_group
        self._node, self._activate, self._deactivate = node, activate, deactivate
        self._shut_down = shut_down
        self.active = False
        super().__init__()
        self._change = self._service_change_state.callback
        self._service_change_state.callback = self._on_change

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let the node act, if it can."""
        try:
            reason = self._activate()
        except Exception as error:  # rclpy would hide it
            reason = first_line(error)
        if reason:
            self._node.get_logger().warning(f'not activated: {reason}')
            return TransitionCallbackReturn.FAILURE
        self.active = True
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let the node act no more."""
        self.active = False
        self._deactivate()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the node."""
        if self.active:
            self.on_deactivate(state)
        self._shut_down()
        return TransitionCallbackReturn.SUCCESS

    def _on_change(self, request: Any, response: Any) -> Any:
        """Refuse a transition that the state does not have; rclpy would end the node."""
        try:
            return self._change(request, response)
        except RCLError as error:
            self._node.get_logger().warning(first_line(error))
            response.success = False
            return response
