"""Efforts that a limit in the drives, or before them, makes less than the commands."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from parallel_robot_model.common.units import Array, JointUnits

LOOKS = 100  # states that are looked at, one in ten
LEAST = 2  # of them at which more is commanded, or nothing acts
STILL, CHANGE = 0.25, 0.75  # tolerances, by which an effort stays, and a command changes
CAUSE = (
    'a limit below safety.torque_limit? (enforce_command_limits, <limit effort> of the URDF, '
    'or one of the drives)'
)
CUT = (
    'a limit of speed below safety.speed_limit, or of position? (enforce_command_limits, '
    '<limit> of the URDF)'
)


class ClampedEfforts:
    """Keeps efforts and commands of a second or so, to tell why torque does not act."""

    def __init__(
        self, joints: tuple[str, ...], tolerance: Sequence[float], units: JointUnits
    ) -> None:
        """Begin with none.

        Args:
            joints: Their names.
            tolerance: Difference of effort and command that does not count [N m], one per joint.
            units: Units of the joints.
        """
        self._joints, self._tolerance, self._units = joints, tolerance, units
        self._noted: deque[tuple[Array, Array, Array]] = deque(maxlen=LOOKS)

    def note(self, effort: Array, torque: Array, velocity: Array) -> None:
        """Note what a state tells and what answers it.

        Args:
            effort: Torque that acts [N m], shape (n,); NaN where it is not known.
            torque: Torque that is commanded [N m], shape (n,).
            velocity: Measured rates [rad/s], shape (n,).
        """
        self._noted.append((effort.copy(), torque.copy(), velocity.copy()))

    def warning(self) -> str:
        """Which joint has them, of the states noted until now; empty for none."""
        if len(self._noted) < LEAST:
            return ''
        efforts, torques, velocities = np.swapaxes(self._noted, 0, 1)
        columns = zip(efforts.T, torques.T, velocities.T, self._tolerance, strict=True)
        for i, (effort, torque, velocity, tolerance) in enumerate(columns):
            what, units = f'efforts of {self._joints[i]}', self._units.one(i)
            if _is_clamped(effort, torque, tolerance):
                level = f'{effort[-1]:.3g} {units.of("N m")}'
                return f'{what} stay at {level} where {torque[-1]:.3g} is commanded: {CAUSE}'
            speed = _cut_at(effort, torque, velocity, tolerance)
            if speed:
                return f'{what} come and go at {speed:.2g} {units.of("rad/s")}: {CUT}'
        return ''


def _is_clamped(effort: Array, torque: Array, tolerance: float) -> bool:
    """Whether an effort stays at a level below the command, which has changed meanwhile.

    A motor that gives a share of its torque follows each change of the command.

    Args:
        effort: Torque that acts [N m], shape (N,), the newest last.
        torque: Torque that is commanded [N m], shape (N,).
        tolerance: Difference that does not count [N m].
    """
    level = float(effort[-1])
    away = np.flatnonzero(~(np.abs(effort - level) <= STILL * tolerance))  # NaN is away, too
    stays = torque[away[-1] + 1 if len(away) else 0 :]
    return bool(
        abs(level) > tolerance
        and (np.sign(level) * torque[-LEAST:] - abs(level) > tolerance).all()
        and np.ptp(stays) > CHANGE * tolerance
        and np.nanmax(np.abs(effort)) <= abs(level) + STILL * tolerance
    )


def _cut_at(effort: Array, torque: Array, velocity: Array, tolerance: float) -> float:
    """The speed at which efforts along the motion come and go [rad/s]; zero for none.

    While they do not obey, the command stays; at times it acts, at times nothing does, and the
    joint gets no faster. Motors that are off give nothing.

    Args:
        effort: Torque that acts [N m], shape (N,), the newest last.
        torque: Torque that is commanded [N m], shape (N,).
        velocity: Measured rates [rad/s], shape (N,).
        tolerance: Difference that does not count [N m].
    """
    command = float(torque[-1])
    stays = (torque == command) & (command * velocity > 0.0) & (abs(command) > tolerance)
    speed = np.abs(velocity[stays & (np.abs(effort) <= STILL * tolerance)])
    applied = stays & (np.abs(effort - command) <= STILL * tolerance)
    if len(speed) < LEAST or not applied.any():
        return 0.0
    usual = float(np.median(speed))
    return usual if np.ptp(speed) < usual else 0.0
