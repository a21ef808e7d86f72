"""Whether the torque that is asked for acts: the effort that a state tells, beside the commands.

Strangers, lost commands, motors that are off, clipped or dead, and brakes have one sign in common:
the effort is none of the torques that were commanded lately. A command may act late, and a motor
may lag; then the effort still lies between the commands of the last samples.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot_base.arrays import Array
from parallel_robot_compiler import clip, inner, read_at, select, some, write_at
from parallel_robot_control import kalman_memory
from parallel_robot_control.kalman_equations import Kalman

LATELY = 32  # samples within which a command acts
TOLD = 0.02  # s of a spell after which it is told, and its end is a way back
FORGETS = 0.5  # s by which a second of obedience shortens a spell: strangers may alternate
SPELL, LOST = 2, 3  # floats in the first rows of the memory: its length [s]; whether it goes on


class Arrival(NamedTuple):
    """What became of the last torque.

    Attributes:
        missing: Torque commanded less torque that acted [N m], shape (n,); zero where it acted.
        spell: For how long torque has been missing [s]; 0 while it acts.
        back: Whether torque acts again after a spell.
    """

    missing: Array
    spell: float
    back: bool


@inner
def arrival(
    kalman: Kalman,
    tolerance: Array,
    effort: Array,
    sample: int,
    age: float,
    comparable: bool,
    dt: float,
) -> Arrival:
    """Compare the effort that a state tells with the commands of the last samples.

    Args:
        kalman: Its memory has the commands.
        tolerance: Difference that does not count [N m], shape (n,).
        effort: Torque of the period that ended at the measurement [N m], shape (n,); NaN where it
            is not known.
        sample: Index of the sample from which on the next torque acts.
        age: From the measurement to that sample [s].
        comparable: Whether there was a state not long before; if not, what acts is what is told.
        dt: Time since the state before [s].
    """
    nothing, newest = np.zeros_like(effort), kalman_memory.newest(kalman)
    if not comparable or sample < newest:  # nothing was commanded lately
        kalman_memory.fill(kalman, select(effort - effort == 0.0, effort, nothing))
        write_at(kalman.memory, SPELL, 0.0)
        write_at(kalman.memory, LOST, 0.0)
        return Arrival(nothing, 0.0, False)
    last = sample - 1 - int(age / kalman.period + 0.5)
    last = select(last > newest, newest, last)
    asked = kalman_memory.torque(kalman, last, effort)
    spell, before = read_at(kalman.memory, SPELL, 0.0), read_at(kalman.memory, LOST, 0.0)
    step = select(dt < kalman.period * LATELY, dt, kalman.period)
    missing, lost = nothing, 0.0
    if some(np.abs(asked - effort) > tolerance):
        low, high = asked, asked
        for k in range(last - LATELY, newest + 1):
            torque = kalman_memory.torque(kalman, k, effort)
            low, high = select(torque < low, torque, low), select(torque > high, torque, high)
        outside = np.abs(clip(effort, low, high) - effort) > tolerance
        missing = select(outside, asked - effort, nothing)
        lost = select(some(outside), 1.0, 0.0)
    if lost != 0.0:
        spell += step
    elif spell > 0.0:
        left = spell - FORGETS * step
        spell = select(left > 0.0, left, 0.0)
    write_at(kalman.memory, SPELL, spell)
    write_at(kalman.memory, LOST, lost)
    long = lost == 0.0 and before != 0.0 and spell >= TOLD
    return Arrival(missing, select(lost != 0.0, spell, 0.0), long)
