"""Bags of strangers: an answer or one line, in time and memory, and nothing touched.

HOSTILE_BAGS=all gives every bag to every command (an hour); otherwise each bag meets one of the
quick commands, half of them in make endurance, and some meet all.
"""

import json
import os
import struct
from contextlib import nullcontext
from pathlib import Path

import hostile_bags
import numpy as np
import pandas
import pytest
from bags import content, full_disk
from warm_process import WarmProcess

from parallel_robot.analysis import run_results
from parallel_robot.analysis.report import runs
from parallel_robot.bags import indexed_reader
from parallel_robot.bags.indexed_reader import BagReader
from parallel_robot.bags.limits import COPIES, RATIO, RECORD, Allowance
from parallel_robot.bags.run import recording
from parallel_robot.bags.writing import recovery
from parallel_robot.cli.command_line import main
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.messages.topics import CROSS_COUPLING_ERROR

ROOT = Path(__file__).parents[1]
EVERY = os.environ.get('HOSTILE_BAGS') == 'all'
SECONDS, GIGABYTES = 20.0, 4.0  # s of the processor: others may be busy, too
QUICK = ('export', 'recording', 'player', 'recover', 'rerun', 'replay')
FOR_ALL = (
    'good', 'zstd bomb', 'pipe in it',
    'config: brackets', 'config: merge keys', 'commands of four', 'five joints', 'empty chunk',
    'joint_states stamps all equal', 'joint_states position nan 7', 'attachment: NUL',
)  # fmt: skip
SLOW = {
    'analyze': (*FOR_ALL[1:], 'joint that is mathematics', 'joints with long names',
        'reference stamps largest',
                "'trajectory.shape': [1]", 'joint_states effort 1e+155 1', 'cut 37'),
    'other law': (
        'reference stamps zero', "'plant.torque_limit': [1, 2]", 'joint that is an escape',
        'change: list', 'joint_states velocity 1e+308 7'),
    'report': ('joint_states position inf 7', "'trajectory.shape': 'spiral'"),
}  # fmt: skip


@pytest.fixture(scope='module')
def good(tmp_path_factory):
    return hostile_bags.make(tmp_path_factory.mktemp('good') / 'bag')


@pytest.fixture
def make(good, tmp_path):
    """Function that makes one bag of a kind."""

    def make(name):
        hostile_bags.write(name, good, tmp_path / 'bag')
        return tmp_path / 'bag'

    return make


def chosen(command, half):
    """Names of the bags that a command meets."""
    names = hostile_bags.names()
    if EVERY:
        return names
    if command in SLOW:
        return SLOW[command]
    begin = QUICK.index(command) + half * len(QUICK)
    return (*(() if half else FOR_ALL), *names[begin :: 2 * len(QUICK)])


def contents(directory):
    """Every path below a directory, and how large it is."""
    return {path: path.lstat().st_size for path in directory.rglob('*')}


def answers(command, bags, out):
    """What the command says of each bag; what is not said is why its process ended."""
    files = [out.with_name(name) for name in ('stdout', 'stderr')]
    for file in files:
        file.touch()
    path = os.pathsep.join((str(ROOT), str(ROOT / 'test')))
    environment = {**os.environ, 'PYTHONPATH': path, 'TMPDIR': str(out)}
    words = [command, str(SECONDS), str(GIGABYTES), str(out), *map(str, bags)]
    code = WarmProcess('hostile_reader', words, out, environment, files).wait()
    said, errors = (file.read_text() for file in files)
    lines = [json.loads(line) for line in said.splitlines() if line[:2] == '["']
    found = [value for kind, value in lines if kind == 'end']
    assert code == 0 and len(found) == len(bags), (
        f'{command} ended with {code} at {bags[len(found)]}: {errors[-2000:]}'
    )
    return found


def faults(answer):
    """What is wrong with an answer."""
    said = answer['err'].splitlines()
    errors = [line for line in said if not line.startswith(('warning: ', 'runs the code of '))]
    found = []
    if answer['code'] not in (0, 1, 2) or answer['trace']:
        found.append(answer['trace'][-1500:] or f'exit code {answer["code"]}')
    if len(errors) != (answer['code'] == 2) and not (answer['code'] == 1 and len(errors) < 2):
        found.append(f'exit code {answer["code"]}, but {errors}')
    if not (answer['out'] + answer['err']).replace('\n', '').isprintable():
        found.append(f'control characters: {answer["out"] + answer["err"]!r}')
    if answer['seconds'] > SECONDS or answer['peak'] > GIGABYTES:
        found.append(f'{answer["seconds"]:.0f} s of processor time, {answer["peak"]:.1f} GB')
    return found


