"""Laws and robots as FMUs: the bits of `simulate`, no Python, state that goes back."""

from __future__ import annotations

import re
import subprocess
from ctypes.util import find_library
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from fmu_units import PERIOD, Unit, coupled, follows_schema, library, made

from parallel_robot.cli.command_line import main
from parallel_robot.fmu.unit import identifier
from parallel_robot_sim.scenario_run import simulate

DURATION = 0.3  # s
# What a plant can have: friction, noise, encoders, motors with a lag, late commands.
ROUGH = {
    'sensor.position_noise': 1e-5, 'sensor.velocity_noise': 1e-3, 'sensor.resolution': 1e-6,
    'sensor.delay': 0.002, 'sensor.stamp': 'measured', 'actuator.lag': 0.003,
    'actuator.noise': 0.01, 'actuator.delay': 0.001, 'friction.coulomb': 0.1, 'seed': 7,
    'compliance.stiffness': 5e4, 'compliance.rotor_inertia': 0.02, 'compliance.damping': 5.0,
    'stiction.stiffness': 5e3,
}  # fmt: skip


def words(values):
    return [word for key, value in values.items() for word in ('--set', f'{key}={value}')]


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp('units')


@pytest.fixture(scope='module', params=[2, 3])
def fmi(request):
    return request.param


@pytest.fixture(scope='module')
def law(folder, fmi):
    return made(folder, 'law', 's_fotsmc', fmi=fmi)


@pytest.fixture(scope='module')
def plant(folder, fmi):
    return made(folder, 'plant', 'paper_circle', fmi=fmi)


def run_of(**values):
    run = simulate('paper_circle', law='s_fotsmc', duration=DURATION, **values)
    return run, run.simulation.reference


def motion(reference):
    return reference.position, reference.velocity, reference.acceleration


def test_coupled_units_give_the_bits_of_simulate(law, plant):
    run, reference = run_of()
    commands, positions = coupled(Unit(law, effort_known=1), Unit(plant), motion(reference))
    np.testing.assert_array_equal(commands, run.command)
    np.testing.assert_array_equal(positions, run.position)


def test_rough_plant_gives_the_bits_of_simulate(tmp_path):
    law = made(tmp_path, 'law', 's_fotsmc', *words(ROUGH))
    plant = made(tmp_path, 'plant', 'paper_circle', *words(ROUGH))
    run, reference = run_of(**ROUGH)
    commands, positions = coupled(Unit(law, effort_known=1), Unit(plant), motion(reference))
    np.testing.assert_array_equal(commands, run.command)
    np.testing.assert_array_equal(positions, run.position)


def test_loop_of_both_gives_the_bits_of_simulate_and_rests_at_its_end(tmp_path):
    duration = 0.05
    more = ('--set', 'law=s_fotsmc', '--set', f'duration={duration}')
    unit = Unit(made(tmp_path, 'loop', 'paper_circle', *words(ROUGH), *more))
    run = simulate('paper_circle', law='s_fotsmc', duration=duration, **ROUGH)
    reference = run.simulation.reference
    for k in range(len(run.time)):
        np.testing.assert_array_equal(unit.row('position'), run.position[k])
        unit.step()
        np.testing.assert_array_equal(unit.row('torque'), run.command[k])
        np.testing.assert_array_equal(unit.row('reference.velocity'), reference.velocity[k])
    unit.step()
    np.testing.assert_array_equal(unit.row('reference.position'), reference.position[-1])
    assert not np.any(unit.row('reference.velocity'))


def test_loop_without_a_duration_is_as_long_as_the_run_of_simulate(tmp_path):
    unit = Unit(made(tmp_path, 'loop', 'paper_line'))
    run = simulate('paper_line')
    for _ in run.time:
        unit.step()
    np.testing.assert_array_equal(unit.row('torque'), run.command[-1])
    assert np.any(unit.row('torque') != run.command[-2])


def test_library_needs_no_more_than_c(law, plant):
    for folder in (law, plant):
        check_symbols(str(library(folder)))


