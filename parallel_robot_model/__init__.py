"""Robots, and what all packages share: compiler, nodes, configuration, messages, processes."""

from parallel_robot_model.numba_settings import take_from_environment_alone

take_from_environment_alone()
