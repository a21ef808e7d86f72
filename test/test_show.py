"""What show prints is what counts, and what it writes can be loaded again."""

import json
import re
from pathlib import Path

import pytest
import yaml

from parallel_robot.analysis.table import fields_of
from parallel_robot.cli.command_line import main
from parallel_robot_control.configuration import resolve
from parallel_robot_model.configuration import config, yaml_file

LAW = str(Path(__file__).parents[1] / 'docs' / 'example_law.py')


def shown(capsys, *words):
    assert main(['show', *words]) == 0
    out, err = capsys.readouterr()
    assert err == ''
    return out


def same(values, others):
    return {key: value for key, value in values.items() if key != 'scenario'} == {
        key: value for key, value in others.items() if key != 'scenario'
    }


@pytest.mark.parametrize('scenario', config.scenarios())
def test_the_scenario_it_writes_is_the_same_one(scenario, tmp_path, capsys):
    file = tmp_path / 'again.yaml'
    file.write_text(shown(capsys, scenario, '--format', 'yaml'))
    assert same(resolve(str(file)), resolve(scenario))
    assert shown(capsys, str(file), '--format', 'yaml').count('\n') == file.read_text().count('\n')


@pytest.mark.parametrize('form', ['yaml', 'ros'])
def test_with_changes_it_is_the_same_too(form, tmp_path, capsys):
    more = tmp_path / 'more.yaml'
    more.write_text('recorder.out: off and on\nrecorder.topics: ["1e6", "yes", "a#b: c"]\n')
    changes = {
        'robot.m1': 6.0, 'true_robot.m1': 5.12, 'robot.base_x': [0, 1, 0.5], 's_fotsmc.G': 1e-05,
        'law': 'example_law', 'example_law.Kp': 7e2, 'realtime': 'off',
    }  # fmt: skip
    words = [word for key, value in changes.items() for word in ('--set', f'{key}={value}')]
    code = ['--set', f'custom_laws=[{LAW}]']
    text = shown(
        capsys, 'heavy_circle', '--param-file', str(more), *words, *code, '--format', form
    )
    file = tmp_path / 'again.yaml'
    file.write_text(text)
    everything = {**changes, 'custom_laws': [LAW], 'recorder.out': 'off and on',
                  'recorder.topics': ['1e6', 'yes', 'a#b: c']}  # fmt: skip
    expected = resolve('heavy_circle', everything)
    if form == 'yaml':
        assert '# It needs --set custom_laws=[' in text
        again = resolve(str(file), {'custom_laws': [LAW]})
    else:
        (parameters,) = yaml.safe_load(text)['/**'].values()
        given = config.flat(parameters)
        assert all(len({*map(type, v)}) == 1 for v in given.values() if isinstance(v, list))
        again = resolve('heavy_circle', given)
        assert given.pop('custom_laws') and given['scenario'] == 'heavy_circle'
    assert same(again, expected)


def test_what_follows_still_follows(tmp_path, capsys):
    file = tmp_path / 'again.yaml'
    file.write_text(shown(capsys, 'heavy_circle', '--format', 'yaml'))
    values = config.resolve(str(file), {'robot.m1': 6.0, 'robot.l1': 0.41, 's_fotsmc.G': 12.0})
    assert (values['true_robot.m1'], values['true_robot.l1']) == (5.632, 0.41)
    assert values['preset'] == 'custom'


