"""SMC with S-SMC's proportional term: S-SMC without its coupling, the fair ablation."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from parallel_robot_control.contract import ControlOutput, Feedback, JointReference
from parallel_robot_control.laws import s_smc
from parallel_robot_model.compiler import kernel
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.robots.contract import Model

initial_memory = s_smc.initial_memory
_coupled = s_smc.update


class Gains(NamedTuple):
    """Gains of S-SMC in Table 2, lambda = 0."""

    z: Annotated[float, Field('1/s', 'slope of the sliding surface', 0.0)]
    K: Annotated[float, Field('N m s/rad', 'gain of the sliding variable', 0.0)]
    G: Annotated[float, Field('N m', 'bound of the lumped uncertainty', 0.0)]
    g: Annotated[float, Field('N m', 'margin above the bound', 0.0)]
    u: Annotated[float, Field('rad/s', 'thickness of the boundary layer', 1e-6)]


@kernel
def update(
    gains: Gains,
    model: Model,
    reference: JointReference,
    feedback: Feedback,
    memory: s_smc.Memory,
    dt: float,
) -> ControlOutput:
    """Compute the joint torque of one control cycle: S-SMC with lambda = 0.

    Source:
        Doan, Le, Vo (2019), eqs. (A5)-(A8).
    """
    uncoupled = s_smc.Gains(0.0, gains.z, gains.K, gains.G, gains.g, gains.u)
    return _coupled(uncoupled, model, reference, feedback, memory, dt)
