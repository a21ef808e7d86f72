"""SMC with S-SMC's proportional term: S-SMC without its coupling, the fair ablation."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from parallel_robot_control.law import Field, kernel
from parallel_robot_control.laws import s_smc

TITLE = 'SMC-K'

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
def update(gains, model, reference, feedback, memory, dt):
    """Compute the joint torque of one control cycle: S-SMC with lambda = 0.

    Source:
        Doan, Le, Vo (2019), eqs. (A5)-(A8).
    """
    uncoupled = s_smc.Gains(0.0, gains.z, gains.K, gains.G, gains.g, gains.u)
    return _coupled(uncoupled, model, reference, feedback, memory, dt)
