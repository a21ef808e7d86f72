"""Fixtures that many tests share."""

import pytest
from hypothesis import HealthCheck, settings

from parallel_robot_base import config
from parallel_robot_model.planar_3rrr.parameters import RobotParameters

settings.register_profile(
    'suite',
    deadline=None,  # the first example compiles
    derandomize=True,
    max_examples=50,
    suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow],
)
settings.load_profile('suite')


@pytest.fixture(scope='session')
def values():
    """Resolved configuration of the paper's circle; copy before changing."""
    return config.resolve('paper_circle')


@pytest.fixture(scope='session')
def robot(values):
    """Robot of Table 1."""
    return config.group(values, RobotParameters, 'robot')
