"""S-FOTSMC whose switching gain is estimated online: of the uncertainty only a cap is given."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from parallel_robot_control.law import Field, kernel
from parallel_robot_control.laws import s_fotsmc
from parallel_robot_model.compiler import select

TITLE = 'adaptive S-FOTSMC'

initial_memory = s_fotsmc.initial_memory
validate_gains = s_fotsmc.validate_gains
INSIDE = 3.0  # width over the rms of the noise of S

_without_switching = s_fotsmc.without_switching
_switched = s_fotsmc.switched


class Gains(NamedTuple):
    """Gains of S-FOTSMC, with the barrier function that estimates G in place of G and g."""

    lambda_: Annotated[float, Field('1/s', 'weight of the synchronisation errors', 0.0)]
    slope: Annotated[float, Field('1/s', 'slope of the gain at S = 0', 0.0)]
    width: Annotated[float, Field('rad/s^2', '|S| at which the barrier stands', 1e-6)]
    G_max: Annotated[float, Field('rad/s^3', 'largest gain', 0.0)]
    Gamma1: Annotated[float, Field('rad^(1-gamma1)/s^2', 'weight of the coupled error', 0.0)]
    Gamma2: Annotated[float, Field('(rad/s)^(1-gamma2)/s', 'weight of its rate', 0.0)]
    gamma1: Annotated[float, Field('', 'exponent of the coupled error', 0.0, 1.0)]
    gamma2: Annotated[float, Field('', 'exponent of its rate', 0.0, 1.0)]


def noise_warnings(gains: Gains, noise: float, period: float) -> list[str]:
    """Warn of gains that let noise alone drive the estimated gain to G_max.

    S = (v_k - v_(k-1)) / dt has the noise s = sqrt(2) noise / dt of two rates. Three times s are
    to lie inside the barrier, and the gain at |S| = s is to be below G_max.

    Args:
        gains: See Gains.
        noise: Noise of the rates, rms [rad/s].
        period: Control period [s].
    """
    s = math.sqrt(2.0) * noise / period
    what = f'the noise of S, sqrt(2) sensor.velocity_noise / period = {s:.3g} rad/s^2, drives'
    if gains.width < INSIDE * s:
        return [f'{what} the gain to G_max: width = {gains.width:g}, at least {INSIDE * s:.3g}']
    most = gains.G_max * (1.0 - s / gains.width) / s
    if gains.slope > most:
        return [f'{what} the gain to G_max: slope = {gains.slope:g} 1/s, at most {most:.3g}']
    return []


@kernel
def update(gains, model, reference, feedback, memory, dt):
    """Compute the joint torque of one control cycle: S-FOTSMC with a gain for each joint.

        G_i = min(G_max, slope |S_i| / (1 - |S_i| / width)),   G_max where |S_i| >= width.

    S = Xi - tau_sw is what the switching control has not yet cancelled of the uncertainty, so the
    gain is small where little is left and rises without a known bound where S nears the barrier:
    as long as |Xi'| < G_max, |S| stays below width. The gain falls with S, so it is never
    overestimated for long, and near S = 0 the switching control is smooth: no chattering.
    slope dt must stay well below 1.

    Returns:
        Torque [N m], S [rad/s^2], new memory.

    Source:
        Doan, Le, Vo (2019), Remark 1, for the aim; Obeid, Fridman, Laghrouche, Harmouche (2018),
        Barrier function-based adaptive sliding mode control, Automatica 93, for the barrier.
    """
    output = _without_switching(gains, model, reference, feedback, memory, dt)
    S = output.sliding_variable
    left = 1.0 - np.abs(S) / gains.width
    barrier = gains.slope * np.abs(S) / left
    G = select((left > 0.0) & (barrier < gains.G_max), barrier, gains.G_max)
    return _switched(output, G * np.sign(S), feedback.excess)
