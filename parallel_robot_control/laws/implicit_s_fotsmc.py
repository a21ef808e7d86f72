"""S-FOTSMC whose integral of the switching function advances by backward Euler."""

from __future__ import annotations

from parallel_robot_control.law import kernel
from parallel_robot_control.laws import s_fotsmc
from parallel_robot_control.terms import Integral, unless_saturated
from parallel_robot_model.compiler import clip, multiply

TITLE = 'implicit S-FOTSMC'

Gains = s_fotsmc.Gains
initial_memory = s_fotsmc.initial_memory
validate_gains = s_fotsmc.validate_gains


@kernel
def update(gains, model, reference, feedback, memory, dt):
    """Compute the joint torque of one control cycle.

        tau_sw += clip(S, -dt (G + g), dt (G + g)),   all else as in S-FOTSMC

    The law gives S' = d' - tau_sw' with the lumped uncertainty d. Over a sample, backward Euler
    asks for the s with s = S - dt (G + g) sgn(s), sgn(0) any number from -1 to 1: tau_sw takes all
    of S where it can, and dt (G + g) else. The torque of the same sample has it. Where the change
    of d is within dt (G + g), S is 0 at the next sample, and tau_sw changes by no more than d.

    Returns:
        Torque [N m], S [rad/s^2] as the difference quotient of v, new memory.

    Source:
        Acary, Brogliato (2010), Systems and Control Letters 59(5); Acary, Brogliato, Orlov (2012),
        IEEE TAC 57(5); the law as of S-FOTSMC.
    """
    output = s_fotsmc.without_switching(gains, model, reference, feedback, memory, dt)
    most, last = dt * (gains.G + gains.g), output.memory.switching
    change = unless_saturated(clip(output.sliding_variable, -most, most), feedback.excess)
    tau_sw = Integral(last.value + change, last.rate)
    return s_fotsmc.with_switching(output, output.torque + multiply(model.M, change), tau_sw)
