"""Kernels called with arrays: the tests compute with arrays, kernels take vectors."""

import functools
from collections import namedtuple
from typing import Any

from parallel_robot_model.compiler import Boxed, as_vectors
from parallel_robot_model.robots.joint_load import JointLoad
from parallel_robot_model.robots.registry import KERNELS


def on_vectors(kernel: Any) -> Any:
    """The kernel as a function of arrays, which it gets as vectors."""

    def called(*arguments: Any) -> Any:
        return kernel(*as_vectors(arguments))

    return called


@functools.lru_cache(maxsize=64)
def boxed(robot: Any, parameters: Any) -> Boxed:
    """What the kernels of a robot module take of its parameters, as from the suite."""
    constants = getattr(robot, 'constants', lambda parameters: parameters)
    return Boxed(constants(parameters))


def setup_of(**parts: Any) -> Boxed:
    """What a kernel reads of a ControlSetup: some of its parts."""
    return Boxed(_named(*parts)(**parts))


@functools.cache
def _named(*names: str) -> Any:
    return namedtuple('_'.join(names), names)


class OnVectors:
    """A robot module whose kernels take its parameters, instead of its constants, and arrays.

    They get them as from the suite, so that they are not compiled for the tests alone.
    """

    def __init__(self, robot: Any) -> None:
        self._robot = robot

    def __getattr__(self, name: str) -> Any:
        attribute = getattr(self._robot, name)
        if name not in KERNELS:
            return attribute

        def called(parameters: Any, *arguments: Any) -> Any:
            given = [Boxed(x) if isinstance(x, JointLoad) else x for x in as_vectors(arguments)]
            return attribute(boxed(self._robot, parameters), *given)

        return called
