"""Runs, bags, metrics, pictures and sweeps from Python, and the examples of its docstrings."""

import doctest
import importlib.util
import json
import re
import subprocess
import sys
import warnings
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pandas
import pytest
import yaml
from custom_law import LAW
from mcap.reader import make_reader

import parallel_robot
from parallel_robot import Run, simulate
from parallel_robot.analysis.report.runs import read_runs
from parallel_robot.bags.run import recording
from parallel_robot.bags.writing import simulation_bag
from parallel_robot.cli import command_line
from parallel_robot.python import notebook, written_tables
from parallel_robot_control.foreign import c_law
from parallel_robot_control.laws import LAWS
from parallel_robot_model.common import errors
from parallel_robot_model.common.errors import BagError, InputError
from parallel_robot_model.common.tables import ShownResult
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.loop import DURATION

pytest_plugins = ['sweeping']

ROOT = Path(__file__).parents[1]
STUDY = {
    'scenarios': ['paper_circle'],
    'laws': ['smc', 's_smc'],
    'runs': 2,
    'duration': 0.1,
    'uncertainty': {'true_robot.mp': {'distribution': 'uniform', 'relative': 0.2}},
}


@pytest.fixture(scope='module')
def run():
    return simulate('paper_circle', law='smc', duration=1, **{'smc.z': 25})


def messages(bag):
    """All messages of a bag, with topic and time, in order."""
    (file,) = bag.glob('*.mcap')
    with file.open('rb') as stream:
        found = make_reader(stream).iter_messages(log_time_order=False)
        return [(channel.topic, message.log_time, message.data) for _, channel, message in found]


@pytest.mark.parametrize(
    'module',
    [
        parallel_robot,
        *sorted({*parallel_robot.PLACES.values()} - {errors.__name__, c_law.__name__}),
    ],
)
def test_the_examples_of_the_docstrings_do_what_they_say(module, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = doctest.testmod(
        module if module is parallel_robot else importlib.import_module(module)
    )
    assert found.attempted > 0
    assert found.failed == 0


def test_a_run_is_the_simulation_of_the_command_line(run, tmp_path):
    words = ['paper_circle', '--law', 'smc', '--duration', '1', '--set', 'smc.z=25']
    assert command_line.main(['simulate', *words, '--out', str(tmp_path / 'bag')]) == 0
    log = recording.read(tmp_path / 'bag').log
    for ours, theirs in (
        (run.time, log.time),
        (run.position, log.position),
        (run.velocity, log.velocity),
        (run.reference, log.reference_position),
        (run.reference_velocity, log.reference_velocity),
        (run.torque, log.effort),
        (run.error, log.reference_position - log.position),
        (run.velocity_error, log.reference_velocity - log.velocity),
    ):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-12)
    assert run.values == log.config
    notebook.save(run, tmp_path / 'saved')
    assert messages(tmp_path / 'saved') == messages(tmp_path / 'bag')


def test_a_saved_run_comes_back(run, tmp_path):
    notebook.save(run, tmp_path / 'bag')
    loaded = notebook.load(tmp_path / 'bag')
    assert (loaded.scenario, loaded.law, loaded.joints) == (run.scenario, run.law, run.joints)
    np.testing.assert_array_equal(loaded.position, run.position)
    np.testing.assert_array_equal(loaded.torque, run.torque)
    np.testing.assert_allclose(loaded.pose_error, run.pose_error, atol=1e-9)
    ours, theirs = notebook.metrics(run), notebook.metrics(loaded)
    assert theirs['xy_rms_m'] == pytest.approx(ours['xy_rms_m'], rel=1e-6)
    assert (loaded.fault, loaded.limits) == (run.fault, run.limits)
    with pytest.raises(InputError, match='from a bag'):
        notebook.save(loaded, tmp_path / 'again')
    with pytest.raises(BagError, match='exist'):
        notebook.save(run, tmp_path / 'bag')
    assert not (tmp_path / 'again').exists()


def test_a_fault_is_told_by_the_run_and_by_its_bag(tmp_path):
    run = simulate('paper_circle', duration=1, **{'safety.speed_limit': 0.1})
    assert run.fault is not None
    assert 0.0 <= run.fault[0] < 1.0
    assert f'fault at t = {run.fault[0]:.3f} s: {run.fault[1]}' in repr(run)
    notebook.save(run, tmp_path / 'bag')
    time, text = notebook.load(tmp_path / 'bag').fault
    assert (time, text) == (pytest.approx(run.fault[0]), run.fault[1])


