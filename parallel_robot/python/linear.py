"""A robot as a linear system, for tools of control engineering."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from parallel_robot_model.configuration.fields import group
from parallel_robot_model.robots import poses
from parallel_robot_model.robots.joint_load import FrictionParameters
from parallel_robot_model.robots.poses import StateSpace
from parallel_robot_model.robots.registry import robot_of
from parallel_robot_sim.scenario_run import changes, named
from trajectory_gen.configuration import resolve


def linearise(
    scenario: str | Path,
    pose: Sequence[float] | None = None,
    *,
    param_file: str | Path | Iterable[str | Path] | None = None,
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
        param_file: YAML file with keys of the configuration, or several; later ones win.
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