@pytest.mark.parametrize(
    ('command', 'half'),
    [
        *((command, 0) for command in (*QUICK, *SLOW)),
        *(pytest.param(command, 1, marks=pytest.mark.endurance) for command in QUICK),
    ],
)
def test_an_answer_or_one_line(command, half, good, tmp_path):
    names = list(dict.fromkeys(chosen(command, half)))
    (tmp_path / 'bags').mkdir()
    (tmp_path / 'out').mkdir()
    bags = [tmp_path / 'bags' / f'{k:04}' for k in range(len(names))]
    for name, bag in zip(names, bags, strict=True):
        hostile_bags.write(name, good, bag)
    before = contents(tmp_path / 'bags')
    found = answers(command, bags, tmp_path / 'out')
    wrong = {name: faults(each) for name, each in zip(names, found, strict=True) if faults(each)}
    assert not wrong, json.dumps(wrong, indent=1)
    assert contents(tmp_path / 'bags') == before


LEGAL = (
    'by hand', 'empty chunk', 'empty zstd chunk', 'empty lz4 chunk', 'schema twice', 'split',
    'in a namespace', 'packed', 'pipe beside it',
    'attachment: NUL', 'attachment: very long', "stamp of a change '²'", 'no index',
)  # fmt: skip


@pytest.mark.parametrize('name', LEGAL)
def test_what_is_legal_or_does_no_harm_is_read_as_it_is(name, make, good, tmp_path):
    hostile_bags.put(good, tmp_path / 'good')
    bag, expected = make(name), recording.read(tmp_path / 'good').log
    log, past, _ = recording.read(bag)
    assert np.array_equal(log.position, expected.position)
    assert np.array_equal(log.answer, expected.answer)
    assert not any(past.sources.values()) and past.changes == ()


@pytest.mark.parametrize('name', ['empty chunk', 'empty zstd chunk', 'short chunk', 'split'])
def test_the_player_reads_it_too(name, make, good):
    reader = BagReader(make(name))
    messages = list(reader.messages(reader.topics, 0))
    expected = sorted((name, time, data) for name, time, data in good.messages)
    assert sorted((m.topic[1:], m.log_time, m.data) for m in messages) == expected


