"""A run of a scenario by its name, for scripts and notebooks: plain arrays over time."""

from __future__ import annotations

import html
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from parallel_robot_control import law_loader
from parallel_robot_control.configuration import resolve
from parallel_robot_control.messages import limits_text
from parallel_robot_model.common.errors import Frame, InputError, pandas, printable
from parallel_robot_model.common.options import named
from parallel_robot_model.common.units import NANOSECONDS, Array, JointUnits
from parallel_robot_model.configuration.config import Changes, changes
from parallel_robot_model.configuration.plain_data import LocatedDict, merged
from parallel_robot_model.robots.registry import is_known, robot_of, units_of
from parallel_robot_sim import simulation
from parallel_robot_sim.configuration import configure
from parallel_robot_sim.motions import Motions, differs, of_simulation, sensor_remarks
from parallel_robot_sim.run_columns import JointColumns, of_joints, of_poses
from parallel_robot_sim.simulation import Simulation, saturation
from trajectory_gen.configuration import with_duration
from trajectory_gen.preflight import motion_warnings

File = str | Path
ROUNDING = 1e-6  # s, much less than between two samples


@dataclass(frozen=True, eq=False, repr=False)
class Run:
    """A run as arrays, one row for each state: N states, n actuated joints, m coordinates.

    Attributes:
        scenario: Name of the scenario.
        law: Name of the law.
        joints: Names of the actuated joints.
        values: The resolved configuration, by key.
        time: Since the start [s], shape (N,).
        position: Actuated joints [rad], shape (N, n).
        velocity: Their rates [rad/s], shape (N, n).
        reference: Their desired positions when they were measured [rad], shape (N, n).
        reference_velocity: Their desired rates then [rad/s], shape (N, n).
        torque: Torque applied during the step that ended at the state [N m], shape (N, n).
        pose: Pose of the end effector, shape (N, m); (x, y, phi) [m, m, rad] for the 3-RRR. The
            true one; of a bag whose plant is not known, that of the measured joints by the nominal
            robot. NaN where the robot is not known here.
        pose_reference: Desired pose, shape (N, m).
        stamps: Stamps of the states [ns], shape (N,).
        reference_acceleration: Desired accelerations of the joints [rad/s^2], shape (N, n).
        command: Torque that answered the state [N m], NaN without an answer, shape (N, n).
        sliding_variable: In the unit of the law, NaN where it is not known, shape (N, n).
        place: Number of coordinates of a pose that are a place [m].
        fault: Time [s] and text of the first fault, None without one.
        limits: Limits that acted, by name; empty when none did.
        warnings: What to know of the run, one line each.
        simulation: All that the simulation has recorded; None for a run from a bag.
        motions: The motions of a run from a bag, of which its metrics are; None for a simulation.
        name: Name of the bag of a run from one, by which tables and pictures call it; else empty.
        has_efforts: Whether the torques were measured; else `torque` are those commanded.
    """

    scenario: str
    law: str
    joints: tuple[str, ...]
    values: Mapping[str, Any]
    time: Array
    position: Array
    velocity: Array
    reference: Array
    reference_velocity: Array
    torque: Array
    pose: Array
    pose_reference: Array
    stamps: NDArray[np.int64]
    reference_acceleration: Array
    command: Array
    sliding_variable: Array
    place: int = 2
    fault: tuple[float, str] | None = None
    limits: str = ''
    warnings: tuple[str, ...] = ()
    simulation: Simulation | None = None
    motions: Motions | None = None
    name: str = ''
    has_efforts: bool = True

    @property
    def units(self) -> JointUnits:
        """Units of the joints: rad and N m, or m and N of slides."""
        return units_of(self.values)

    @property
    def error(self) -> Array:
        """Error of the joints, reference - position [rad], shape (N, n)."""
        return self.reference - self.position

    @property
    def velocity_error(self) -> Array:
        """Error of the rates of the joints [rad/s], shape (N, n)."""
        return self.reference_velocity - self.velocity

    @property
    def pose_error(self) -> Array:
        """Error of the pose, desired - actual, shape (N, m)."""
        return self.pose_reference - self.pose

    def to_frame(self) -> Frame:
        """The run as a pandas.DataFrame, one row a state, with the columns of ``export``.

        Raises:
            InputError: pandas is not installed.
        """
        found = JointColumns(
            self.position,
            self.velocity,
            self.torque if self.has_efforts else np.full_like(self.torque, np.nan),
            self.reference,
            self.reference_velocity,
            self.reference_acceleration,
            self.command,
            self.sliding_variable,
        )
        columns = of_joints(self.time, self.stamps, self.joints, found, self.units)
        if is_known(self.values):
            robot = robot_of(self.values)
            coordinates = robot.module.coordinates(robot.parameters)
            poses = self.pose, self.pose_reference
            columns |= of_poses(coordinates, self.place, *poses, self._seen())
        frame: Frame = pandas().DataFrame(columns)
        return frame

    def _seen(self) -> Array | None:
        """Pose as sensors and nominal robot show it, NaN where none was told, shape (N, m).

        None where it is the best pose.
        """
        motions, time = self.motions, self.time
        if self.simulation is not None and differs(self.values):
            motions = of_simulation(self.simulation)
            time = (self.stamps - self.simulation.experiment.loop.step_start) / NANOSECONDS
        if motions is None or motions.true is None or motions.seen is None:
            return None
        seen = motions.seen
        rows = np.searchsorted(seen.time, time - ROUNDING)
        rows = np.minimum(rows, len(seen.time) - 1)
        reported = np.abs(seen.time[rows] - time) < ROUNDING
        return np.where(reported[:, np.newaxis], seen.poses.actual[rows], np.nan)

    def __repr__(self) -> str:
        """The run in a line; others for a fault, limits and warnings."""
        return '\n'.join(self._lines())

    def _repr_html_(self) -> str:
        """The same for a notebook."""
        head, *others = map(html.escape, self._lines())
        return '<br>'.join([f'<b>{head}</b>', *others])

    def _lines(self) -> list[str]:
        names = f'{printable(self.scenario)}, {printable(self.law)}'
        duration = self.time[-1] - self.time[0]
        rms = 1e6 * np.sqrt(np.mean(self.error**2))
        lines = [
            f'Run of {names}: {duration:g} s, {len(self.time)} states of {len(self.joints)} joints'
            f', joint error {rms:.4g} {self.units.of("µrad")} rms'
        ]
        if self.fault is not None:
            lines.append(f'fault at t = {self.fault[0]:.3f} s: {printable(self.fault[1])}')
        if self.limits:
            lines.append(f'limits acted: {printable(self.limits)}')
        return [*lines, *(f'warning: {printable(text)}' for text in self.warnings)]


