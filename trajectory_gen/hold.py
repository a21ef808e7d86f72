"""A pose held still."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot_base.fields import Field
from parallel_robot_base.kernel import kernel
from trajectory_gen.motion import PoseMotion


class Parameters(NamedTuple):
    """The pose to hold."""

    pose: Annotated[tuple[float, float, float], Field('m, m, rad', 'x, y, phi')]


@kernel
def motion(parameters: Parameters, t: float) -> PoseMotion:
    """Pose with two derivatives, the same at every time `t` [s]."""
    pose = np.array([parameters.pose[0], parameters.pose[1], parameters.pose[2]])
    return PoseMotion(pose, np.zeros(3), np.zeros(3))


def span(parameters: Parameters) -> float:
    """Time after which nothing new happens [s]."""
    return 0.0
