"""What is known of a motion for which the bag has no reference."""

from __future__ import annotations

import numpy as np

from parallel_robot.bags.run_log import RunLog


def lines(log: RunLog) -> list[str]:
    """Length, rate, and for each joint span, speed and torque, as lines of text."""
    time = log.time
    period = float(np.median(np.diff(time))) if len(time) > 1 else np.nan
    rows = {
        'lowest angle [rad]': log.position.min(axis=0),
        'highest angle [rad]': log.position.max(axis=0),
    }
    if log.has_velocities:
        rows['velocity, rms [rad/s]'] = np.sqrt(np.mean(log.velocity**2, axis=0))
    if log.has_efforts:
        rows['torque, rms [N m]'] = np.sqrt(np.mean(log.effort**2, axis=0))
        rows['torque, max [N m]'] = np.abs(log.effort).max(axis=0)
    width = max(12, *(len(joint) + 2 for joint in log.joints))
    head = f'{len(time)} states in {time[-1] - time[0]:g} s, one in {1e3 * period:.4g} ms'
    return [
        f'{log.scenario}, {head}: no reference, so no errors',
        f'  {"":<24}' + ''.join(f'{joint:>{width}}' for joint in log.joints),
        *(
            f'  {name:<24}' + ''.join(f'{value:>{width}.4f}' for value in values)
            for name, values in rows.items()
        ),
    ]