def test_files_of_parameters_stand_below_values(tmp_path):
    (tmp_path / 'one.yaml').write_text('smc: {z: 11.0}\nlaw: s_smc\n')
    (tmp_path / 'two.yaml').write_text('smc.z: 12.0\nduration: 0.1\n')
    files = [tmp_path / 'one.yaml', str(tmp_path / 'two.yaml')]
    run = simulate('paper_circle', param_file=files, law='smc')
    assert (run.values['smc.z'], run.law, run.time[-1]) == (12.0, 'smc', 0.1)
    run = simulate('paper_circle', param_file=tmp_path / 'two.yaml', **{'smc.z': np.float64(13)})
    assert (run.values['smc.z'], run.law) == (13.0, 's_fotsmc')


def test_a_run_without_a_duration_has_two_turns_of_the_circle():
    assert simulate('paper_circle').time[-1] == DURATION == 12.0


def test_a_motion_is_fitted_as_on_the_command_line(tmp_path, capsys):
    run = simulate('paper_circle', duration=0.05, fit_speed=0.5)
    words = ['paper_circle', '--duration', '0.05', '--fit-speed', '0.5', '--out']
    assert command_line.main(['simulate', *words, str(tmp_path / 'bag')]) == 0
    factor = run.values['trajectory.speed_factor']
    assert f'trajectory.speed_factor={factor:.6g}; at ' in capsys.readouterr().err
    with pytest.raises(InputError, match='share above 0, up to 1, not 2'):
        simulate('paper_circle', fit_speed=2)


def test_a_robot_that_moves_in_no_plane_has_metrics_and_a_picture():
    run = simulate('axes_step', duration=0.2)
    assert run.place == 0
    assert run.error.shape == (201, len(run.joints))
    assert np.isnan(notebook.metrics(run)['xy_rms_m'])
    assert notebook.plot(run)._repr_png_().startswith(b'\x89PNG')


