"""What goes into a controller and comes out of it."""

from __future__ import annotations

from typing import NamedTuple

from parallel_robot_control.configuration import ControlConfiguration
from parallel_robot_control.law_core import LawCore
from parallel_robot_control.messages import Status, Telemetry
from parallel_robot_control.prepared_laws.prepared_law import PreparedLaw
from parallel_robot_model.common.units import Array

STATE_FIELDS = ('position', 'velocity', 'effort')


class JointSample(NamedTuple):
    """Measured joints at one time: [rad], [rad/s], [N m], each shape (n,)."""

    position: Array
    velocity: Array
    effort: Array


class Answer(NamedTuple):
    """Answer to one state: the torque [N m], shape (n,), and its telemetry."""

    torque: Array
    telemetry: Telemetry
    status: Status


class Change(NamedTuple):
    """An accepted change of law or gains: the new configuration and the compiled law."""

    configuration: ControlConfiguration
    core: LawCore

    @property
    def law(self) -> PreparedLaw:
        """The law."""
        return self.core.law
