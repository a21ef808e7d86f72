"""Full-Order Terminal Sliding Mode Control (FOTSMC): S-FOTSMC without its coupling."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from parallel_robot_control.law import Field, kernel
from parallel_robot_control.laws import s_fotsmc

TITLE = 'FOTSMC'

initial_memory = s_fotsmc.initial_memory
validate_gains = s_fotsmc.validate_gains
_coupled = s_fotsmc.update


class Gains(NamedTuple):
    """Gains of S-FOTSMC in Table 2, lambda = 0."""

    G: Annotated[float, Field('rad/s^3', 'bound of the rate of the lumped uncertainty', 0.0)]
    g: Annotated[float, Field('rad/s^3', 'margin above the bound', 0.0)]
    Gamma1: Annotated[float, Field('rad^(1-gamma1)/s^2', 'weight of the error', 0.0)]
    Gamma2: Annotated[float, Field('(rad/s)^(1-gamma2)/s', 'weight of its rate', 0.0)]
    gamma1: Annotated[float, Field('', 'exponent of the error', 0.0, 1.0)]
    gamma2: Annotated[float, Field('', 'exponent of its rate', 0.0, 1.0)]


@kernel
def update(gains, model, reference, feedback, memory, dt):
    """Compute the joint torque of one control cycle: S-FOTSMC with lambda = 0.

    Source:
        Feng, Han, Yu (2014), Automatica 50(4).
    """
    uncoupled = s_fotsmc.Gains(
        0.0, gains.G, gains.g, gains.Gamma1, gains.Gamma2, gains.gamma1, gains.gamma2
    )
    return _coupled(uncoupled, model, reference, feedback, memory, dt)