@pytest.mark.parametrize(
    ('call', 'text'),
    [
        (lambda: simulate(3), 'scenario must be a name or a path, not 3'),
        (lambda: simulate('nowhere'), "unknown scenario 'nowhere'"),
        (lambda: simulate('paper_circle', law=3), 'law must be a name or a path, not 3'),
        (lambda: simulate('paper_circle', law='smcc'), "did you mean 'smc'"),
        (lambda: simulate('paper_circle', duration='long'), 'duration must be a number'),
        (lambda: simulate('paper_circle', duration=0), 'duration must be positive'),
        (lambda: simulate('paper_circle', smc={'z': 3}), "did you mean 'smc.z'"),
        (lambda: simulate('paper_circle', joints=3), 'joints must be a list'),
        (lambda: simulate('paper_circle', param_file=3), 'param_file must be a name or a path'),
        (lambda: simulate('paper_circle', param_file='no.yaml'), 'no.yaml does not exist'),
        (lambda: notebook.load('nowhere'), 'nowhere'),
        (lambda: notebook.load(None), 'bag must be a path, not None'),
        (lambda: parallel_robot.sweep('equal_effort', 3), 'out must be a path, not 3'),
        (lambda: notebook.metrics('bag'), "a run is wanted, as of simulate or load, not 'bag'"),
        (lambda: notebook.plot('a'), "plot takes runs, not 'a'"),
        (lambda: notebook.plot([]), 'plot takes up to 8 runs, not 0'),
        (lambda: notebook.grid('paper_circle', 'smc', {'smc.z': 3}), 'smc.z must have a list of'),
        (lambda: notebook.grid('paper_circle', 'smc', {'smc.zz': [3]}), "did you mean 'smc.z'"),
        (
            lambda: written_tables.laws('mine.py'),
            "custom_laws must be a list of files, not 'mine.py'",
        ),
        (lambda: written_tables.laws(['no.py']), 'no.py'),
        (lambda: parallel_robot.report(3, 'out'), 'a bag must be a path, not 3'),
        (lambda: parallel_robot.report([], 'out'), 'a bag is needed'),
        (lambda: parallel_robot.report('no', 'out'), 'no does not exist'),
        (lambda: parallel_robot.report('no', 'out', scale='x'), "unknown scale 'x'"),
        (lambda: parallel_robot.video('no', 'x.avi'), "unknown video format '.avi'"),
        (
            lambda: parallel_robot.video('no', 'x.gif', rate='5'),
            '--rate must be 1 to 100 Hz, not ',
        ),
        (lambda: parallel_robot.export('no', 'x.txt'), "unknown table format '.txt'"),
        (lambda: parallel_robot.export('no', 'x.csv'), 'no does not exist'),
        (lambda: parallel_robot.limit('nowhere'), "unknown scenario 'nowhere'"),
        (lambda: parallel_robot.limit('paper_circle', runs=2), '--runs is for studies'),
        (lambda: parallel_robot.limit('paper_circle', figure='x.txt'), 'picture format'),
        (lambda: parallel_robot.replay('no'), 'no does not exist'),
        (lambda: parallel_robot.replay('no', figure='x.txt'), 'picture format'),
        (lambda: parallel_robot.rerun('no'), 'no does not exist'),
        (lambda: parallel_robot.identify(3), 'a bag must be a path, not 3'),
        (lambda: parallel_robot.identify('no'), 'no does not exist'),
        (lambda: parallel_robot.identify('no', cutoff='5'), "a frequency in Hz, not '5'"),
        (lambda: parallel_robot.sensor_noise('no'), 'no does not exist'),
        (lambda: parallel_robot.exciting_motion('paper_circle'), '--design needs trajectory'),
        (lambda: parallel_robot.exciting_motion('excitation', trials=0), '--trials must be at'),
        (lambda: parallel_robot.tune('smcc', 'paper_circle', 'out'), "did you mean 'smc'"),
        (lambda: parallel_robot.tune('smc', 'nowhere', 'out'), "unknown scenario 'nowhere'"),
        (lambda: parallel_robot.tune('smc', 'paper_circle', 3), 'out must be a path, not 3'),
        (
            lambda: parallel_robot.tune('smc', 'paper_circle', 'out', trials=0),
            '--trials must be from 1',
        ),
        (
            lambda: parallel_robot.tune('smc', 'paper_circle', 'out', bounds='z=3'),
            'bounds must be names',
        ),
        (lambda: parallel_robot.tune('smc', 'paper_circle', 'out', bounds={'z': 'x'}), 'z'),
        (
            lambda: parallel_robot.tune('smc', 'paper_circle', 'out', weights={'x': 1}),
            "weight 'x'",
        ),
        (
            lambda: parallel_robot.tune('smc', 'paper_circle', 'out', search='a.b'),
            'a list of keys',
        ),
        (lambda: notebook.compare('ab'), "compare takes runs, not 'a'"),
        (lambda: notebook.compare(3), 'compare takes several runs'),
        (lambda: notebook.compare({'a': 3}), 'compare takes runs, not 3'),
        (
            lambda: parallel_robot.sweep(3, 'out'),
            'study must be a name, a path or keys and values',
        ),
        (lambda: parallel_robot.sweep('no', 'out'), "unknown study 'no'"),
        (lambda: parallel_robot.sweep({'a': object()}, 'out'), 'study must hold plain numbers'),
        (lambda: parallel_robot.sweep({'laws': ['smc']}, 'out'), 'study: scenarios is missing'),
        (
            lambda: parallel_robot.sweep(STUDY, 'out', workers=0),
            '--workers must be from 1 to 1024, not 0',
        ),
        (lambda: parallel_robot.sweep(STUDY, 'out', runs='2'), 'runs must be'),
    ],
)
def test_what_is_wrong_costs_one_clear_line(call, text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError) as error:
        call()
    assert text in str(error.value)
    assert '\n' not in str(error.value)
    assert not list(tmp_path.iterdir())


def test_a_run_says_in_few_lines_what_it_is(run):
    assert repr(run).startswith('Run of paper_circle, smc: 1 s, 1001 states of 3 joints, joint')
    assert len(repr(run).splitlines()) == 1
    assert repr(run) in run._repr_html_()


def test_names_from_a_bag_cannot_write_html(run):
    shown = replace(run, scenario='<script>', warnings=('\x1b[2J&',))._repr_html_()
    assert '<script>' not in shown
    assert '\x1b' not in shown
    assert '&lt;script&gt;' in shown


