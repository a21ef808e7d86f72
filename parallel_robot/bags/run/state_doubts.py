"""Doubts about recorded states: several recordings taken for one, other units or signs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from parallel_robot.bags.files.bag_files import files
from parallel_robot_model.common.units import HINGES, NANOSECONDS, JointUnits, beyond_a_turn

GAP = 1.0  # s without states, in which a robot is not recorded
LEAP = 0.1  # rad, to and back within two samples: not the motion of one robot
BACK = 0.1  # of a leap, by which its ends may differ
FLIPPED = 0.1  # of an error, below which that with the other sign tells of a wrong sign
LEAST = 1e-3  # rad or m, of such an error
ROUNDING = 1e-6  # of a limit, by which efforts may be beyond it


def doubts(
    bag: Path, stamps: np.ndarray, position: np.ndarray, units: JointUnits = HINGES
) -> list[str]:
    """What makes recorded states look like those of more than one run, one line each.

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
    back = np.diff(stamps) < 0
    if back.any():
        what = f'the stamps of states go back by up to {-steps.min():.3g} s'
        found.append(f'{what}: a clock was set, or there are several runs')
    return found


def beyond(position: np.ndarray, units: JointUnits = HINGES) -> list[str]:
    """That joints go beyond a whole turn, a line, if they do.

    Args:
        position: Actuated joints [rad], shape (N, n).
        units: Those of the joints.
    """
    far = beyond_a_turn(position, units)
    return [f'a joint reaches {far}'] if far else []


def flipped(
    joints: Sequence[str], position: np.ndarray, reference: np.ndarray, units: JointUnits = HINGES
) -> list[str]:
    """Which joints are where their references are but for the sign, one line each.

    Args:
        joints: Names of the joints.
        position: Their positions [rad], shape (N, n).
        reference: Desired positions [rad], NaN where there is none, shape (N, n).
        units: Those of the joints.
    """
    known = np.isfinite(reference).all(axis=1)
    if not known.any():
        return []
    error, other = (
        np.sqrt(np.mean((reference[known] - sign * position[known]) ** 2, axis=0))
        for sign in (1.0, -1.0)
    )
    return [
        f'{joint} has an error of {error[k]:.3g} {units.one(k).of("rad")} rms, '
        f'with the other sign {other[k]:.2g}: is its sign wrong?'
        for k, joint in enumerate(joints)
        if error[k] > LEAST and other[k] < FLIPPED * error[k]
    ]


def too_strong(effort: np.ndarray, limit: np.ndarray, units: JointUnits = HINGES) -> list[str]:
    """That efforts are beyond what the motors can give, a line, if they are.

    Args:
        effort: Of the joints [N m], shape (N, n).
        limit: Of the motors [N m], shape (n,) or ().
        units: Those of the joints.
    """
    if limit.size not in (1, effort.shape[1]):
        return []
    excess = (np.abs(effort) - (1.0 + ROUNDING) * limit).max(axis=0, initial=-np.inf)
    k = int(np.argmax(excess))
    if not excess[k] > 0.0:
        return []
    unit, most = units.one(k).of('N m'), float(np.abs(effort[:, k]).max())
    own = float(np.broadcast_to(limit, effort.shape[1])[k])
    what = f'efforts reach {most:.4g} {unit}, more than plant.torque_limit, {own:g} {unit}'
    return [f'{what}: are they in {unit}?']


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
