"""FMUs as laws: units, initialisation, an end that they ask for, and what they leave behind."""

import math
import os
import re
import select
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from small_fmu import made

from parallel_robot.cli.command_line import main
from parallel_robot_sim.scenario_run import simulate

SHORT = 0.02  # s
DEFINED = (
    f'<Unit name="deg"><BaseUnit rad="1" factor="{math.pi / 180!r}"/></Unit>'
    f'<Unit name="rpm"><BaseUnit rad="1" s="-1" factor="{math.pi / 30!r}"/></Unit>'
    '<Unit name="mN.m"><BaseUnit kg="1" m="2" s="-2" factor="0.001"/></Unit>'
    '<Unit name="Hz"><BaseUnit s="-1"/></Unit>'
    '<Unit name="mm"><BaseUnit m="1" factor="0.001"/></Unit>'
    f'<Unit name="turned"><BaseUnit rad="1" factor="2" offset="{math.pi / 2!r}"/></Unit>'
)
PLAIN = {'position': 1.0, 'velocity': 1.0, 'reference.position': 1.0, 'torque': 1.0}


def run_of(file, scenario='paper_circle'):
    values = {'duration': SHORT, 'custom_laws': [str(file)], 'safety.torque_limit': [1e9] * 3}
    return simulate(scenario, law=file.stem, **values)


def law(run, offset=0.0, **of):
    """What the law of these FMUs answers, in the units that have these factors."""
    factors = PLAIN | of
    q = (run.position - offset) / factors['position']
    w = run.velocity / factors['velocity']
    r = (run.reference - offset) / factors['reference.position']
    y, torque = q[0].copy(), []
    for k in range(len(q)):
        y += 0.5 * (q[k] - y)
        torque.append(40.0 * (r[k] - y) + w[k])
    return factors['torque'] * np.array(torque)


@pytest.mark.parametrize('fmi', [2, 3])
def test_it_begins_with_its_inputs(tmp_path, fmi):
    run = run_of(made(tmp_path / 'lag.fmu', fmi))
    np.testing.assert_allclose(run.command, law(run), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize('fmi', [2, 3])
def test_its_units_are_converted(tmp_path, fmi):
    of = {'position': 'deg', 'velocity': 'rpm', 'reference.position': 'deg', 'torque': 'mN.m'}
    units = {name: {'unit': unit} for name, unit in of.items()}
    run = run_of(made(tmp_path / 'degrees.fmu', fmi, units, DEFINED))
    factors = {'deg': math.pi / 180, 'rpm': math.pi / 30, 'mN.m': 1e-3}
    wanted = law(run, **{name: factors[unit] for name, unit in of.items()})
    assert np.abs(wanted).max() > 0.01
    np.testing.assert_allclose(run.command, wanted, rtol=1e-9, atol=1e-9)


def test_a_unit_may_have_an_offset_and_begin_elsewhere(tmp_path):
    units = {name: {'unit': 'turned'} for name in ('position', 'reference.position')}
    run = run_of(made(tmp_path / 'turned.fmu', 2, units, DEFINED))
    wanted = law(run, math.pi / 2, position=2.0, **{'reference.position': 2.0})
    np.testing.assert_allclose(run.command, wanted, rtol=1e-9, atol=1e-9)


def test_names_of_our_units_need_no_definition(tmp_path):
    of = {'position': 'rad', 'velocity': 'rad/s', 'reference.position': '1', 'torque': 'N.m'}
    units = {name: {'unit': unit} for name, unit in of.items()}
    run = run_of(made(tmp_path / 'plain.fmu', 2, units))
    np.testing.assert_allclose(run.command, law(run), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize('fmi', [2, 3])
@pytest.mark.parametrize(
    ('name', 'unit', 'definitions', 'told'),
    [
        (
            'velocity',
            'Hz',
            DEFINED,
            r'velocity\[1\] is in Hz, which is 1 s\^-1: velocity is in rad/s or m/s',
        ),
        ('torque', 'rpm', DEFINED, r'torque\[1\] is in rpm, .*: torque is in N m or N'),
        ('position', 'deg', '', r'position\[1\] is in deg, which it does not define: position'),
        ('position', 'none', '<Unit name="none"><BaseUnit rad="1" factor="0"/></Unit>', 'is 0 ra'),
        ('position', 'mm', DEFINED, r'position\[1\] is in mm, but joint 1 is a hinge'),
    ],
)
def test_other_units_are_one_line(tmp_path, capsys, fmi, name, unit, definitions, told):
    file = made(tmp_path / 'wrong.fmu', fmi, {name: {'unit': unit}}, definitions)
    assert (
        main(['simulate', 'paper_circle', '--law', str(file), '--out', str(tmp_path / 'b')]) == 2
    )
    err = capsys.readouterr().err
    assert err.count('\n') == 1 and re.search(told, err), err
    assert not (tmp_path / 'bag').exists()


@pytest.mark.parametrize('fmi', [2, 3])
def test_an_end_that_it_asks_for_is_a_fault(tmp_path, fmi):
    time, told = run_of(made(tmp_path / 'ends.fmu', fmi, last=4)).fault
    assert time == pytest.approx(0.004)
    assert told == 'the FMU asks for the end of the simulation'


ASKS = """
import sys
from parallel_robot_control.foreign.channel import Channel
channel = Channel(sys.argv[1], {}, 3)
print(channel._process.pid, channel._folder.name, flush=True)
sys.stdin.read()
"""


def test_the_folder_of_a_killed_process_goes_with_it_or_with_the_next(tmp_path, monkeypatch):
    temporary = tmp_path / 'temporary'
    temporary.mkdir()
    monkeypatch.setenv('TMPDIR', str(temporary))
    words = [sys.executable, '-c', ASKS, str(made(tmp_path / 'lag.fmu'))]
    for both in (False, True, False):
        with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as asking:
            number, place = asking.stdout.readline().decode().split()
            ends = select.poll()
            ends.register(os.pidfd_open(int(number)), select.POLLIN)
            assert [*temporary.glob('*law*')] == [Path(place)]
            if both:
                os.kill(int(number), signal.SIGKILL)
                assert ends.poll(60_000)
            asking.kill()
        assert ends.poll(60_000) and Path(place).exists() == both