def test_runs_are_compared_in_a_table(run):
    other = simulate('paper_circle', law='smc', duration=1)
    found = notebook.compare([run, other])
    assert list(found.index) == ['smc', 'smc #2']
    assert found.loc['smc', 'xy_rms_m'] == notebook.metrics(run)['xy_rms_m']
    assert found.xy_rms_m.iloc[0] != found.xy_rms_m.iloc[1]
    assert list(notebook.compare({'z = 25': run}).index) == ['z = 25']


def test_metrics_are_shown_as_a_table(run):
    found = notebook.metrics(run)
    lines = repr(found).splitlines()
    assert lines[13].startswith('errors over the second half, 0.') and lines[1].split() == [
        'time',
        'to',
        '0.1',
        'mm',
        'never',
    ]
    shown = f'end-effector error, rms {1e6 * found["xy_rms_m"]:.0f} µm'
    assert ' '.join(lines[2].split()) == shown
    assert '<td>torque, chattering</td>' in found._repr_html_()
    axes = notebook.metrics(simulate('axes_step', duration=0.1))
    assert 'end-effector' not in repr(axes) and 'nan' not in repr(axes)


@pytest.mark.parametrize(
    ('scenario', 'changes'),
    [
        ('paper_circle', {}),
        ('axes_step', {}),
        ('paper_circle', {'sensor.delay': 0.002, 'sensor.position_noise': 1e-4}),
        ('serial_2r_circle', {'true_robot.m1': 4.0}),
    ],
)
def test_a_run_as_a_frame_has_the_columns_of_its_bag(scenario, changes, tmp_path):
    run = simulate(scenario, duration=0.1, **changes)
    notebook.save(run, tmp_path / 'bag')
    exported = parallel_robot.export(tmp_path / 'bag')
    loaded, made = notebook.load(tmp_path / 'bag').to_frame(), run.to_frame()
    assert list(loaded) == list(made) == list(exported) and len(made) == len(loaded) == 101
    assert bool(changes) == any('seen' in name for name in made)
    assert (made.stamp_ns == exported.stamp_ns).all()
    pandas.testing.assert_frame_equal(loaded, exported)
    late = {'time_s'} | {f'{joint}_effort_nm' for joint in run.joints}
    same = [name for name in exported if not ('sensor.delay' in changes and name in late)]
    np.testing.assert_allclose(
        made[same].where(exported[same].notna()), exported[same], rtol=0.0, atol=1e-9
    )


def test_runs_are_drawn_over_one_another(run):
    other = simulate('paper_circle', duration=1)
    drawn = notebook.plot([run, other, run]).figure
    (legend,) = drawn.legends
    assert [text.get_text() for text in legend.texts] == ['SMC', 'S-FOTSMC', 'SMC #2']
    (legend,) = notebook.plot({'z = 25': run, 5: other}).figure.legends
    assert [text.get_text() for text in legend.texts] == ['z = 25', '5']
    path, error, *_ = notebook.plot(run, scale='log').figure.axes
    assert (path.get_yscale(), error.get_yscale()) == ('linear', 'log')


def test_a_grid_has_a_row_for_each_combination():
    choices = {'smc.z': [10, np.float64(25)], 'smc.u': (0.2, 0.7)}
    found = notebook.grid('paper_circle', 'smc', choices, duration=0.1, **{'smc.G': 12})
    assert found[['smc.z', 'smc.u']].to_numpy().tolist() == [
        [10, 0.2], [10, 0.7], [25, 0.2], [25, 0.7]
    ]  # fmt: skip
    assert set(found.status) == {'ok'}
    alone = simulate(
        'paper_circle', law='smc', duration=0.1, **{'smc.z': 25, 'smc.u': 0.2, 'smc.G': 12}
    )
    assert found.torque_max_nm[2] == notebook.metrics(alone)['torque_max_nm']
    choices = {'safety.speed_limit': [0.1, 10]}
    found = notebook.grid('paper_circle', 'smc', choices, duration=0.1)
    assert found.status.tolist() == ['fault', 'ok'] and ' at t = 0.' in found.reason[0]