def test_described_machine_and_own_law_give_the_bits_of_simulate(tmp_path):
    own = str(Path(__file__).parents[1] / 'docs' / 'example_law.py')
    law = made(tmp_path, 'law', own, '--scenario', 'five_bar_circle')
    plant = made(tmp_path, 'plant', 'five_bar_circle')
    run = simulate('five_bar_circle', law='example_law', duration=0.1, custom_laws=[own])
    reference = motion(run.simulation.reference)
    commands, positions = coupled(Unit(law, effort_known=1), Unit(plant), reference)
    np.testing.assert_array_equal(commands, run.command)
    np.testing.assert_array_equal(positions, run.position)


def test_what_is_learned_from_turn_to_turn_has_the_bits_of_simulate(tmp_path):
    learning = {
        'circle.radius': 0.001, 'circle.rate': 20.0 * np.pi, 'repetition.gain': 0.5,
        'repetition.cutoff': 50.0, 'repetition.wait': 0.02,
    }  # fmt: skip
    law = made(tmp_path, 'law', 's_fotsmc', '--scenario', 'paper_circle', *words(learning))
    plant = made(tmp_path, 'plant', 'paper_circle', *words(learning))
    run, reference = run_of(**learning)
    commands, _ = coupled(Unit(law, effort_known=1), Unit(plant), motion(reference))
    np.testing.assert_array_equal(commands, run.command)
    without, _ = run_of(**{**learning, 'repetition.gain': 0.0})
    assert np.abs(without.command - run.command).max() > 0.01


def test_law_that_makes_arrays_is_one_line(tmp_path, capsys):
    own = tmp_path / 'slicing_law.py'
    text = (Path(__file__).parents[1] / 'docs' / 'example_law.py').read_text()
    begin = text.index('    e = reference')
    made_anew = '    position = feedback.position.copy()\n    position[0] += 0.0\n'
    own.write_text(text[:begin] + made_anew + text[begin:])
    assert main(['fmu', 'law', str(own), '--out', str(tmp_path / 'x.fmu')]) == 2
    line = text[:begin].count('\n') + 1
    told = (
        f"update needs for Unknown attribute 'copy' of type Vector(3, float64) ({own.name}:{line})"
    )
    assert told in capsys.readouterr().err
    clipped = text.replace('    return C', '    torque = np.clip(torque, -5.0, 5.0)\n    return C')
    own = tmp_path / 'clipping_law.py'
    own.write_text(clipped)
    assert main(['fmu', 'law', str(own), '--out', str(tmp_path / 'x.fmu')]) == 2
    err = capsys.readouterr().err
    line = clipped[: clipped.index('np.clip')].count('\n') + 1
    assert f'({own.name}:{line})' in err and 'clip in place of it' in err


def check_symbols(file):
    needed = subprocess.run(['ldd', file], capture_output=True, text=True, check=True).stdout
    assert set(re.findall(r'(\w+)[-.\w]*\.so', needed)) <= {'linux', 'libm', 'libc', 'ld'}
    listed = ['nm', '-D', '--undefined-only', file]
    undefined = subprocess.run(listed, capture_output=True, text=True, check=True).stdout
    names = [line.split() for line in undefined.splitlines()]
    foreign = [name for kind, name in names if kind == 'U' and '@GLIBC' not in name]
    assert foreign == []
    assert not re.search('Py|NRT|numba', undefined)


def test_state_goes_back_and_into_another_instance(law, plant):
    _, reference = run_of()
    rows = [each[:40] for each in motion(reference)]
    first, robot = Unit(law, effort_known=1), Unit(plant)
    coupled(first, robot, [each[:20] for each in rows])
    kept = first.fmu.getFMUState(), robot.fmu.getFMUState()
    data = first.fmu.serializeFMUState(kept[0]), robot.fmu.serializeFMUState(kept[1])
    rest = [each[20:] for each in rows]
    expected = coupled(first, robot, rest)
    for unit, state in zip((first, robot), kept, strict=True):
        unit.fmu.setFMUState(state)
    again = coupled(first, robot, rest)
    np.testing.assert_array_equal(again, expected)
    others = Unit(law, effort_known=1), Unit(plant)
    for unit, each in zip(others, data, strict=True):
        unit.fmu.setFMUState(unit.fmu.deserializeFMUState(each))
    np.testing.assert_array_equal(coupled(*others, rest), expected)


def test_instances_do_not_share_memory(law, plant):
    _, reference = run_of()
    rows = [each[:30] for each in motion(reference)]
    alone = coupled(Unit(law), Unit(plant), rows)
    one, two = Unit(law), Unit(law, s_fotsmc__G=1.0)
    robots = Unit(plant), Unit(plant)
    for k in range(30):
        row = [each[k : k + 1] for each in rows]
        commands, _ = coupled(one, robots[0], row)
        coupled(two, robots[1], row)
        np.testing.assert_array_equal(commands[0], alone[0][k])


