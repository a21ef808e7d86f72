"""Coefficients of an exciting trajectory: those that show the worst combination best.

The combination of parameters that a motion shows worst is that of the smallest singular value of
the regressor, whose columns are multiplied by the sizes of the parameters: errors are relative.

Source:
    Swevers, Ganseman, Tukel, De Schutter, Van Brussel (1997), Optimal robot excitation and
    identification, IEEE Trans. Robotics and Automation 13(5).
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from parallel_robot.bags.output import tracked
from parallel_robot.studies.estimate import WrittenResult, check_files, condition_number
from parallel_robot.studies.identification import base_parameters
from parallel_robot.studies.identification.base_parameters import BaseParameters
from parallel_robot_control.configuration import resolve
from parallel_robot_control.safety.faults import SafetyParameters
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.options import named, optional_path
from parallel_robot_model.common.tables import Part, Table
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration.config import Changes, Place, changes
from parallel_robot_model.configuration.fields import Field, check, group
from parallel_robot_model.processes.blas_threads import one_blas_thread
from parallel_robot_model.robots.joint_load import FrictionParameters
from parallel_robot_model.robots.registry import RobotModel
from trajectory_gen.configuration import trajectory_of
from trajectory_gen.trajectory import Reference

SAMPLES = 300  # of a motion, for the search
SHARE = 0.5  # of the largest speed and torque that a motion may take
ROUNDS = 25  # halvings of the amplitude
SHAPE = 'excitation'
TRIALS = 2500
SEED = 0


class Quality(NamedTuple):
    """What a motion shows of the parameters."""

    # rms torque by which the worst combination is seen, for a change of 100 % [N m]
    weakest: float
    condition: float  # condition number of the scaled regressor


NOTHING = Quality(0.0, np.inf)


@dataclass(repr=False)
class Designed(WrittenResult):
    """An exciting motion."""

    parameters: dict[str, Any]  # the keys ``excitation.*`` that describe it
    quality: Quality  # what it shows of the parameters of the robot
    # what the coefficients show with which the search began; None if not feasible
    before: Quality | None
    robot: RobotModel
    trials: int  # number of motions that were tried
    seed: int  # seed of the search

    content = 'coefficients'

    def parts(self) -> list[Part]:
        """What it shows of the parameters, before the search and now."""
        rows = [
            [name, f'{quality.weakest:.4g}', f'{quality.condition:.4g}']
            for name, quality in self._qualities()
        ]
        weakest = self.robot.joint_units.label('weakest combination [N m]')
        return [Table(['', weakest, 'condition number'], rows)]

    def _qualities(self) -> list[tuple[str, Quality]]:
        before = [('before', self.before)] if self.before else []
        return [*before, ('now', self.quality)]

    def as_data(self) -> dict[str, Any]:
        """The same as plain data."""
        return {
            'robot': self.robot.name,
            'trials': self.trials,
            'seed': self.seed,
            **{
                name: {'weakest_nm': each.weakest, 'condition_number': each.condition}
                for name, each in self._qualities()
            },
        }

    def groups(self) -> dict[str, dict[str, Any]]:
        """The coefficients, and where the motion begins."""
        plant = {'initial_pose': self.parameters['center']}
        return {SHAPE: self.parameters, 'plant': plant}

    def header(self) -> list[str]:
        """What was searched, and how."""
        return [
            f'Exciting trajectory for {self.robot.name}: condition number '
            f'{self.quality.condition:.4g} ({self.trials} trials, seed {self.seed}).'
        ]


class Excitation:
    """Exciting motions of the robot of a scenario."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        """Prepare it."""
        shape = values['trajectory.shape']
        if shape != SHAPE:
            raise InputError(f'--design needs trajectory.shape {SHAPE}, not {shape}')
        self.trajectory = copy.copy(trajectory_of(values))  # whose shape will vary
        self.robot = self.trajectory.robot
        self.model = base_parameters.linear_model(self.robot)
        self.friction = group(values, FrictionParameters, 'friction')
        limits = group(values, SafetyParameters, 'safety')
        self.torque = SHARE * np.array(limits.torque_limit)
        self.speed = SHARE * self.trajectory.parameters.max_joint_speed
        self.start = self.trajectory.shape._replace(amplitude=1.0)
        self.times = np.linspace(0.0, self.trajectory.span, SAMPLES)
        self.base: BaseParameters | None = None

    def reference(self, sine: Array, cosine: Array) -> Reference | None:
        """Motion with some coefficients; None if the robot may not perform it."""
        shape = self.start._replace(sine=np.array(sine), cosine=np.array(cosine))
        self.trajectory.shape = shape
        found = self.trajectory.sample(self.times)
        robot = self.robot
        if (
            (found.out_of_reach >= 0).any()
            or robot.module.infeasible(robot.parameters, self.trajectory.limits, found)
            or (np.abs(found.velocity) > self.speed).any()
        ):
            return None
        torque = self.regressor(found) @ self.model.values(robot.parameters)
        return None if (np.abs(torque) > self.torque).any() else found

    def regressor(self, found: Reference) -> Array:
        """Regressor of the inertia along a motion, shape (N, n, P)."""
        moved = found.position, found.velocity, found.acceleration
        return np.asarray(self.model.regressor(self.robot.parameters, found.pose, *moved))

    def quality(self, found: Reference) -> Quality:
        """What a motion shows of the parameters."""
        if self.base is None:
            self.base = base_parameters.find(
                self.robot, [found.position], len(found.position), found.pose[0]
            )
        Y = self.regressor(found)[..., list(self.base.kept)]
        n = self.base.joints
        viscous = found.velocity[:, :, np.newaxis] * np.eye(n)
        Y = np.concatenate([Y, viscous, np.sign(viscous)], axis=-1).reshape(len(Y) * n, -1)
        scale = self.base.scale(base_parameters.sizes(self.robot), self.friction)
        singular = np.linalg.svd(Y * scale, compute_uv=False) / np.sqrt(len(Y))
        return Quality(float(singular[-1]), condition_number(singular))

    def largest(self, coefficients: Array) -> tuple[Quality, Array]:
        """Quality and coefficients at the largest amplitude that is feasible."""
        low, high, best = 0.0, 1.0, NOTHING
        half = len(coefficients) // 2
        for _ in range(ROUNDS):
            middle = 0.5 * (low + high)
            found = self.reference(*np.split(middle * coefficients, [half]))
            if found is None:
                high = middle
            else:
                low, best = middle, self.quality(found)
            if high - low < 0.02 * high:
                break
        return best, low * coefficients


@one_blas_thread()
def exciting_motion(
    scenario: Place,
    out: Place | None = None,
    *,
    trials: int = TRIALS,
    seed: int = SEED,
    param_file: Changes = None,
    **values: Any,
) -> Designed:
    """Search for a motion to identify a robot by, as ``parallel_robot identify --design`` does.

    It is an evolution strategy with one parent and one child.

    >>> import parallel_robot as pr
    >>> motion = pr.exciting_motion('excitation', trials=3)
    >>> list(motion.groups())
    ['excitation', 'plant']

    Args:
        scenario: Without a bag: scenario with an exciting trajectory, whose coefficients are the
            first parent; better ones are searched for and written to `out`.
        out: YAML file of the motion, for `param_file`, which must not exist; default: none.
        trials: Number of motions to try; default: 2500.
        seed: Seed of the search; default: 0.
        param_file: YAML file or mapping of keys of the configuration, or several; later ones win.
        values: Keys of the configuration and their values.

    Raises:
        InputError: a value is wrong, or no motion about this centre is feasible.

    Source:
        Rechenberg (1973), Evolutionsstrategie: the step grows after a success and shrinks
        otherwise, so that about one child in five succeeds.
    """
    file = optional_path('out', out)
    check_files(file)
    found = _searched(named('design', scenario), changes(param_file, values), trials, seed)
    found.write(file)
    return found


def _searched(scenario: str, changes: Mapping[str, Any], trials: int, seed: int) -> Designed:
    trials = check('--trials', int, Field('', '', 1), trials)
    seed = check('--seed', int, Field('', '', 0), seed)
    excitation, rng = Excitation(resolve(scenario, changes)), np.random.default_rng(seed)
    first = np.array([*excitation.start.sine, *excitation.start.cosine])
    found = excitation.reference(*np.split(first, [len(first) // 2]))
    before = None if found is None or not first.any() else excitation.quality(found)
    size = 0.2  # of the coefficients, before the amplitude is made feasible
    best, parent = excitation.largest(first if first.any() else size * rng.normal(size=len(first)))
    step = 0.3  # of the largest coefficient
    for _ in tracked(range(trials), trials, 'motions tried'):
        spread = max(float(np.abs(parent).max()), 1e-6)
        child = parent + step * spread * rng.normal(size=len(parent))
        quality, child = excitation.largest(3.0 * child)
        if quality.weakest > best.weakest:
            best, parent, step = quality, child, step * 1.5
        else:
            step = max(step * 0.9, 0.01)
    centre = list(map(float, excitation.start.center))
    if not best.weakest > 0.0:
        raise InputError(f'excitation.center {centre}: no motion about it is feasible')
    parent = np.trunc(parent * 1e5) / 1e5  # towards zero: within the limits still
    sine, cosine = (half.tolist() for half in np.split(parent, [len(parent) // 2]))
    shape = excitation.start._asdict() | {'sine': sine, 'cosine': cosine, 'center': centre}
    return Designed(shape, best, before, excitation.robot, trials, seed)