def test_a_picture_is_small_in_a_notebook_and_overwrites_nothing(run, tmp_path):
    picture = notebook.plot(run)
    assert len(picture._repr_png_()) < 100_000
    picture.save(tmp_path / 'run.pdf')
    before = (tmp_path / 'run.pdf').read_bytes()
    assert before.startswith(b'%PDF')
    with pytest.raises(InputError, match=r'run\.pdf'):
        picture.save(tmp_path / 'run.pdf')
    with pytest.raises(InputError, match='picture format'):
        picture.save(tmp_path / 'run.txt')
    assert (tmp_path / 'run.pdf').read_bytes() == before


def test_laws_and_scenarios_are_those_of_the_command_line(tmp_path):
    assert list(written_tables.scenarios().index) == config.scenarios()
    assert list(written_tables.laws().index) == list(LAWS)
    law = tmp_path / 'mine.py'
    law.write_text(f"TITLE = 'Mine'\n{LAW}")
    assert written_tables.laws([law]).loc['mine'].tolist() == ['Mine', '', ('Kp', 'Ki', 'Kd')]


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    bag = tmp_path_factory.mktemp('python') / 'bag'
    notebook.save(simulate('paper_circle', law='smc', duration=0.2), bag)
    return bag


@pytest.fixture(scope='module')
def excited(tmp_path_factory):
    bag = tmp_path_factory.mktemp('excited') / 'bag'
    notebook.save(simulate('excitation', law='pid', duration=3, **{'true_robot.mp': 4.0}), bag)
    return bag


def commanded(capsys, *words):
    """What a command prints."""
    assert command_line.main(list(map(str, words))) == 0
    return capsys.readouterr().out


def files(directory):
    """Content of all files below a directory, by path."""
    return {
        path.relative_to(directory): path.read_bytes()
        for path in directory.rglob('*')
        if path.is_file()
    }


SMALL = {'duration': 0.1, 'trials': 3, 'workers': 1}
FOUND = {'duration': 0.1, 'disturbance.noise': 0.1, 'sensor.resolution': 1e-5}
CALLS = {  # a call of the function of each command, beside the words of the command
    'benchmark': None,  # takes a minute; see test_benchmark
    'calibrate': None,  # see test_calibrate
    'export': (['{bag}', '--out', 'out.csv'], (), {'out': 'out.csv'}),
    'fronts': None,  # see test_fronts
    'identify': (
        ['{excited}', '--hold-out', '0.2', '--cutoff', '9', '--all', '--out', 'out.yaml'],
        ('{excited}',),
        {'hold_out': 0.2, 'cutoff': 9.0, 'all': True, 'out': 'out.yaml'},
    ),
    'limit': (
        ['axes_step', '--duration', '0.1', '--calm', '--out', 'out.csv', '--figure', 'out.svg',
         '--set', 'disturbance.noise=0.1', '--set', 'sensor.resolution=1e-5'],
        ('axes_step',),
        {'out': 'out.csv', 'figure': 'out.svg', **FOUND},
    ),
    'recover': (['{bag}', '--out', 'out'], ('{bag}', 'out'), {}),
    'replay': (
        ['{bag}', '--law', 'pid', '--set', 'pid.Kp=1000', '--figure', 'out.svg'],
        ('{bag}',),
        {'law': 'pid', 'figure': 'out.svg', 'pid.Kp': 1000},
    ),
    'report': (
        ['{bag}', '--out', 'out', '--scale', 'log'], ('{bag}', 'out'), {'scale': 'log'},
    ),
    'sweep': (['study.yaml', '--out', 'out', '--workers', '1'], (STUDY, 'out'), {'workers': 1}),
    'tune': (
        ['smc', 'paper_circle', '--duration', '0.1', '--trials', '3', '--workers', '1',
         '--weights', 'error=2,chattering=1', '--bounds', 'z=10:50', '--bounds', 'G=12',
         '--out', 'out'],
        ('smc', 'paper_circle', 'out'),
        {'weights': {'error': 2, 'chattering': 1}, 'bounds': {'z': (10, 50), 'G': 12}, **SMALL},
    ),
    'urdf': (['paper_circle', '--out', 'out.urdf'], ('paper_circle',), {'out': 'out.urdf'}),
    'verify': (['--set', 'robot_model=axes'], (), {'robot_model': 'axes'}),
    'video': (
        ['{bag}', '--out', 'out.gif', '--rate', '10', '--speed', '2'],
        ('{bag}', 'out.gif'),
        {'rate': 10, 'speed': 2},
    ),
}  # fmt: skip