def simulate(
    scenario: File,
    *,
    law: File | None = None,
    duration: float | None = None,
    hold: float | None = None,
    fit_speed: float | None = None,
    param_file: Changes = None,
    **values: Any,
) -> Run:
    """Run the closed loop without ROS, as ``parallel_robot simulate`` does.

    >>> import parallel_robot as pr
    >>> run = pr.simulate('paper_circle', law='smc', duration=2, **{'smc.z': 25})
    >>> run.error.shape
    (2001, 3)
    >>> print(run.fault)
    None

    Args:
        scenario: Name of a scenario in ``config/scenarios``, or the path of a YAML file.
        law: Control law, or its file, ``.py``, ``.so`` or ``.fmu``; default: that of the scenario.
        duration: Length of the run [s]; default: that of the scenario, else that of its motion,
            else 12.
        hold: Time for which the robot is held where its motion ended [s]; default: none.
        fit_speed: Share, e.g. 0.5, of the fastest speed that limits of joint speed and torque
            allow, at which the motion runs; default: as the scenario says.
        param_file: YAML file or mapping of keys of the configuration, or several; later ones win.
        values: Keys of the configuration and their values; they win over `param_file`.

    Raises:
        InputError: a name, a key, a value or a file is wrong, or the robot cannot perform the
            motion.
        RunError: the robot left its workspace.
    """
    name = named('scenario', scenario)
    changed = changes(param_file, values)
    of_law = {} if law is None else law_loader.chosen(named('law', law), changed)
    of_run = {} if duration is None else {'duration': duration}
    changed = merged([changed, of_law, of_run])
    if fit_speed is not None:
        changed, _ = fitted(name, changed, fit_speed)
    changed = with_duration(name, changed, hold)
    resolved = resolve(name, changed | {'time_mode': 'lockstep'})  # whose stamps a bag of it has
    return run_of(resolved, simulation.simulate(configure(resolved)))


def fitted(scenario: str, changed: LocatedDict, share: float) -> tuple[LocatedDict, str]:
    """Changes with the motion at a share of its fastest feasible speed, and that in words.

    Raises:
        InputError: the share is none, or the motion has no such speed.
    """
    from parallel_robot_sim.fastest import FACTOR, fastest  # few need it

    if not 0.0 < share <= 1.0:
        raise InputError(f'--fit-speed must be a share above 0, up to 1, not {share:g}')
    found = fastest(configure(resolve(scenario, with_duration(scenario, changed))))
    factor = share * found.factor
    told = f'{FACTOR}={factor:.6g}; at {found.factor:.4g} {found.text}'
    return changed | {FACTOR: factor}, told


def run_of(values: Mapping[str, Any], made: Simulation) -> Run:
    """A simulation as a Run.

    Args:
        values: Its resolved configuration.
        made: The simulation.
    """
    loop, record, desired = made.experiment.loop, made.run, made.reference
    measured = made.desired
    active_limits = int(np.bitwise_or.reduce(record.active_limits))
    fault = made.fault
    return Run(
        loop.scenario,
        loop.law,
        tuple(loop.joints),
        values,
        loop.period * np.arange(len(record.position), dtype=np.float64),
        record.position,
        record.velocity,
        measured.position,
        measured.velocity,
        record.effort,
        record.pose,
        desired.pose,
        _stamps(made),
        measured.acceleration,
        record.command,
        np.ascontiguousarray(record.telemetry.sliding_variable),
        made.experiment.trajectory.robot.place,
        None if fault is None else (fault[0], fault[1].text),
        limits_text(active_limits) if active_limits else '',
        (
            *made.experiment.control.law.warnings,
            *sensor_remarks(values),
            *saturation(values, record.effort),
            *motion_warnings(made.experiment.trajectory),
            *simulation.plant_warnings(made.configuration),
        ),
        made,
    )


def _stamps(made: Simulation) -> NDArray[np.int64]:
    """Stamps of the states of a simulation, as its bag has them [ns], shape (N,)."""
    loop, count = made.experiment.loop, len(made.run.position)
    late = made.timeline.reception.late
    age = round(made.age * NANOSECONDS)
    return loop.step_start + loop.period_ns * (np.arange(count) - late) - age
