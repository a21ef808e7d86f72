"""Fixtures that many tests share; which tests run under the pytest of a ROS installation."""

import pytest
from hypothesis import HealthCheck, settings

from parallel_robot_base import config
from parallel_robot_model.planar_3rrr.parameters import RobotParameters

STOCK = pytest.version_tuple < (9,)  # as in Ubuntu 24.04: colcon test, without the extra 'test'
QUICK = (  # tests that need no more than the suite, pytest and hypothesis
    *('antiwindup', 'cdr', 'certificate', 'config', 'coupling', 'cycle', 'decimation'),
    *('disturbance', 'estimator', 'fields', 'friction', 'integrators', 'joint_reader'),
    *('kinematics', 'metrics', 'packaging', 'parameter_file', 'plain_data', 'preflight'),
    *('printable', 'safety', 'scenario_file', 'singularity', 'switching', 'trajectory'),
    *('yaml_file',),
)


class LeftOut(pytest.Module):
    """A file of tests that is skipped, not even imported."""

    def collect(self):
        pytest.skip(
            f'quick subset of colcon test (pytest {pytest.__version__}); make test runs all',
            allow_module_level=True,
        )


def pytest_addoption(parser):
    if STOCK:
        parser.addini('faulthandler_exit_on_timeout', 'of pytest 9')


def pytest_pycollect_makemodule(module_path, parent):
    if STOCK and module_path.stem.removeprefix('test_') not in QUICK:
        return LeftOut.from_parent(parent, path=module_path)
    return None


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