def test_gains_and_limits_are_tunable(law, plant):
    run, reference = run_of(**{'s_fotsmc.G': 3.0, 'safety.torque_limit': 0.5})
    limits = {f'safety__torque_limit[{k}]': 0.5 for k in (1, 2, 3)}
    unit = Unit(law, effort_known=1, s_fotsmc__G=3.0, **limits)
    commands, _ = coupled(unit, Unit(plant), motion(reference))
    np.testing.assert_array_equal(commands, run.command)
    other, _ = run_of()
    assert not np.array_equal(commands, other.command)


def test_refuses_values_out_of_range_and_other_steps(law):
    unit = Unit(law)
    with pytest.raises(Exception, match='status 3'):
        unit.put('safety.torque_limit[1]', -1.0)
    with pytest.raises(Exception, match='status 3'):
        unit.step(2 * PERIOD)
    unit.step()


def test_takes_steps_that_a_master_subtracts_after_days(law):
    unit = Unit(law)
    for k in (1, 100_000_000, 1_000_000_000):  # times round steps
        unit.time = k * PERIOD
        unit.step((k + 1) * PERIOD - k * PERIOD)
    with pytest.raises(Exception, match='status 3'):
        unit.step(1.001 * PERIOD)


def test_parameters_have_unit_range_text_and_start(law):
    root = ElementTree.parse(law / 'modelDescription.xml').getroot()
    found = {each.get('name'): each for each in root.find('ModelVariables')}
    limit = found['safety.torque_limit[1]']
    assert limit.get('variability') == 'tunable'
    typed = limit if limit.get('unit') else limit[0]
    assert typed.get('unit') == 'N m' and float(typed.get('min')) == 0.0
    assert float(typed.get('start')) > 0.0 and 'torque' in limit.get('description')
    exponent = found['s_fotsmc.gamma1']
    typed = exponent if exponent.get('start') else exponent[0]
    assert (float(typed.get('min')), float(typed.get('max'))) == (0.0, 1.0)
    assert found['robot.mp'].get('variability') == 'tunable'
    assert found['robot.l1'].get('variability') == 'constant'  # others follow from it
    for name, each in found.items():
        typed = each[0] if len(each) else each
        assert typed.get('start') or each.get('causality') in ('output', 'independent'), name


@pytest.mark.skipif(not find_library('xml2'), reason='no libxml2')
def test_description_follows_the_schema(law, plant, fmi):
    for folder in (law, plant):
        assert follows_schema(folder, fmi)
        assert not follows_schema(folder, 5 - fmi)


def test_fmpy_finds_no_fault(law, plant):
    pytest.importorskip('lxml')
    from fmpy.validation import validate_fmu

    for folder in (law, plant):
        assert validate_fmu(str(folder.with_suffix('.fmu'))) == []


def test_same_contents_make_the_same_file(tmp_path, law, fmi):
    again = made(tmp_path, 'law', 's_fotsmc', fmi=fmi)
    assert again.with_suffix('.fmu').read_bytes() == law.with_suffix('.fmu').read_bytes()


@pytest.mark.parametrize(
    ('text', 'name'),
    [('law', 'law'), ('3', '_3'), ("2nd law ü;'", '_2nd_law____'), ('a-b.c', 'a_b_c')],
)
def test_its_name_is_one_of_c(text, name):
    assert identifier(text) == name and name.isidentifier()


@pytest.mark.parametrize('name', ['nosuffix', 'x.zip', '.fmu'])
def test_a_file_that_does_not_end_with_fmu_is_one_line(tmp_path, capsys, name):
    file = tmp_path / name
    assert main(['fmu', 'law', 's_fotsmc', '--out', str(file)]) == 2
    assert f'--out must be a name and .fmu, not {file}' in capsys.readouterr().err


def test_no_gcc_is_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv('PATH', str(tmp_path))
    file: Path = tmp_path / 'x.fmu'
    assert main(['fmu', 'law', 's_fotsmc', '--out', str(file)]) == 2
    assert 'gcc is missing' in capsys.readouterr().err and not file.exists()