def test_the_file_for_ros_is_a_parameter_file_for_a_run(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = tmp_path / 'ros.yaml'
    file.write_text(shown(capsys, 'paper_circle', '--law', 'smc', '--format', 'ros'))
    assert yaml_file.read_parameter_file(file)['law'] == 'smc'
    words = ['--param-file', 'ros.yaml', '--duration', '0.05', '--set', 's_fotsmc.G=12']
    assert main(['simulate', 'paper_circle', *words, '--out', 'bag']) == 0


def test_the_table_names_value_unit_and_source(tmp_path, capsys):
    mine = tmp_path / 'mine.yaml'
    mine.write_text('base: heavy_circle\ncircle.radius: 0.02\nsmc.z: 21.0\n')
    more = tmp_path / 'more.yaml'
    more.write_text('line.duration: 3.0\nmonitor.window: 2.0\n')
    words = ['--param-file', str(more), '--set', 'monitor.window=3', '--set', 'realtime=off']
    words += ['--law', 'smc']
    lines = shown(capsys, str(mine), *words).splitlines()
    assert re.split('  +', lines[0]) == ['key', 'value', 'source']
    rows = {row[0]: row[1:] for row in (re.split('  +', line) for line in lines[1:])}
    values = config.resolve(str(mine))
    assert rows.keys() == values.keys() and len(rows) == len(lines) - 1
    expected = {
        'scenario': ['mine', str(mine)],
        'law': ['smc', '--law'],
        'realtime': ['off', '--set'],
        'period': ['0.001 s', 'defaults.yaml'],
        'circle.radius': ['0.02 m', str(mine)],
        'circle.center': ['[0.49, 0.37] m', 'scenarios/paper_circle.yaml'],
        'true_robot.m1': ['5.632 kg', 'scenarios/heavy_circle.yaml'],
        'true_robot.l1': ['0.4 m', 'from robot.l1'],
        'robot.l1': ['0.4 m', 'robots/planar_3rrr.yaml'],
        'pid.Kp': [rows['pid.Kp'][0], 'laws/pid.yaml'],
        'smc.z': [rows['smc.z'][0], str(mine)],
        'preset': ['custom', 'from smc.z'],
        'line.duration': ['3 s', str(more)],
        'monitor.window': ['3 s', '--set'],
    }
    assert {key: rows[key] for key in expected} == expected


def test_json_has_the_exact_values(capsys):
    found = json.loads(shown(capsys, 'axes_step', '--format', 'json'))
    assert {key: item['value'] for key, item in found.items()} == config.resolve('axes_step')
    assert found['robot.inertia'] == {
        'value': [0.12, 0.2, 0.28, 0.38, 0.5],
        'unit': 'kg m^2',
        'description': found['robot.inertia']['description'],
        'source': 'robots/axes.yaml',
    }
    assert found['robot.inertia']['description']


@pytest.mark.parametrize('scenario', ['paper_circle', 'axes_step', 'serial_2r_circle'])
def test_every_key_has_a_meaning(scenario):
    values = config.resolve(scenario)
    known = {key for key, field in fields_of(values).items() if field.description}
    assert {key for key in values if not key.startswith('recorder.')} <= known


def test_a_wrong_value_is_refused_as_in_a_run(capsys):
    assert main(['show', 'paper_circle', '--set', 'circle.radius=many']) == 2
    assert capsys.readouterr().err == (
        "parallel_robot show: circle.radius must be a number, not 'many'\n"
    )


def test_the_text_of_a_description_is_cut_for_people_and_whole_in_files(capsys, tmp_path):
    values = resolve('five_bar_circle')
    description = values['robot_description']
    assert main(['show', 'five_bar_circle']) == 0
    shown = capsys.readouterr().out
    assert f'({len(description)} characters)' in shown
    assert max(map(len, shown.splitlines())) < 400
    assert main(['show', 'five_bar_circle', '--format', 'json']) == 0
    told = json.loads(capsys.readouterr().out)
    assert told['robot_description']['value'] == description
    assert main(['show', 'five_bar_circle', '--format', 'yaml']) == 0
    file = tmp_path / 'mine.yaml'
    file.write_text(capsys.readouterr().out)
    again = resolve(str(file))
    assert {key: again[key] for key in values if key not in ('scenario', 'preset')} == {
        key: value for key, value in values.items() if key not in ('scenario', 'preset')
    }
