"""``--format``: every command says the same as text, Markdown, LaTeX and JSON."""

import json
import math
import re
import shutil
from types import SimpleNamespace

import numpy as np
import pandas
import pytest
from bags import content, write_foreign
from mcap.reader import make_reader
from table_readers import latex_tables, markdown_tables
from test_fronts import tuning

import parallel_robot as pr
from parallel_robot.analysis.readable_metrics import titled
from parallel_robot.cli.command_line import main
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.tables import Table
from parallel_robot_model.messages.topics import JOINT_STATES

pytest_plugins = ['sweeping']

STUDY = """
scenarios: [paper_circle]
laws: [smc, pid]
runs: 2
duration: 0.1
uncertainty:
  true_robot.m1: {distribution: uniform, relative: 0.2}
"""
FIGURE = r'[-+]?\d+\.?\d*(?:e[-+]\d+)?'
WORDS = {  # command to its words; {0} is another place for each call
    'simulate': 'simulate paper_circle --law smc --duration 0.2 --out {0}',
    'analyze': 'analyze {bag} --figure {0}.png',
    'analyze joints alone': 'analyze {alone}',
    'compare': 'compare paper_circle --laws smc pid --duration 0.2',
    'limit': 'limit axes_step --duration 1 --set disturbance.noise=0.1',
    'tune': 'tune smc paper_circle --out {same} --duration 0.1 --trials 2 --workers 1 '
    '--bounds z=10:50 --bounds G=12',
    'sweep': 'sweep {study} --out {same} --workers 1',
    'identify': 'identify {excited}',
    'calibrate': 'calibrate {serial} --poses {poses}',
    'replay': 'replay {bag} --set smc.z=20 --figure {0}.png',
    'recover': 'recover {broken} --out {0}',
    'identify --design': 'identify --design excitation --trials 3 --out {0}',
    'calibrate --design': 'calibrate --scenario serial_2r_circle --design 4',
    'fronts': 'fronts {tuned} --out {0}.png',
    'verify': 'verify --set robot_model=axes',
    'show': 'show axes_step',
}


@pytest.fixture(scope='module')
def places(tmp_path_factory):
    """Bags and files for the commands; one name is hostile."""
    folder = tmp_path_factory.mktemp('format')
    names = 'a_bag & 100 %|$x$', 'alone', 'excited', 'serial', 'broken', 'poses.csv', 'study.yaml'
    bag, alone, excited, serial, broken, poses, study = (folder / name for name in names)
    pr.save(pr.simulate('paper_circle', law='smc', duration=0.2), bag)
    pr.save(pr.simulate('excitation', law='pid', duration=3, **{'true_robot.mp': 4.0}), excited)
    run = pr.simulate('serial_2r_circle', duration=3)
    pr.save(run, serial)
    rows = np.column_stack([run.time, run.pose])[::100]
    np.savetxt(poses, rows, '%.9f', ',', header='t,x,y', comments='')
    [file] = bag.glob('*.mcap')
    write_foreign(alone, {JOINT_STATES: content(file)[JOINT_STATES.name]})
    shutil.copytree(serial, broken)
    [file] = broken.glob('*.mcap')
    data = bytearray(file.read_bytes())
    with file.open('rb') as stream:
        chunk = make_reader(stream).get_summary().chunk_indexes[1]
    data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 1
    file.write_bytes(data)
    study.write_text(STUDY)
    return SimpleNamespace(**{
        'bag': bag, 'alone': alone, 'excited': excited, 'serial': serial, 'broken': broken,
        'poses': poses, 'study': study, 'tuned': tuning(folder, 'tuned'),
    })  # fmt: skip


def printed(command, form, places, folder, capsys):
    """What a command prints in a format."""
    here = {'same': folder / 'same', **vars(places)}
    words = [word.format(folder / form, **here) for word in WORDS[command].split()]
    capsys.readouterr()
    assert main([*words, '--format', form]) == 0
    return capsys.readouterr().out


def numbers(data):
    """All numbers in plain data."""
    if isinstance(data, dict | list):
        return [each for one in (data.values() if isinstance(data, dict) else data)
                for each in numbers(one)]  # fmt: skip
    return [float(data)] if isinstance(data, int | float) else []