@pytest.mark.usefixtures('inline', 'undrawn')
@pytest.mark.parametrize('command', [name for name, call in CALLS.items() if call])
def test_a_command_is_the_function_of_its_name(
    command, bag, excited, tmp_path, capsys, monkeypatch
):
    """They print and write the same."""
    monkeypatch.setattr('parallel_robot.analysis.report.report_files.FORMATS', ('svg',))
    words, places, values = CALLS[command]
    written, shown = [], []
    for kind in ('python', 'shell'):
        folder = tmp_path / kind
        folder.mkdir()
        monkeypatch.chdir(folder)
        (folder / 'study.yaml').write_text(yaml.safe_dump(STUDY, sort_keys=False))

        def filled(each):
            known = {'{bag}': str(bag), '{excited}': str(excited)}
            return known.get(each, each) if isinstance(each, str) else each

        if kind == 'shell':
            assert command_line.main([command, *map(filled, words)]) == 0
            shown.append(capsys.readouterr().out)
        else:
            offered = getattr(parallel_robot, command)
            function = getattr(offered, 'raw', offered)
            given = {name: filled(value) for name, value in values.items()}
            if command == 'export':
                given['bag'] = str(bag)
            found = function(*map(filled, places), **given)
            if command == 'export':  # a table in Python
                shown.append(f'table   out.csv, {len(found)} rows, {len(found.columns)} columns\n')
            elif isinstance(found, ShownResult):
                lines = found.file_lines() or ['figure  out.svg'] * (command == 'replay')
                shown.append('\n'.join([*found.lines(), *lines, '']))
            else:
                shown.append(str(found))
        written.append(
            {name: text for name, text in files(folder).items() if 'log' not in name.name}
        )
    assert shown[0] == shown[1]
    assert written[0].keys() == written[1].keys() and len(written[0]) > 1 - (command == 'verify')
    same = {name for name in written[0] if name.suffix not in ('.html', '.mcap', '.svg')}
    assert {name: written[0][name] for name in same} == {name: written[1][name] for name in same}


def test_every_command_of_a_function_is_compared_with_it():
    assert CALLS.keys() == {*command_line.FUNCTIONS}


def test_a_copy_for_viewers_is_that_of_the_command_line(bag, tmp_path, capsys):
    found = parallel_robot.export(bag, foxglove=tmp_path / 'ours')
    assert found.attrs['warnings'] == ()
    commanded(capsys, 'export', bag, '--foxglove', tmp_path / 'theirs')
    assert messages(tmp_path / 'ours') == messages(tmp_path / 'theirs')
    assert found.equals(parallel_robot.export(bag))


def test_least_errors_are_the_rows_of_the_command_line(tmp_path, capsys):
    found = parallel_robot.limit('axes_step', calm=True, out=tmp_path / 'limit.csv', **FOUND)
    assert capsys.readouterr() == ('', '') and len(found.attrs['warnings']) == 1
    pandas.testing.assert_frame_equal(pandas.read_csv(tmp_path / 'limit.csv'), found)


def test_a_replay_has_the_torques(bag):
    found = parallel_robot.replay(bag)
    assert found.differing == 0 == found.late
    np.testing.assert_array_equal(found.torque, found.recorded)
    other = parallel_robot.replay(bag, law='pid', **{'pid.Kp': 1000})
    assert other.torque.shape == other.recorded.shape == (201, 3) and other.differing == 201


def test_a_rerun_is_that_of_the_command_line(bag, tmp_path, capsys):
    found = parallel_robot.rerun(bag, tmp_path / 'ours')
    said = commanded(capsys, 'rerun', bag, '--out', tmp_path / 'theirs')
    assert found.identical and found.lines() == said.splitlines()[-1:]
    assert messages(found.bag) == messages(tmp_path / 'theirs')
    short = parallel_robot.rerun(bag, tmp_path / 'short', duration=0.1)
    assert repr(short).startswith(f'identical: {short.messages} messages, as far as both bags go')
    with pytest.raises(BagError, match='exists'):
        parallel_robot.rerun(bag, tmp_path / 'ours')


