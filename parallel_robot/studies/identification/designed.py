"""An exciting motion that was searched for, in words and as YAML."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from parallel_robot.bags import output
from parallel_robot.studies.identification import design, robot_file
from parallel_robot.studies.identification.design import Design
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.tables import Part, ShownResult, Table
from parallel_robot_model.common.units import HINGES, JointUnits
from parallel_robot_model.configuration.fields import Field, check
from parallel_robot_model.robots.registry import units_of

TRIALS = 2500
SEED = 0


@dataclass(frozen=True, repr=False)
class Designed(ShownResult):
    """An exciting motion.

    Attributes:
        design: The motion, and what it shows.
        robot: Name of its robot.
        trials: Number of motions that were tried.
        seed: Seed of the search.
        units: Units of the joints.
    """

    design: Design
    robot: str
    trials: int
    seed: int
    units: JointUnits = HINGES

    def parts(self) -> list[Part]:
        """What it shows of the parameters, before the search and now."""
        rows = [
            [name, f'{quality.weakest:.4g}', f'{quality.condition:.4g}']
            for name, quality in (('before', self.design.before), ('now', self.design.quality))
            if quality is not None
        ]
        weakest = self.units.label('weakest combination [N m]')
        return [Table(['', weakest, 'condition number'], rows)]

    def as_data(self) -> dict[str, Any]:
        """The same as plain data."""
        found = self.design
        qualities = {'before': found.before, 'now': found.quality}
        return {
            'robot': self.robot,
            'trials': self.trials,
            'seed': self.seed,
            **{
                name: {'weakest_nm': each.weakest, 'condition_number': each.condition}
                for name, each in qualities.items()
                if each is not None
            },
        }

    def write(self, path: Path) -> None:
        """Write the coefficients as YAML, for ``--param-file``, into a file that must not exist.

        Raises:
            InputError: it cannot be written.
        """
        found = self.design
        comment = (
            f'# Exciting trajectory for {self.robot}: condition number '
            f'{found.quality.condition:.4g} ({self.trials} trials, seed {self.seed}).\n'
        )
        plant = {'initial_pose': found.parameters['center']}
        tree = {design.SHAPE: found.parameters, 'plant': plant}
        try:
            output.write_new(path, (comment + robot_file.dump(tree)).encode())
        except OSError as error:
            raise InputError(f'cannot write {path}: {error.strerror}') from None

    def __repr__(self) -> str:
        """The same in lines."""
        return '\n'.join(self.lines())


def search(
    scenario: str, changes: Mapping[str, Any], trials: int | None = None, seed: int | None = None
) -> Designed:
    """Search for the coefficients of an exciting motion.

    Args:
        scenario: Name or file of a scenario with an exciting motion.
        changes: What changes in it.
        trials: Number of motions to try; None: TRIALS.
        seed: Seed of the search; None: SEED.

    Raises:
        InputError: a value is wrong, or no motion is feasible.
    """
    trials = _whole('--trials', TRIALS if trials is None else trials)
    seed = _whole('--seed', SEED if seed is None else seed)
    if trials < 1:
        raise InputError(f'--trials must be at least 1, not {trials}')
    if seed < 0:
        raise InputError(f'--seed must not be negative, not {seed}')
    values = resolve(scenario, changes)
    return Designed(
        design.design(values, trials, seed), values['robot_model'], trials, seed, units_of(values)
    )


def _whole(option: str, value: Any) -> int:
    number: int = check(option, int, Field('', ''), value)
    return number
