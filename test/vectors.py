"""Kernels called with arrays: the tests compute with arrays, kernels take vectors."""

from typing import Any

from parallel_robot_model.compiler import as_vectors
from parallel_robot_model.robots.registry import KERNELS


def on_vectors(kernel: Any) -> Any:
    """The kernel as a function of arrays, which it gets as vectors."""

    def called(*arguments: Any) -> Any:
        return kernel(*as_vectors(arguments))

    return called


class OnVectors:
    """A robot module whose kernels take its parameters, instead of its constants, and arrays."""

    def __init__(self, robot: Any) -> None:
        self._robot = robot

    def __getattr__(self, name: str) -> Any:
        attribute = getattr(self._robot, name)
        if name not in KERNELS:
            return attribute
        constants = getattr(self._robot, 'constants', lambda parameters: parameters)

        def called(parameters: Any, *arguments: Any) -> Any:
            return attribute(constants(parameters), *as_vectors(arguments))

        return called