def is_among(cell, known):
    """Whether the number of a cell is one of those of JSON, in SI units, % or millionths."""
    digits = re.fullmatch(r'[-+]?(\d*)\.?(\d*)(?:e([-+]\d+))?', cell)
    half = 0.5001 * 10.0 ** (int(digits[3] or 0) - len(digits[2]))
    half = max(half, 0.0005001 * abs(float(cell)))  # 10940 stands for four digits
    values = [scale * value for value in known for scale in (1.0, 1e2, 1e6)]
    return any(abs(float(cell) - value) <= half for value in values)


@pytest.mark.usefixtures('inline', 'undrawn')
@pytest.mark.parametrize('command', WORDS)
def test_a_command_says_the_same_in_every_format(command, places, tmp_path, capsys):
    found = {
        form: printed(command, form, places, tmp_path, capsys)
        for form in ('text', 'json', 'markdown', 'latex')
    }
    written = markdown_tables(found['markdown'])
    assert written and all(len(table) > 2 for table in written)
    typeset = [[table[0], *table[1:]] for table in latex_tables(found['latex'])]
    named = titled(Table(table[1], table[2:]) for table in written)
    assert [
        [[cell.replace('+-', '±') for cell in row] for row in (*table[:2], *of.rows)]
        for table, of in zip(written, named, strict=True)
    ] == [[list(row) for row in table] for table in typeset]
    known = numbers(json.loads(found['json']))
    cells = [cell for table in written for row in table[2:] for cell in row[1:]]
    found_figures = (re.match(rf'({FIGURE})(?: \[|$)', cell) for cell in cells)
    figures = [each[1] for each in found_figures if each]
    assert figures and all(is_among(cell, known) for cell in figures), figures
    if command != 'show':  # where text cuts no column
        words = ' '.join(found['text'].split())
        assert all(' '.join(cell.split()) in words for cell in cells)
    assert str(tmp_path) not in found['markdown'] + found['latex'] + found['json']


def test_the_metrics_are_those_of_json_by_name(places, tmp_path, capsys):
    data = json.loads(printed('analyze', 'json', places, tmp_path, capsys))
    first, messages = markdown_tables(printed('analyze', 'markdown', places, tmp_path, capsys))
    rows = {name: (float(value), unit) for name, value, unit in first[2:]}
    error = 1e6 * data['steady']['xy_rms_m']
    assert rows['end-effector error, rms'] == (pytest.approx(error, abs=5e-4), 'µm')
    assert rows['torque, chattering'][1] == 'N m'
    count = {name: int(number) for name, number, _ in messages[2:]}
    assert count == {name: each['count'] for name, each in data['messages'].items()}


def test_pandas_reads_the_markdown(places, tmp_path, capsys):
    text = printed('compare', 'markdown', places, tmp_path, capsys)
    lines = [line.strip('|') for line in text.splitlines() if line.startswith('|')]
    file = tmp_path / 'table.csv'
    file.write_text('\n'.join([lines[0], *lines[2:]]).replace('\\', ''))
    frame = pandas.read_csv(file, sep='|', skipinitialspace=True).rename(columns=str.strip)
    data = json.loads(printed('compare', 'json', places, tmp_path, capsys))
    assert [law.strip() for law in frame.law] == [*data['laws']]
    wanted = [1e6 * each['steady']['xy_rms_m'] for each in data['laws'].values()]
    assert frame['rms [µm]'].tolist() == pytest.approx(wanted, rel=1e-3)


def test_a_law_that_fails_keeps_its_row(capsys):
    words = ['compare', 'paper_circle', '--laws', 'smc', 's_smc', '--duration', '1']
    words += ['--set', 'safety.speed_limit=[10, 0.09, 10]', '--format', 'latex']
    assert main(words) == 0
    ((sides, _, *rows),) = latex_tables(capsys.readouterr().out)
    ((law, why),) = [row for row in rows if len(row) == 2]
    assert {row[0] for row in rows} == {'SMC', 'S-SMC'} and law in ('SMC', 'S-SMC')
    assert why.startswith('no figures: ') and len(sides) > 2 and len(rows) == 2