def test_recover_keeps_what_it_has_when_its_last_look_fails(make, tmp_path, monkeypatch):
    """Commands of another length, once an IndexError; and whatever nobody thought of."""
    recovery.recover(make('commands of four'), tmp_path / 'four')
    assert list((tmp_path / 'four').glob('*.mcap'))
    monkeypatch.setattr(recording, 'chunks', lambda *_, **__: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        recovery.recover(tmp_path / 'four', tmp_path / 'again')
    messages = [content(next((tmp_path / name).glob('*.mcap'))) for name in ('four', 'again')]
    assert messages[0] == messages[1]


@pytest.mark.parametrize('name', ['packed', 'split', 'in a namespace', 'unclosed'])
def test_a_report_reads_what_analyze_reads(name, make, good, tmp_path):
    hostile_bags.put(good, tmp_path / 'good')
    if name == 'unclosed':
        hostile_bags.put(good, tmp_path / 'bag', data=good.data[:-100])
    bag = tmp_path / 'bag' if name == 'unclosed' else make(name)
    read = [recording.read(path, (CROSS_COUPLING_ERROR,)) for path in (tmp_path / 'good', bag)]
    found = [
        run_results.cross_coupling_of(log, extra[CROSS_COUPLING_ERROR]) for log, _, extra in read
    ]
    assert len(found[0].time) == 7
    assert np.array_equal(found[0].time, found[1].time)
    assert np.array_equal(found[0].values, found[1].values)
    assert [*runs.read_runs([bag])] == ['paper_circle']


EMPTY_CHUNK = b'\6' + struct.pack('<4Q2IQ', 40, 0, 0, 0, 0, 0, 0)


@pytest.mark.parametrize('name', ['cut', 'cut in the index', 'empty chunk', 'twice', 'flipped'])
def test_windows_of_a_bag_without_its_end_are_the_whole_of_it(name, good, tmp_path, monkeypatch):
    monkeypatch.setattr(indexed_reader, 'LARGE', 1)
    cut = good.data[: len(good.data) * 2 // 3]
    data = {
        'cut': cut,
        'cut in the index': good.data[:-500],
        'empty chunk': cut[:8] + EMPTY_CHUNK + cut[8:],
        'twice': cut + good.data,
        'flipped': cut[: len(cut) // 2]
        + bytes([cut[len(cut) // 2] ^ 1])
        + cut[len(cut) // 2 + 1 :],
    }[name]
    hostile_bags.put(good, tmp_path / 'bag', data=data)
    whole = recording.read(tmp_path / 'bag').log
    windows = [window.log for window in recording.chunks(tmp_path / 'bag', 0.013)]
    damaged = pytest.raises(BagError, match='cut off')
    with damaged if name in ('twice', 'flipped') else nullcontext():
        assert BagReader(tmp_path / 'bag', make_index=True).counts['/joint_states'] == len(
            whole.time
        )
    for values in ('stamps', 'time', 'position', 'effort', 'answer'):
        found = np.concatenate([getattr(window, values) for window in windows])
        assert np.array_equal(found, getattr(whole, values), equal_nan=True)


def test_analyze_overwrites_nothing(good, tmp_path, capsys):
    hostile_bags.put(good, tmp_path / 'bag')
    words = ['analyze', str(tmp_path / 'bag')]
    assert main(words) == 0
    picture = tmp_path / 'bag' / 'run.png'
    assert picture.read_bytes().startswith(b'\x89PNG')
    picture.write_text('mine')
    capsys.readouterr()
    assert main(words) == 0
    assert f'figure  {picture} exists and is kept; --figure' in capsys.readouterr().out
    (tmp_path / 'run.json').write_text('mine')
    for option, path in (('--figure', picture), ('--json', tmp_path / 'run.json')):
        assert main([*words, option, str(path)]) == 2
        assert 'exists; nothing is overwritten, choose another' in capsys.readouterr().err
        assert path.read_text() == 'mine'


@pytest.mark.parametrize('words', [[], ['--json', 'run.json']])
def test_a_full_disk_is_named_and_leaves_nothing(words, good, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    hostile_bags.put(good, tmp_path / 'bag')
    with full_disk(10_000):
        assert main(['analyze', 'bag', *words]) == 2
    assert 'cannot write bag/run.png: File too large' in capsys.readouterr().err
    assert [path.name for path in tmp_path.rglob('*')] == ['bag', 'bag_0.mcap']


def test_a_column_is_no_formula(make, tmp_path):
    """A spreadsheet shows it; others read the names with an apostrophe before them."""
    out = tmp_path / 'run.csv'
    assert main(['export', str(make('joint that is a formula')), '--out', str(out)]) == 0
    table = pandas.read_csv(out)
    names = ("'=cmd|'/C calc'!A0", "'+1", "'@a")
    assert [f'{name}_position_rad' for name in names] == [*table.columns[2:5]]
    assert len(table) == 61 and not any(cell[0] in '=+@\t\r' for cell in table.columns)


def test_escape_sequences_stay_off_the_terminal(make, capsys, tmp_path):
    bag = make('topic with escapes')
    assert main(['recover', str(bag), '--out', str(tmp_path / 'out')]) == 0
    cut = next((tmp_path / 'out').glob('*.mcap'))
    cut.write_bytes(cut.read_bytes()[:8] + bytes(1))
    assert main(['analyze', str(tmp_path / 'out')]) == 2
    out, err = capsys.readouterr()
    assert (out + err).replace('\n', '').isprintable()


def test_a_bag_takes_so_much_memory(good, tmp_path):
    more = [message for message in good.messages if message[0] == 'reference'] * 800
    data = hostile_bags.bag(good, messages=[*good.messages, *more])
    hostile_bags.put(good, tmp_path / 'bag', data=data)
    with pytest.raises(BagError, match=r'takes more than 0.01 GB of memory$'):
        recording.read(tmp_path / 'bag', memory=round(0.01 * (1 << 30)))
    assert len(recording.read(tmp_path / 'bag', memory=round(0.1 * (1 << 30))).log.stamps)


def test_a_rerun_is_not_far_longer_than_the_run(good, tmp_path, capsys):
    data = hostile_bags.configured(good, duration=1e4)
    hostile_bags.put(good, tmp_path / 'bag', data=data)
    assert main(['rerun', str(tmp_path / 'bag')]) == 2
    assert 'holds 61 states of 10000000' in capsys.readouterr().err
    assert not (tmp_path / 'bag_rerun').exists()


def test_what_is_paid_for():
    allowance = Allowance(Path('bag'), 1 << 30, 1 << 20)
    allowance.unpack(RATIO << 30)
    with pytest.raises(BagError, match='bag unpacks to more than 200 times its size'):
        allowance.unpack(1)
    allowance.walk((1 << 30) // RECORD)
    with pytest.raises(BagError, match='far more records'):
        allowance.walk(1)
    allowance.hold((1 << 20) // COPIES)
    with pytest.raises(BagError, match='of memory'):
        allowance.hold(1)
