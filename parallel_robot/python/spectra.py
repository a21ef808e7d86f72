"""Spectra of what the joints do, and a robot as a linear system."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from parallel_robot.analysis.metrics import figures
from parallel_robot.python.notebook import motions_of
from parallel_robot_model.common.errors import Frame, InputError, UnknownNameError, pandas
from parallel_robot_model.common.options import named
from parallel_robot_model.configuration.config import Changes, Place, changes
from parallel_robot_model.configuration.fields import group
from parallel_robot_model.robots import poses
from parallel_robot_model.robots.joint_load import FrictionParameters
from parallel_robot_model.robots.poses import StateSpace
from parallel_robot_model.robots.registry import robot_of
from parallel_robot_sim.scenario_run import Run
from trajectory_gen.configuration import resolve

LONG = 1.0  # s, of the segments that are averaged: lines are 1 Hz apart
QUANTITIES = {'torque': 'nm2_per_hz', 'error': 'rad2_per_hz', 'velocity_error': 'rad2_per_s2_hz'}


def spectrum(
    run: Run, of: str = 'torque', *, start: float | None = None, stop: float | None = None
) -> Frame:
    """Power spectral density of torques or errors of the joints, one-sided, by Welch's method.

    >>> import parallel_robot as pr
    >>> density = pr.spectrum(pr.simulate('paper_circle', law='smc', duration=4))
    >>> bool(density.joint1_nm2_per_hz.idxmax() < 2)  # Hz, that of the motion
    True

    Args:
        run: The run.
        of: 'torque', 'error' or 'velocity_error'.
        start: Time from which on it is looked at [s]; default: that of :func:`metrics`.
        stop: Time up to which it is looked at [s], likewise.

    Returns:
        A pandas.DataFrame, a row a frequency [Hz], a column a joint. Its sum times the distance of
        the frequencies is the variance, of Hann windows of 1 s that overlap by half; the mean of
        each is not in it.

    Raises:
        InputError: there is no such part of the run, or pandas is not installed.

    Source:
        Welch (1967), The use of fast Fourier transform for the estimation of power spectra, IEEE
        Trans. Audio and Electroacoustics 15(2).
    """
    frames = pandas()
    from scipy.signal import welch  # it takes long to load

    if of not in QUANTITIES:
        raise UnknownNameError('of', of, QUANTITIES)
    window = figures(motions_of(run), start, stop).window
    rows = slice(*np.searchsorted(run.time, [window.start_s, np.nextafter(window.stop_s, np.inf)]))
    values = getattr(run, of)[rows]
    if len(values) < 2:
        raise InputError('a spectrum needs at least 2 samples')
    step = float(np.median(np.diff(run.time[rows])))
    length = min(len(values), max(2, round(LONG / step)))
    frequencies, density = welch(values, 1.0 / step, nperseg=length, axis=0)
    columns = [
        f'{joint}_{run.units.one(k).key(QUANTITIES[of])}' for k, joint in enumerate(run.joints)
    ]
    index = frames.Index(frequencies, name='frequency_hz')
    return frames.DataFrame(density, index=index, columns=columns)


# A robot as a linear system, for tools of control engineering.


def linearise(
    scenario: Place,
    pose: Sequence[float] | None = None,
    *,
    param_file: Changes = None,
    **values: Any,
) -> StateSpace:
    """The robot of a scenario at rest in a pose as x' = A x + B u, y = C x + D u.

    States are the positions and rates of the actuated joints, inputs their torques beside those
    that hold the robot, outputs the pose. It is the true robot, with its viscous friction;
    Coulomb friction, sensors and motors do not count. ``control.ss(*system)`` takes it.

    >>> import parallel_robot as pr
    >>> system = pr.linearise('paper_circle', [0.5, 0.37, 1.5708])
    >>> system.A.shape, system.B.shape, system.C.shape
    ((6, 6), (6, 3), (3, 6))

    Args:
        scenario: Name of a scenario, or the path of a YAML file.
        pose: The pose, m numbers; default: ``plant.initial_pose``.
        param_file: YAML file or mapping of keys of the configuration, or several; later ones win.
        values: Keys of the configuration and their values; they win over `param_file`.

    Raises:
        InputError: a name or value is wrong, or the robot cannot rest there.
    """
    configuration = resolve(named('scenario', scenario), changes(param_file, values))
    robot = robot_of(configuration, 'true_robot')
    margins = group(configuration, robot.module.SafetyMargins, 'safety')
    friction = group(configuration, FrictionParameters, 'friction')
    where = configuration['plant.initial_pose'] if pose is None else pose
    return poses.linearise(robot, margins, where, friction.viscous)
