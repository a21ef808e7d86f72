"""A signal ends a command whatever it is at, and is no mistake of what is being compiled."""

import signal
import threading

import pytest
from llvmlite.binding.executionengine import ExecutionEngine

from parallel_robot_model.processes.custom_module import wrap_user_errors
from parallel_robot_model.processes.termination_signals import Terminated, terminate

LATEST = 30.0  # s


@pytest.fixture(autouse=True)
def handler():
    before = signal.signal(signal.SIGTERM, terminate)
    yield
    signal.signal(signal.SIGTERM, before)


class Engine:
    """What the method of llvmlite needs of its engine."""

    def _object_cache_notify(self, module, data):
        raise AssertionError('not reached: the data end it before')


class Data:
    """Data of a callback, during which a signal arrives."""

    @property
    def contents(self):
        signal.raise_signal(signal.SIGTERM)
        raise ValueError('the callback went on')


def test_a_signal_is_not_blamed_on_custom_code():
    with pytest.raises(Terminated) as caught, wrap_user_errors('circle'):
        signal.raise_signal(signal.SIGTERM)
    assert caught.value.exit_code == 143


def test_a_signal_in_a_callback_of_the_compiler_ends_the_command_after_it():
    with pytest.raises(ValueError, match='went on'):
        ExecutionEngine._raw_object_cache_notify(Engine(), Data())
    with pytest.raises(Terminated) as caught:
        threading.Event().wait(LATEST)
    assert caught.value.exit_code == 143
