"""A pose held still, of any robot."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from parallel_robot_model.common.units import with_arrays
from parallel_robot_model.compiler import kernel
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.robots.contract import PoseMotion


class Parameters(NamedTuple):
    """The pose to hold; if there is none, that in which the robot is: see `configuration.py`."""

    pose: Annotated[
        tuple[float, ...],
        Field('', 'pose, in the units of the robot; []: the one in which the robot is'),
    ]


@kernel
def motion(parameters: Parameters, t: float) -> PoseMotion:
    """Pose with two derivatives, the same at every time `t` [s]."""
    pose: Any = parameters.pose
    return PoseMotion(pose, np.zeros(len(pose)), np.zeros(len(pose)))


prepare = with_arrays  # of which `motion` takes the lists


def span(parameters: Parameters) -> float:
    """Time after which nothing new happens [s]."""
    return 0.0
