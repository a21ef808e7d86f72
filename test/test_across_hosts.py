"""The controller on another host: network namespaces, joined by a cable that is pulled."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from reliability import hosts
from reliability.hosts import two_hosts
from ros_fixtures import PATIENCE, SLOW_LOOP, STATE_TIMEOUT

from parallel_robot_control.safety import faults
from parallel_robot_control.safety.faults import STATES_STALE

pytest_plugins = ['ros_fixtures']

ROOT = Path(__file__).parents[1]
FAULTS = ROOT / 'benchmarks' / 'faults.py'


def names():
    return subprocess.run(['ip', 'netns', 'list'], capture_output=True, text=True).stdout


@pytest.fixture
def permitted():
    """Skip where there is no second host, with the reason."""
    try:
        with two_hosts():
            pass
    except PermissionError as error:
        pytest.skip(str(error))


@pytest.mark.endurance
def test_a_cut_link_is_ridden_through_or_ends_in_safe_actions(
    permitted, domain, compiled, tmp_path
):
    pairs = [key.replace(':=', '=') for key in (*SLOW_LOOP, 'plant.command_timeout:=0.5')]
    pairs.append(f'safety.state_timeout={STATE_TIMEOUT}')
    words = [word for pair in pairs for word in ('--set', pair)]
    done = subprocess.run(
        [sys.executable, FAULTS, '--only', 'link between', '--json', 'rows', *words],
        cwd=tmp_path, env={**os.environ, 'PYTHONPATH': str(ROOT)},
        capture_output=True, text=True, timeout=2 * PATIENCE,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    short, long = json.loads((tmp_path / 'rows').read_text())
    assert short['recovery'] is not None and long['recovery'] is not None
    assert f'fault: {faults.FAULTS[STATES_STALE].text}' in long['reaction']  # at the far end
    assert 'plant: the motors take their safe action' in long['reaction']  # at the near end
    assert 1e-3 < long['worst'] < 0.08  # damped, it stays where it was; the circle goes on


def test_nothing_is_left_of_hosts_whose_use_fails(permitted):
    found = []

    def fail():
        with two_hosts() as (near, far):
            found.extend([near, far])
            assert near in names() and far in names()
            hosts.pull(far)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert len(found) == 2 and not any(name in names() for name in found)


def test_hosts_of_a_process_that_was_killed_are_removed(permitted):
    gone = subprocess.Popen(['true'])
    gone.wait()
    subprocess.run(['ip', 'netns', 'add', hosts.name(gone.pid, 'far')], check=True)
    subprocess.run(['ip', 'netns', 'add', hosts.name(os.getppid(), 'far')], check=True)
    try:
        with two_hosts():
            assert hosts.name(gone.pid, 'far') not in names()
            assert hosts.name(os.getppid(), 'far') in names()
    finally:
        subprocess.run(['ip', 'netns', 'delete', hosts.name(os.getppid(), 'far')], check=True)


def test_what_is_not_permitted_is_said_in_a_line(monkeypatch, tmp_path):
    refusing = tmp_path / 'ip'
    refusing.write_text(
        '#!/bin/sh\n[ "$2" = list ] && exit\necho "Operation not permitted" >&2\nexit 1\n'
    )
    refusing.chmod(0o755)
    monkeypatch.setenv('PATH', str(tmp_path))
    with (
        pytest.raises(PermissionError, match=r'ip netns add .*: Operation not permitted'),
        two_hosts(),
    ):
        pass
    refusing.unlink()
    with pytest.raises(PermissionError, match='not installed'), two_hosts():
        pass