def test_an_identified_robot_can_be_simulated(excited, tmp_path, capsys):
    found = parallel_robot.identify(excited, out=tmp_path / 'ours.yaml')
    read = simulate('paper_circle', duration=0.01, param_file=tmp_path / 'ours.yaml').values
    assert found.values.items() <= read.items()
    words = ['identify', excited, '--format', 'json']
    assert json.loads(commanded(capsys, *words)) == found.as_data()
    with pytest.raises(BagError, match='no phase of rest'):
        parallel_robot.sensor_noise(excited)


def test_an_exciting_motion_is_that_of_the_command_line(tmp_path, capsys):
    ours, theirs = tmp_path / 'ours.yaml', tmp_path / 'theirs.yaml'
    motion = parallel_robot.exciting_motion('excitation', ours, trials=3, seed=1)
    words = ['--design', 'excitation', '--trials', 3, '--seed', 1, '--out', theirs]
    out = commanded(capsys, 'identify', *words)
    assert repr(motion) == '\n'.join(out.splitlines()[:-1])
    assert ours.read_bytes() == theirs.read_bytes()


@pytest.mark.usefixtures('inline', 'undrawn')
def test_tuned_gains_can_be_simulated(tmp_path):
    found = parallel_robot.tune('smc', 'paper_circle', tmp_path / 'ours', **SMALL)
    file = tmp_path / 'ours' / 'tuned.yaml'
    read = simulate('paper_circle', duration=0.01, param_file=file).values
    assert found.values.items() <= read.items()
    assert len(found.trials()) == 3 and found.front().chosen.sum() == 1
    assert not found.verdict.converged


def test_the_code_of_a_bag_runs_when_it_is_trusted(tmp_path, capsys):
    law, bag = tmp_path / 'mine.py', tmp_path / 'bag'
    law.write_text(LAW)
    notebook.save(simulate('paper_circle', law='mine', duration=0.02, custom_laws=[law]), bag)
    law.unlink()
    with pytest.raises(BagError, match='holds the code of the law mine'):
        parallel_robot.replay(bag)
    with pytest.raises(BagError, match='holds the code of the law mine'):
        parallel_robot.rerun(bag)
    assert parallel_robot.replay(bag, trust=True).differing == 0
    assert parallel_robot.rerun(bag, trust=True).identical
    assert capsys.readouterr() == ('', '')


@pytest.mark.usefixtures('inline')
def test_a_study_of_keys_and_values_is_swept(tmp_path):
    found = parallel_robot.sweep(STUDY, tmp_path / 'out', workers=1, **{'smc.z': 20})
    assert found.law.tolist() == ['smc', 's_smc'] * 2
    assert set(found.status) == {'ok'}
    row = found.iloc[0]
    alone = simulate(
        'paper_circle', law='smc', duration=0.1,
        **{'smc.z': 20, 'true_robot.mp': row['true_robot.mp']},
    )  # fmt: skip
    assert row.xy_rms_m == pytest.approx(notebook.metrics(alone)['xy_rms_m'], rel=1e-9)
    assert parallel_robot.sweep(STUDY, tmp_path / 'out', workers=1, **{'smc.z': 20}).equals(found)
    (law,) = set(parallel_robot.sweep(STUDY, tmp_path / 'one', laws=['s_smc'], workers=1).law)
    assert law == 's_smc'


def test_the_compiler_is_imported_only_when_it_is_needed():
    code = (
        'import sys, parallel_robot; assert not {"numba", "numpy"} & sys.modules.keys(); '
        'assert {"Run", "simulate", "load"} <= set(dir(parallel_robot)); '
        'from parallel_robot import simulate; assert "numba" in sys.modules'
    )
    subprocess.run([sys.executable, '-c', code], check=True, cwd=ROOT)


def test_what_is_offered_is_there():
    assert all(callable(getattr(parallel_robot, name)) for name in parallel_robot.__all__)
    with pytest.raises(AttributeError, match='nothing'):
        _ = parallel_robot.nothing


def test_nothing_warns(run):
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        notebook.plot(run)._repr_png_()
        notebook.compare([run])