def test_gains_that_are_those_of_another_robot_are_told(capsys):
    words = ['compare', 'serial_2r_circle', '--laws', 'smc', 'pid', '--duration', '0.1']
    told = 'warning: {}: gains of the 3-RRR, not of this robot; tune finds its own\n'
    for more, laws in (([], 'smc, pid'), (['--set', 'pid.Kp=900'], 'smc')):
        assert main([*words, *more]) == 0
        assert told.format(laws) in capsys.readouterr().err
    assert main(['compare', 'paper_circle', *words[2:]]) == 0
    assert 'gains of' not in capsys.readouterr().err


@pytest.mark.parametrize('command', WORDS)
def test_an_unknown_format_costs_one_line(command, places, tmp_path, capsys):
    here = {'same': tmp_path / 'same', **vars(places)}
    words = [word.format(tmp_path / 'out', **here) for word in WORDS[command].split()]
    assert main([*words, '--format', 'latx']) == 2
    out, err = capsys.readouterr()
    name = words[0]
    assert out == '' and not list(tmp_path.iterdir())
    assert err.startswith(f"parallel_robot {name}: --format: unknown value 'latx'; did you mean")
    assert err.count('\n') == 1 and "'latex'" in err


def test_results_of_python_are_written_as_those_of_the_command(places, tmp_path, capsys):
    printed_text = printed('calibrate', 'latex', places, tmp_path, capsys)
    found = pr.calibrate(places.serial, poses=places.poses)
    assert pr.table(found, 'latex') + '\n' == printed_text
    assert pr.table(found) == '\n'.join(found.lines())
    assert markdown_tables(found._repr_markdown_()) == markdown_tables(pr.table(found, 'markdown'))
    run = pr.load(places.bag)
    metrics = pr.metrics(run)
    ((_, head, *rows),) = markdown_tables(pr.table(metrics, 'markdown'))
    assert head == ['metric', 'value', 'unit']
    assert [' '.join(row).strip() for row in rows] == [
        ' '.join(line.split()) for line in repr(metrics).splitlines()[: len(rows)]
    ]


def test_a_frame_has_units_in_its_head(places):
    frame = pr.compare({'a_bag & 100 %|$x$': pr.load(places.bag), 'b': pr.load(places.bag)})
    ((sides, head, *rows),) = markdown_tables(pr.table(frame, 'markdown'))
    assert head[:4] == ['', 'scenario', 'law', 'duration [s]'] and sides[:4] == 'lllr'
    assert rows[0][0] == 'a_bag & 100 %|$x$' and len(rows) == 2
    values = dict(zip(head, rows[0], strict=True))
    assert float(values['xy rms [µm]']) == pytest.approx(1e6 * frame.xy_rms_m.iloc[0], rel=1e-5)
    assert values['torque total variation [N m/s]'] and values['to 0 1 mm [s]'] == 'never'
    (named,) = titled([Table(head, rows)])
    assert latex_tables(pr.table(frame, 'latex'))[0][1:] == [head, *named.rows]


def test_names_of_columns_and_index_are_escaped_too():
    frame = pandas.DataFrame({'_A': [1, 2], '50%': ['a', None], 'smc.z_s': [0.5, math.nan]})
    found = latex_tables(pr.table(frame.set_index('_A'), 'latex'))
    assert found == [['rlr', ['A', '50%', 'smc.z [s]'], ['1', 'a', '0.5'], ['2', '', '']]]
    several = frame.groupby(['_A', '50%'])[['smc.z_s']].agg(['min', 'max'])
    ((_, head, *_),) = markdown_tables(pr.table(several, 'markdown'))
    assert head == ['A', '50%', 'smc.z_s, min', 'smc.z_s, max']


@pytest.mark.parametrize(
    ('call', 'reason'),
    [
        (
            lambda: pr.table(pandas.DataFrame(), 'latx'),
            "unknown format 'latx'; did you mean 'late",
        ),
        (lambda: pr.table([1, 2]), 'a table is of a result, .* not of list'),
    ],
)
def test_what_has_no_table_costs_one_line(call, reason):
    with pytest.raises(InputError, match=reason):
        call()


def test_a_rerun_is_told_in_every_format(places, tmp_path, capsys):
    for form in ('json', 'markdown', 'latex'):
        words = ['rerun', str(places.bag), '--out', str(tmp_path / form), '--format', form]
        assert main(words) == 0
        out = capsys.readouterr().out
        if form == 'json':
            found = json.loads(out)
            assert found['identical'] and found['difference'] is None
        assert f'{found["messages"]}' in out and str(tmp_path) not in out
