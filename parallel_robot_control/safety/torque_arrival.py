"""Whether the torque that is asked for acts: the effort that a state tells, beside the commands.

Strangers, lost commands, motors that are off, clipped or dead, and brakes have one sign in common:
the effort is none of the torques that were commanded lately. A command may act late, and a motor
may lag; then the effort still lies between the commands of the last samples.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from parallel_robot_control.estimation import cycle_memory
from parallel_robot_control.estimation.cycle_memory import LOST, SPELL
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import clip, inner, read_at, select, some, write_at

LATELY, SOON = 32, 8  # samples within which a command acts; where none has acted yet
TOLD = 0.02  # s of a spell after which it is told, and its end is a way back
PROOF = 2.0  # tolerances of an effort that proves, if it was commanded, that the motors obey
OBEYED, MISSING, FORGETTING, UNPROVEN = 0.0, 1.0, 2.0, 3.0  # what the memory knows of them
FORGETS = 0.5  # s by which a second of obedience shortens a spell: strangers may alternate


class Arrival(NamedTuple):
    """What became of the last torque.

    Attributes:
        missing: Torque commanded less torque that acted [N m], shape (n,); zero where it acted.
        spell: For how long torque has been missing [s]; 0 while it acts.
        back: Whether the law begins anew: torque acts again after a spell, or has never acted.
        waits: Whether no torque has acted since the start: drives may be enabled late.
    """

    missing: Array
    spell: float
    back: bool
    waits: bool


@inner
def arrival(
    memory: int,
    period: float,
    tolerance: Array,
    effort: Array,
    sample: int,
    age: float,
    known: bool,
    comparable: bool,
    dt: float,
) -> Arrival:
    """Compare the effort that a state tells with the commands of the last samples.

    Args:
        memory: Address of the memory of the cycle, which has the commands.
        period: Of the samples [s].
        tolerance: Difference that does not count [N m], shape (n,).
        effort: Torque of the period that ended at the measurement [N m], shape (n,); NaN where it
            is not known.
        sample: Index of the sample from which on the next torque acts.
        age: From the measurement to that sample [s].
        known: Whether there was a state before.
        comparable: Whether there was one not long before; if not, what acts is what is told.
        dt: Time since the state before [s].
    """
    nothing, newest = np.zeros_like(effort), cycle_memory.newest(memory)
    before = read_at(memory, LOST, 0.0)
    if not comparable or sample < newest:  # nothing was commanded lately
        cycle_memory.fill(memory, select(effort - effort == 0.0, effort, nothing))
        write_at(memory, SPELL, 0.0)
        write_at(memory, LOST, select(known and before != UNPROVEN, OBEYED, UNPROVEN))
        return Arrival(nothing, 0.0, False, False)
    # 1. The usual case: the last command acted.
    last = sample - 1
    if age > 0.0:
        last -= int(age / period + 0.5)
    last = select(last > newest, newest, last)
    asked, spell = cycle_memory.torque_at(memory, last, effort), read_at(memory, SPELL, 0.0)
    apart = some(np.abs(asked - effort) > tolerance)
    if not apart and before == OBEYED:
        return Arrival(nothing, 0.0, False, False)
    # 2. A late command, or one behind a lag, is none that is missing.
    unproven, missing, lost = before == UNPROVEN, nothing, False
    if apart:
        low, high = asked, asked
        for k in range(last - select(unproven and spell > 0.0, SOON, LATELY), newest + 1):
            torque = cycle_memory.torque_at(memory, k, effort)
            low, high = select(torque < low, torque, low), select(torque > high, torque, high)
        outside = np.abs(clip(effort, low, high) - effort) > tolerance
        missing = select(outside, asked - effort, nothing)
        lost = some(outside)
    # 3. How long torque has been missing, and whether any has ever acted.
    step = select(dt < period * LATELY, dt, period)
    waits = unproven and (lost or not some(np.abs(effort) > PROOF * tolerance))
    misses = lost or (waits and spell > 0.0)
    spell = select(misses, spell + step, spell - FORGETS * step)
    spell = select(spell > 0.0, spell, 0.0)
    now = select(lost, MISSING, select(spell > 0.0, FORGETTING, OBEYED))
    write_at(memory, SPELL, spell)
    write_at(memory, LOST, select(waits, UNPROVEN, now))
    again = not misses and spell >= TOLD and (unproven or before == MISSING)
    return Arrival(missing, select(misses, spell, 0.0), again or (waits and lost), waits)