@pytest.mark.endurance
@pytest.mark.usefixtures('inline')
def test_the_examples_of_the_page_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = (ROOT / 'docs' / 'python.md').read_text()
    code = re.findall(r'```python\n(.*?)```', text, re.DOTALL)
    assert len(code) == 5
    found = {}
    exec('\n'.join(code[:2]), found)
    assert found['run'].error.shape == (12001, 3)
    assert (tmp_path / 'run.pdf').is_file()
    assert found['pr'].load('runs/smc').law == 'smc'
    exec(code[2].replace("'runs': 16", "'runs': 1, 'duration': 0.1"), found)
    assert list(found['runs'].law) == ['smc', 's_fotsmc']
    short = code[3].replace('trials=40', 'trials=2, duration=0.1').replace('rate=5', 'rate=1')
    exec(short, found)
    assert len(found['frame']) == 12001 and found['tuned'].files['tuned.yaml'].is_file()
    with pytest.raises(InputError, match=re.escape(code[4].splitlines()[1].partition(': ')[2])):
        exec(code[4], found)


def test_every_function_is_on_the_page_and_has_an_example():
    text = (ROOT / 'docs' / 'python.md').read_text()
    for name in parallel_robot.__all__:
        if name[0].islower():
            assert f'pr.{name}(' in text, name
            assert f'pr.{name}(' in getattr(parallel_robot, name).__doc__, name
            assert importlib.util.find_spec(f'parallel_robot.{name}') is None


def test_every_array_of_a_run_is_on_the_page():
    text = (ROOT / 'docs' / 'python.md').read_text()
    names = [field.name for field in fields(Run)] + ['error', 'velocity_error', 'pose_error']
    assert all(f'`{name}`' in text for name in [*names, 'units'])


def test_a_bag_that_ended_early_says_so(tmp_path, capsys):
    """Figures of a start are of no law: 0.6 s of 12 s in Python, in a report, and by analyze."""
    made = simulate('paper_circle', duration=0.6).simulation
    bag = tmp_path / 'bag'
    simulation_bag.write(bag, {**made.configuration.values, 'duration': 12.0}, [made])
    told = 'ended early, after 0.6 s of 12 s'
    assert told in notebook.load(bag).warnings
    ((shown,),) = read_runs([bag]).values()
    assert told in shown.doubts
    assert command_line.main(['analyze', str(bag)]) == 0
    assert told in capsys.readouterr().out
    notebook.save(simulate('paper_circle', duration=0.6), tmp_path / 'whole')
    assert not any('early' in text for text in notebook.load(tmp_path / 'whole').warnings)


def test_a_spectrum_sums_to_the_variance_and_has_a_sine_at_its_frequency(run):
    t = run.time
    wave = 0.3 * np.sin(2.0 * np.pi * 50.0 * t)
    torque = np.column_stack([wave, np.random.default_rng(3).normal(0.0, 0.2, len(t)), 0.0 * t])
    density = parallel_robot.spectrum(replace(run, torque=torque), start=0.0, stop=1.0)
    sine, noise, nothing = (density[f'joint{k}_nm2_per_hz'] for k in (1, 2, 3))
    assert sine.idxmax() == pytest.approx(50.0, abs=0.1)
    step = density.index[1]
    assert sine.sum() * step == pytest.approx(0.3**2 / 2.0, rel=1e-2)
    assert noise.sum() * step == pytest.approx(torque[:, 1].var(), rel=0.25)
    assert not nothing.any()
    with pytest.raises(InputError, match="unknown of 'speed'"):
        parallel_robot.spectrum(run, 'speed')


def test_runs_keep_the_names_of_their_bags(run, tmp_path):
    for name in ('before', 'after'):
        parallel_robot.save(run, tmp_path / name)
    loaded = [parallel_robot.load(tmp_path / name) for name in ('before', 'after', 'after')]
    assert list(parallel_robot.compare([*loaded, run]).index) == [
        'before', 'after', 'after #2', 'smc',
    ]  # fmt: skip
    assert parallel_robot.load(next((tmp_path / 'before').glob('*.mcap'))).name == 'before_0'


@pytest.mark.parametrize(
    ('call', 'reason'),
    [
        (lambda: parallel_robot.verify(seed=-1), 'seed must not be negative, not -1'),
        (lambda: parallel_robot.verify(2.5), 'robots must be at least 1, not 2.5'),
        (lambda: parallel_robot.verify(duration=99), 'duration must be 0.001 to 10 s, not 99'),
        (lambda: parallel_robot.linearise('paper_circle', 3), 'pose must be a list of numbers'),
    ],
)
def test_numbers_that_cannot_be_are_one_line(call, reason):
    with pytest.raises(InputError, match=reason):
        call()
