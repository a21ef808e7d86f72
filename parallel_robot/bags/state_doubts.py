"""Doubts about recorded states: several recordings taken for one, several publishers, degrees."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from parallel_robot.bags.bag_files import files
from parallel_robot_model.common.units import HINGES, NANOSECONDS, JointUnits

GAP = 1.0  # s without states, in which a robot is not recorded
LEAP = 0.1  # rad, to and back within two samples: not the motion of one robot
TURN = 2.0 * math.pi  # rad, an angle beyond which may be in degrees
BACK = 0.1  # of a leap, by which its ends may differ


def doubts(
    bag: Path, stamps: np.ndarray, position: np.ndarray, units: JointUnits = HINGES
) -> list[str]:
    """What makes recorded states look like those of more than one run, or unit, one line each.

    Args:
        bag: The bag.
        stamps: Of the states [ns], shape (N,).
        position: Actuated joints [rad], shape (N, n).
        units: Those of the joints.
    """
    found = []
    steps = np.diff(stamps) / NANOSECONDS
    if len(steps) and steps.max() > GAP:
        names = [path.name for path in files(bag)]
        count = int((steps > GAP).sum())
        where = 'one place' if count == 1 else f'{count} places'
        what = f'no states for {steps.max():.4g} s' + (f', in {where}' if count > 1 else '')
        if len(names) > 1:
            what += f': several recordings, in {", ".join(names)}? figures are of all together; '
            what += 'give one file for its own, or a part of them by --from and --to'
        found.append(what)
    leaps = int(leaping(position).sum())
    if leaps:
        what = f'{leaps} states leap by more than {LEAP:g} {units.of("rad")} and back'
        found.append(f'{what}: two publishers that contradict each other?')
    slides = np.array(units.slides or (False,) * position.shape[1])
    far = float(np.abs(position[:, ~slides]).max(initial=0.0))
    if far > TURN:
        what = f'a joint reaches {far:.4g} rad, {far / TURN:.3g} turns'
        found.append(f'{what}: joint_states are in radians; degrees?')
    back = np.diff(stamps) < 0
    if back.any():
        what = f'the stamps of states go back by up to {-steps.min():.3g} s'
        found.append(f'{what}: a clock was set, or there are several runs')
    return found


def leaping(position: np.ndarray) -> np.ndarray:
    """Which states lie far beside both their neighbours, which agree, shape (N,).

    None where the motion is so fast, or so coarse, that its steps are near to leaps. The first and
    the last state have one neighbour; they are told by it where there are others.
    """
    found = np.zeros(len(position), bool)
    steps = np.abs(np.diff(position, axis=0))
    if len(steps) < 2 or np.median(steps) > BACK * LEAP:
        return found
    least = np.minimum(steps[:-1], steps[1:])
    leap = (least > LEAP) & (np.abs(position[2:] - position[:-2]) < BACK * least)
    found[1:-1] = leap.any(axis=1)
    if found.any():
        for end, near, inner in ((0, 0, 1), (-1, -1, -2)):
            alone = (steps[near] > LEAP) & (steps[inner] < BACK * LEAP)
            found[end] = alone.any()
    return found
