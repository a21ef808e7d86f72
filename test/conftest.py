"""Fixtures that many tests share; which tests are quick, which run under the pytest of ROS."""

import gc
import os
import signal
import sys

import pytest
from hypothesis import HealthCheck, settings

from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.fields import group
from parallel_robot_model.robots.planar_3rrr.kinematics import RobotParameters

STOCK = pytest.version_tuple < (9,)  # as in Ubuntu 24.04: colcon test, without the extra 'test'
QUICK = (  # tests that need no more than the suite, pytest and hypothesis
    *('antiwindup', 'cdr', 'certificate', 'config', 'coupling', 'cycle', 'decimation'),
    *('disturbance', 'estimator', 'fields', 'friction', 'integrators', 'joint_reader'),
    *('kinematics', 'metrics', 'packaging', 'parameter_file', 'plain_data', 'preflight'),
    *('printable', 'safety', 'scenario_file', 'singularity', 'switching', 'trajectory'),
    *('yaml_file',),
)


PROCESSES = (  # tests that start processes
    *('across_hosts', 'any_robot', 'arguments', 'benchmark', 'benchmarks', 'bus', 'c_law'),
    'calibrate',
    *('cluster', 'command_line'),
    *('completion', 'config', 'custom_import', 'custom_laws', 'custom_robots'),
    *('custom_trajectories', 'declared_options', 'docs', 'environment'),
    *('every_processor', 'faulty_robots', 'first_power_up', 'fmu', 'foreign_fmu'),
    'forked_process',
    *('foxglove', 'hold_node', 'hostile_bags', 'hostile_loop', 'hostile_wire', 'interpreted'),
    *('joins', 'kernel_cache', 'life_cycle', 'mechanism_bits'),
    *('limit', 'live_page', 'lockstep', 'monitor_node', 'mujoco_engine', 'node_parameters'),
    *('motion_change', 'nodes', 'notebook', 'numba_settings', 'own_scenarios', 'packaging'),
    *('processes', 'python', 'realtime', 'recorded_motions', 'recorder', 'recorder_node'),
    *('rehearse', 'replay', 'report', 'rerun', 'ros2_control', 'run', 'run_log', 'safety_nodes'),
    *('player_node', 'show', 'space_views', 'start'),
    *('state_period', 'study', 'sweep', 'sweep_losses', 'top', 'top_nodes', 'trust', 'tune'),
)
LONG = (  # tests that take as long as all others without processes together
    *(
        'calm',
        'driven_out',
        'fmu',
        'hostile_messages',
        'identification',
        'identify',
        'recover',
        'rivals',
    ),
    *('site', 'vectors', 'video'),
)
FIRST = (  # files that take longest, in either run: the workers then end together
    *('python', 'hostile_bags', 'custom_laws', 'run', 'limit', 'custom_trajectories', 'fmu'),
    *('live_page', 'safety_nodes', 'nodes', 'calibrate', 'notebook', 'start', 'custom_import'),
    *('custom_robots', 'replay', 'recover', 'identification', 'vectors', 'laws_on_robots'),
    *('cluster', 'benchmark', 'benchmarks', 'tune', 'report', 'site', 'rerun', 'across_hosts'),
    *('lockstep', 'bus', 'kernel_cache', 'sweep', 'command_line', 'hostile_messages'),
    'every_processor',
)
LONGEST = 200  # characters of a value in the name of a test
STARTS = ('subprocess.Popen', 'os.fork', 'os.posix_spawn')  # audit events
TOLD = (('git',), ('uname',))  # by which a bag says what made it


class LeftOut(pytest.Module):
    """A file of tests that is skipped, not even imported."""

    def collect(self):
        pytest.skip(
            f'quick subset of colcon test (pytest {pytest.__version__}); make test runs all',
            allow_module_level=True,
        )


def pytest_addoption(parser):
    parser.addoption('--quick', action='store_true', help='quick tests, which start no process')
    if STOCK:
        parser.addini('faulthandler_exit_on_timeout', 'of pytest 9')


def pytest_make_parametrize_id(val):
    if isinstance(val, (str, bytes)) and len(val) > LONGEST:
        return f'{val[:20]!r} and so on, {len(val)} in all'
    return None


def pytest_ignore_collect(collection_path, config):
    quick = config.getoption('quick')
    return (quick and collection_path.stem.removeprefix('test_') in (*PROCESSES, *LONG)) or None


def pytest_pycollect_makemodule(module_path, parent):
    if STOCK and module_path.stem.removeprefix('test_') not in QUICK:
        return LeftOut.from_parent(parent, path=module_path)
    return None


def pytest_collection_modifyitems(config, items):
    if config.getoption('quick'):
        waiting = [item for item in items if item.get_closest_marker('endurance')]
        config.hook.pytest_deselected(items=waiting)
        items[:] = [item for item in items if item not in waiting]
    items.sort(key=lambda item: item.path.stem.removeprefix('test_') not in FIRST)


def pytest_collection_finish():
    """What was collected stays: collections of garbage need not look through it."""
    gc.freeze()


@pytest.fixture(scope='session', autouse=True)
def _no_process(pytestconfig):
    """Where only quick tests are wanted, none starts a process."""

    def refuse(event, given):
        if event in STARTS and given[:1] not in TOLD:
            pytest.fail('it starts a process: see PROCESSES in conftest.py')

    if pytestconfig.getoption('quick'):
        sys.addaudithook(refuse)


@pytest.fixture(scope='session', autouse=True)
def _own_state(tmp_path_factory):
    """An emergency stop that a test leaves behind is not found by others, nor by users."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('XDG_STATE_HOME', str(tmp_path_factory.mktemp('state')))
        yield


@pytest.fixture(scope='session', autouse=True)
def _no_nicer():
    """`live` and `top` take less of the processor: in a worker, all tests after them would."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, 'nice', lambda _: os.getpriority(os.PRIO_PROCESS, 0))
        yield


settings.register_profile(
    'suite',
    deadline=None,  # the first example compiles
    derandomize=True,
    max_examples=50,
    suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow],
)
settings.load_profile('suite')
pytest.register_assert_rewrite('browser', 'ros_fixtures', 'sweeping', 'warm_trials')
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # where `nohup` starts the tests, too
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # a job in the background of a shell
    signal.signal(signal.SIGINT, signal.default_int_handler)
gc.set_threshold(200_000, 20, 20)  # what the compiler makes stays; seldom looked through


@pytest.fixture
def page_alone(monkeypatch):
    """Reports have no figures as files, which take a second."""
    monkeypatch.setattr('parallel_robot.analysis.report.report_files.FORMATS', ())


@pytest.fixture(scope='session')
def values():
    """Resolved configuration of the paper's circle; copy before changing."""
    return config.resolve('paper_circle')


@pytest.fixture(scope='session')
def robot(values):
    """Robot of Table 1."""
    return group(values, RobotParameters, 'robot')
