"""FMUs as laws: a law that is exported and taken back is the law; others are taken or refused."""

import re
import zipfile

import numpy as np
import pytest

from parallel_robot.cli.command_line import main
from parallel_robot.studies.tuning.space import space_of
from parallel_robot_control import law_loader
from parallel_robot_control.configuration import resolve
from parallel_robot_control.foreign.law import ForeignLaw
from parallel_robot_control.laws import s_fotsmc
from parallel_robot_control.safety import faults
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import fields
from parallel_robot_sim.scenario_run import simulate

SHORT = 0.1  # s
ROLES = {'position': 'input', 'torque': 'output'}
DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="x" guid="1">
  <CoSimulation modelIdentifier="x" canHandleVariableCommunicationStepSize="true"/>
  <ModelVariables>{variables}</ModelVariables>
  <ModelStructure/>
</fmiModelDescription>
"""


def made(folder, name, law='s_fotsmc', *words):
    """A law as an FMU."""
    file = folder / f'{name}.fmu'
    assert main(['fmu', 'law', law, '--out', str(file), *words]) == 0
    return file


def described(file, text, *others):
    """An FMU of a description alone, and empty files."""
    with zipfile.ZipFile(file, 'w') as archive:
        archive.writestr('modelDescription.xml', text)
        for other in others:
            archive.writestr(other, b'')
    return file


def variables(**of):
    """Variables in XML, each of a causality."""
    return ''.join(
        f'<ScalarVariable name="{name}" valueReference="{k}" causality="{role}"><Real'
        f'{" start=" + chr(34) + "0" + chr(34) if role == "input" else ""}/></ScalarVariable>'
        for k, (name, role) in enumerate(of.items())
    )


def run_of(file, scenario='paper_circle', **values):
    given = {'duration': SHORT, **values}
    return simulate(scenario, law=file.stem, custom_laws=[str(file)], **given)


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp('units')


@pytest.fixture(scope='module')
def taken(folder):
    return made(folder, 'taken')


@pytest.mark.parametrize('fmi', [2, 3])
@pytest.mark.parametrize('law', ['s_fotsmc', 'pid', 'observer_s_fotsmc'])
def test_exported_and_taken_back_is_the_same_law(tmp_path, law, fmi):
    file = made(tmp_path, f'{law}_{fmi}', law, '--fmi', str(fmi))
    for late in ({}, {'sensor.delay': 0.002, 'sensor.stamp': 'measured'}):
        taken = run_of(file, **late)
        own = simulate('paper_circle', law=law, duration=SHORT, **late)
        np.testing.assert_array_equal(taken.command, own.command)
        np.testing.assert_array_equal(taken.position, own.position)
        np.testing.assert_array_equal(taken.sliding_variable, own.sliding_variable)


@pytest.mark.parametrize('fmi', [2, 3])
def test_zero_angles_are_taken_off_once(tmp_path, fmi):
    zero = (0.01, -0.02, 0.005)
    file = made(
        tmp_path,
        'zeroed',
        's_fotsmc',
        '--fmi',
        str(fmi),
        '--set',
        f'estimator.zero_angle={[*zero]}',
    )
    known = {'estimator.zero_angle': zero, 'sensor.zero_angle': zero}
    own = simulate('paper_circle', law='s_fotsmc', duration=SHORT, **known)
    np.testing.assert_array_equal(run_of(file, **known).command, own.command)


def test_a_run_begins_anew(taken):
    np.testing.assert_array_equal(run_of(taken).command, run_of(taken).command)


def test_names_and_parameters_come_from_the_file_beside(folder, taken):
    other = folder / 'other.fmu'
    other.write_bytes(taken.read_bytes())
    other.with_suffix('.yaml').write_text(
        'inputs:\n'
        '  position: ["position[1]", "position[2]", "position[3]"]\n'
        '  reference: {velocity: ["reference.velocity[1]", "reference.velocity[2]",'
        ' "reference.velocity[3]"]}\n'
        'outputs:\n  torque: ["torque[1]", "torque[2]", "torque[3]"]\n  fault: fault\n'
        'parameters:\n  s_fotsmc.G: 3.0\n'
    )
    own = simulate('paper_circle', law='s_fotsmc', duration=SHORT, **{'s_fotsmc.G': 3.0})
    np.testing.assert_array_equal(run_of(other).command, own.command)
    assert not np.array_equal(run_of(taken).command, own.command)


def renamed(file, taken, **names):
    """A copy of an FMU that calls its variables otherwise."""
    with zipfile.ZipFile(taken) as old, zipfile.ZipFile(file, 'w') as new:
        for part in old.namelist():
            content = old.read(part)
            if part == 'modelDescription.xml':
                for name, other in names.items():
                    content = content.replace(
                        f'name="{name}"'.encode(), f'name="{other}"'.encode()
                    )
            new.writestr(part, content)
    return file


def test_the_age_of_states_goes_by_its_name_or_that_of_the_file_beside(tmp_path):
    late = {'sensor.delay': 0.002, 'sensor.stamp': 'measured'}
    law = 'observer_s_fotsmc'
    own = simulate('paper_circle', law=law, duration=SHORT, **late).command
    file = made(tmp_path, 'taken', law)
    other = renamed(tmp_path / 'other.fmu', file, age='since')
    assert not np.array_equal(run_of(other, **late).command, own)
    named = renamed(tmp_path / 'named.fmu', file, age='since')
    named.with_suffix('.yaml').write_text('inputs: {age: since}\n')
    np.testing.assert_array_equal(run_of(named, **late).command, own)


def test_something_else_that_is_called_age_is_left_alone(tmp_path, taken):
    other = renamed(tmp_path / 'other.fmu', taken, age='since', joins='age')
    np.testing.assert_array_equal(run_of(other).command, run_of(taken).command)


@pytest.mark.parametrize('fmi', [2, 3])
def test_its_parameters_are_gains_where_the_file_beside_says_so(tmp_path, fmi):
    tuned = made(tmp_path, 'tuned', 's_fotsmc', '--fmi', str(fmi))
    tuned.with_suffix('.yaml').write_text('gains: {G: s_fotsmc.G, rate: s_fotsmc.lambda}\n')
    for given in ({}, {'G': 3.0, 'rate': 20.0}, {'rate': 25}, {}):
        own = {f's_fotsmc.{"lambda" if key == "rate" else key}': v for key, v in given.items()}
        wanted = simulate('paper_circle', law='s_fotsmc', duration=SHORT, **own)
        found = run_of(tuned, **{f'tuned.{key}': value for key, value in given.items()})
        np.testing.assert_array_equal(found.command, wanted.command)
    with pytest.raises(InputError, match=r'tuned\.G must be .*, not -1'):
        run_of(tuned, **{'tuned.G': -1.0})


def test_its_gains_have_the_limits_and_texts_of_the_fmu(tmp_path, taken):
    file = tmp_path / 'described.fmu'
    file.write_bytes(taken.read_bytes())
    file.with_suffix('.yaml').write_text('gains: {G: s_fotsmc.G}\n')
    _, law = law_loader.load(str(file))
    _, gain = fields.parameters(law.Gains)
    own = next(each for each in fields.parameters(s_fotsmc.Gains) if each.key == 'G')
    assert (gain.key, gain.field.unit) == ('G', own.field.unit)
    assert (gain.field.low, gain.field.high) == (own.field.low, own.field.high)
    values = resolve('paper_circle', {'custom_laws': [str(file)]})
    assert values['described.G'] == values['s_fotsmc.G']
    assert [*space_of('described', law, values).varied] == ['G']  # not how long it may take


def test_a_process_that_was_ended_has_its_gains_again(tmp_path, taken, monkeypatch):
    file = tmp_path / 'ended.fmu'
    file.write_bytes(taken.read_bytes())
    file.with_suffix('.yaml').write_text('gains: {G: s_fotsmc.G}\n')
    first = run_of(file, **{'ended.G': 3.0})
    begin = ForeignLaw.start

    def begin_after_its_end(law):
        law._channel._process.kill()
        law._channel._process.wait()
        begin(law)

    monkeypatch.setattr(ForeignLaw, 'start', begin_after_its_end)
    np.testing.assert_array_equal(run_of(file, **{'ended.G': 3.0}).command, first.command)


def test_a_fault_of_its_own_is_one_here(tmp_path):
    slow = made(tmp_path, 'slow', 's_fotsmc', '--set', 'safety.speed_limit=0.01')
    _, told = run_of(slow).fault
    assert told == f'the law is in a fault of its own, {faults.REFERENCE_JUMP}'


@pytest.mark.parametrize('seconds', [0.002, 0.05])
def test_it_steps_on_by_its_period_where_states_are_left_out(taken, seconds):
    run = run_of(taken, hazards=[f'states_lost at 0.03 for {seconds}'])
    assert np.isnan(run.command).any() and run.fault is None


def test_what_it_says_of_a_failure_is_told(tmp_path, taken):
    file = tmp_path / 'steps.fmu'
    file.write_bytes(taken.read_bytes())
    with pytest.raises(InputError, match=r'steps by 0\.001 s, which must be the period, 0\.002 s'):
        run_of(file, period=0.002)
    other = tmp_path / 'forced.fmu'
    other.write_bytes(taken.read_bytes())
    other.with_suffix('.yaml').write_text('step: 0.002\n')
    time, told = run_of(other, period=0.002).fault
    assert time == 0.0 and told.startswith('the FMU failed: FMICallException')
    assert told.endswith('the step must be 0.001 s, the period of the loop, not 0.002')


@pytest.mark.parametrize(
    ('text', 'told'),
    [
        ('inputs: {positon: [a, b, c]}', "unknown input 'positon'; did you mean 'position'?"),
        ('output: {torque: [a, b, c]}', "unknown key 'output'; did you mean 'outputs'?"),
        ('inputs: {position: [a, b]}', "unknown input of .* 'a'"),
        ('inputs: {position: ["position[1]"]}', 'must name 3 numbers, one for each joint'),
        (
            'inputs: {position: ["positin[1]", "position[2]", "position[3]"]}',
            r"unknown input of .*'positin\[1\]'; did you mean 'position\[1\]'",
        ),
        (
            'inputs: {position: ["torque[1]", "torque[2]", "torque[3]"]}',
            r'torque\[1\] is a output of type Real, not a input',
        ),
        ('inputs: {position: 3}', 'must be an array, or a list of names, one for each joint'),
        ('inputs: {age: [a]}', 'inputs.age must be a name, not'),
        ('inputs: {age: joins}', 'joins is a parameter of type Boolean, not a input'),
        ('outputs: {fault: [a]}', 'outputs.fault must be a name, not'),
        ('parameters: {s_fotsmc.Gg: 1}', "unknown parameter of .* 's_fotsmc.Gg'; did you mean"),
        ('parameters: {s_fotsmc.G: x}', 'parameters.s_fotsmc.G must be a number'),
        ('parameters: {s_fotsmc.G: -1}', 'must be from 0 to inf, not -1'),
        ('gains: {G: s_fotsmc.Gg}', "unknown parameter of .*'s_fotsmc.Gg'; did you mean"),
        ('gains: {G: 3}', 'gains.G must be the name of a parameter, not 3'),
        ('gains: {limit: s_fotsmc.G}', 'gains.limit: limit cannot be the name of a gain'),
        ('gains: {lambda: s_fotsmc.G}', 'lambda cannot be the name of a gain'),
        ('gains: {joins: joins}', 'joins is no gain: it is not one number of type Real'),
        (f'gains: {{{", ".join(f"g{k}: s_fotsmc.G" for k in range(11))}}}', 'at most 10 param'),
        ('step: -1', "unknown key 'step'"),
        ('- a', 'must hold keys and values'),
    ],
)
def test_a_wrong_file_beside_is_one_line(tmp_path, taken, capsys, text, told):
    file = tmp_path / 'wrong.fmu'
    file.write_bytes(taken.read_bytes())
    file.with_suffix('.yaml').write_text(text)
    refused(file, capsys, told)


@pytest.mark.parametrize(
    ('make', 'told'),
    [
        (lambda file: file.write_text('no archive'), 'is no FMU: BadZipFile'),
        (lambda file: described(file, 'no XML'), 'is no FMU: '),
        (
            lambda file: described(
                file, DESCRIPTION.format(variables='').replace('"2.0"', '"1.0"')
            ),
            'is no FMU|is of FMI 1.0: a law is one of FMI 2.0 or 3.0',
        ),
        (
            lambda file: described(
                file, DESCRIPTION.format(variables='').replace('CoSimulation', 'ModelExchange')
            ),
            'is not for co-simulation',
        ),
        (
            lambda file: described(file, DESCRIPTION.format(variables=''), 'binaries/win64/x.dll'),
            'has no code for Linux on x86-64',
        ),
        (
            lambda file: described(
                file, DESCRIPTION.format(variables=''), 'binaries/linux64/x.so'
            ),
            'has no inputs: it is no law',
        ),
        (
            lambda file: described(
                file,
                DESCRIPTION.format(variables=variables(u='input', y='output')),
                'binaries/linux64/x.so',
            ),
            r'no input position\[1\]: wrong.yaml beside it says what it calls its inputs \(u\)',
        ),
    ],
    ids=['text', 'xml', 'version', 'exchange', 'windows', 'inputs', 'names'],
)
def test_what_is_no_law_is_one_line(tmp_path, capsys, make, told):
    file = tmp_path / 'wrong.fmu'
    make(file)
    refused(file, capsys, told)


def test_another_number_of_joints_is_one_line(tmp_path, taken, capsys):
    refused(taken, capsys, r'is for more than 2 joints', 'five_bar_circle')
    names = {f'{name}[{k}]': role for name, role in ROLES.items() for k in (1, 2)}
    text = DESCRIPTION.format(variables=variables(**names))
    two = described(tmp_path / 'two.fmu', text, 'binaries/linux64/x.so')
    refused(two, capsys, r"unknown input of .*'position\[3\]'")


def test_without_fmpy_it_is_one_line(tmp_path, taken, capsys, monkeypatch):
    (tmp_path / 'fmpy.py').write_text('raise ImportError')
    monkeypatch.setenv('PYTHONPATH', str(tmp_path))
    file = tmp_path / 'wrong.fmu'
    file.write_bytes(taken.read_bytes())
    refused(file, capsys, 'an FMU as a law needs fmpy: pip install fmpy')


def refused(file, capsys, told, scenario='paper_circle'):
    """Whether a simulation of it ends before it begins, with a line."""
    out = file.parent / 'bag'
    words = ['--law', str(file), '--duration', str(SHORT), '--out', str(out)]
    capsys.readouterr()
    assert main(['simulate', scenario, *words]) == 2
    err = capsys.readouterr().err
    assert err.count('\n') == 1 and re.search(told, err), err
    assert not out.exists()
