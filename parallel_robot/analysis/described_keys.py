"""Units and meanings of the keys of a configuration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from parallel_robot.analysis.monitor import MonitorParameters
from parallel_robot_control.configuration import available
from parallel_robot_model.configuration.fields import Field, joint_field, parameters
from parallel_robot_model.configuration.loop import loop_of
from parallel_robot_model.robots.registry import module_of, units_of
from parallel_robot_sim.configuration import members
from trajectory_gen.shapes import shapes


def fields_of(values: Mapping[str, Any]) -> dict[str, Field]:
    """Unit and meaning of the keys of a resolved configuration; those of the recorder need ROS."""
    loop = loop_of(values)
    motions = shapes(loop.custom_trajectories)
    known = members(module_of(loop), available(loop.custom_laws), motions)
    known += [(f'monitor.{each.key}', each) for each in parameters(MonitorParameters)]
    units = units_of(values)
    return {key: joint_field(key, parameter, units, motions) for key, parameter in known}
