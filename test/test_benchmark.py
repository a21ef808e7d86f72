"""The benchmark: its conditions, its scores, its directory, and the check of a score."""

import hashlib
import itertools
import json
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import small_protocol
import yaml
from foreign_laws import compiled
from sweeping import Inline

import parallel_robot as pr
from parallel_robot.cli.command_line import main
from parallel_robot.studies import least_errors
from parallel_robot.studies.benchmark import benchmark, judged_runs
from parallel_robot.studies.benchmark.benchmark import benchmarked, differences
from parallel_robot.studies.benchmark.judged_runs import competitors
from parallel_robot.studies.benchmark.protocol import conditions, planned, read, rows, seed_from
from parallel_robot.studies.benchmark.scores import RunFigures, ScoredRun, score, summarised
from parallel_robot.studies.calm import Calm
from parallel_robot.studies.sweep.study import Variant
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import config

CALM = Calm(np.array([0.1, 0.4]), np.array([8e-6, 2e-6]))


@pytest.fixture(scope='module')
def protocol_file(tmp_path_factory):
    """That of the arm, with one age."""
    path = tmp_path_factory.mktemp('protocol') / 'small.yaml'
    return small_protocol.written(path, 'serial_2r', trials=2, ages=['told'])


def judged(protocol_file, out, *laws):
    return benchmarked(read(str(protocol_file)), None, competitors(laws), out, Inline)


@pytest.fixture(scope='module')
def whole(protocol_file, tmp_path_factory):
    """A benchmark of two laws that ran through, and its directory."""
    out = tmp_path_factory.mktemp('benchmark') / 'whole'
    return judged(protocol_file, out, 'pid', 'computed_torque'), out


def test_every_pair_of_levels_meets_equally_often_in_a_scramble():
    protocol = read()
    for robot in protocol.robots:
        found = [each for each in conditions(protocol) if each.robot is robot]
        assert len(found) == 54
        for scramble in range(protocol.scrambles):
            levels = [
                (each.motion, each.speed, each.mix, each.age)
                for each in found
                if scramble in each.samples
            ]
            assert len(levels) == 18
            for a, b in itertools.combinations(range(4), 2):
                pairs = Counter((level[a], level[b]) for level in levels)
                assert len(set(pairs.values())) == 1, pairs
        # Each sample of a scramble is used once, and the numbers have no gap.
        for scramble in range(protocol.scrambles):
            numbers = [e.samples[scramble] for e in found if scramble in e.samples]
            assert sorted(numbers) == list(range(18))
    every = list(conditions(protocol))
    assert [e.first for e in every] == [0, *np.cumsum([len(e.samples) for e in every])[:-1]]


def test_a_score_is_the_limit_at_the_chattering_of_the_run_over_its_error():
    def of(chattering, error, status='ok'):
        return score(RunFigures(status, '', error, chattering), CALM)

    assert of(0.2, 8e-6) == pytest.approx(0.5)  # halfway between in logarithms: 4 um
    assert of(9.0, 4e-6) == pytest.approx(0.5)  # busier than all: the least error
    assert of(0.01, 16e-6) == pytest.approx(0.5)  # calmer than all: that of the calmest
    assert of(0.2, 4e-6, 'fault') == of(0.2, float('nan'), 'failed') == 0.0
    assert score(RunFigures('ok', '', 1e-6, 0.2), None) == 0.0


def test_intervals_are_those_between_scrambles_and_failures_are_told():
    scores = np.array([[0.2, 0.4, 0.6], [0.3, 0.5, 1.1], [0.0, 0.4, 0.5]])
    runs = [
        ScoredRun({}, k, value, RunFigures('ok' if value else 'fault', '', 1.0, 0.3, 2.0, 5.0))
        for k, of_scramble in enumerate(scores)
        for value in of_scramble
    ]
    found = summarised(runs)
    assert (found.runs, found.failed, found.below) == (9, 1, 1)
    assert found.median.value == pytest.approx(0.4)
    medians = np.median(scores, axis=1)
    half = 4.302653 * np.sqrt(np.sum((medians - 0.4) ** 2) / 2) / np.sqrt(3)  # t(0.975, 2)
    assert found.median.high == pytest.approx(0.4 + half, rel=1e-6)
    assert found.tail.value == pytest.approx(np.quantile(scores, 0.05))
    assert 0.0 <= found.tail.low <= found.tail.high <= 1.0


def test_a_run_is_that_of_simulate_against_the_limit_of_its_robot(whole, protocol_file):
    scores, _ = whole
    protocol = read(str(protocol_file))
    condition = next(c for c in conditions(protocol) if c.mix == 'friction' and len(c.samples))
    plan = planned(condition, protocol, [Variant('pid', 'pid', {})], {})
    row = rows(condition, plan, 0)[0]
    run = pr.simulate(row.scenario, **row.overrides)
    metrics = pr.metrics(run)
    found = scores.runs['pid']['default'][condition.first]
    assert found.figures.error == metrics['xy_rms_m']
    assert found.figures.chattering == metrics['chattering_nm']
    limits = least_errors.compute(row.scenario, row.overrides, calm=True)
    (robot,) = next(iter(limits.members.values()))
    wanted = robot.calm.at(max(metrics['chattering_nm'], robot.calm.chattering[0]))
    assert found.score == float(f'{wanted / found.figures.error:.5g}')


def test_what_a_kill_cut_is_run_again_and_nothing_else_changes(
    whole, protocol_file, tmp_path, monkeypatch
):
    scores, out = whole
    partial = tmp_path / 'partial'
    partial.mkdir()
    for name in ('benchmark.json', 'limits.jsonl', 'runs.jsonl'):
        (partial / name).write_bytes((out / name).read_bytes())
    lines = (out / 'runs.jsonl').read_bytes().splitlines(keepends=True)
    (partial / 'runs.jsonl').write_bytes(b''.join(lines[:10]) + lines[10][:20])
    ran = []
    known = judged_runs.figures_of
    monkeypatch.setattr(judged_runs, 'figures_of', lambda of: ran.append(of) or known(of))
    again_ = judged(protocol_file, partial, 'pid', 'computed_torque')
    assert not differences(scores.as_data(), again_.as_data())
    assert len(ran) == len(lines) - 10


def test_the_files_are_there_and_the_json_is_strict(whole):
    scores, out = whole

    def refuse(word):
        raise AssertionError(word)

    found = json.loads((out / 'score.json').read_text(), parse_constant=refuse)
    assert not differences(found, scores.as_data())
    assert found['laws']['pid']['gains']['serial_2r'].keys() > {'within_effort', 'pid.Kp'}
    assert (out / 'page.pdf').read_bytes().startswith(b'%PDF')


@pytest.mark.parametrize(
    'path', [('protocol', 'seed'), ('suite',), ('laws', 'pid', 'gains', 'serial_2r', 'pid.Kp')]
)
def test_one_changed_gain_seed_or_version_is_told(path, whole):
    found = json.loads(whole[0].json())
    changed = json.loads(whole[0].json())
    group = changed
    for key in path[:-1]:
        group = group[key]
    value = group[path[-1]]
    group[path[-1]] = np.nextafter(value, 9e9) if isinstance(value, float) else f'{value}1'
    (line,) = differences(changed, found)
    assert line.startswith('.'.join(path))
    changed = json.loads(whole[0].json())
    changed['machine'], changed['seconds'] = {}, 0.0
    assert not differences(changed, found)


def test_what_differs_is_one_line_whatever_the_file_says():
    given = {'protocol': {'name': 'a\nb\x1b[31m', 'c\nd': 1, 'seed': 'x' * 10_000}}
    lines = differences(given, {'protocol': {'name': 'protocol_1', 'seed': 1}})
    assert len(lines) == 3 and all(line.isprintable() and len(line) < 300 for line in lines)


def test_a_score_is_checked_by_running_it_again(whole, protocol_file, tmp_path):
    _, out = whole
    found = benchmark._checked(out / 'score.json', str(protocol_file), (), tmp_path / 'a', Inline)
    assert not found.differences and 'same to the last digit' in found.parts()[0]


@pytest.mark.parametrize('name', ['seed', 'version', 'sha256'])
def test_a_score_of_another_protocol_is_told_before_anything_is_run(
    name, whole, protocol_file, tmp_path
):
    changed = json.loads(whole[0].json())
    changed['protocol'][name] = 2
    path = tmp_path / 'score.json'
    path.write_text(json.dumps(changed))
    found = benchmark._checked(path, str(protocol_file), (), tmp_path / 'a', pytest.fail)
    what, line = found.parts()
    assert 'nothing was run' in what and line.startswith(f'  protocol.{name}: 2 in the file, ')
    assert not (tmp_path / 'a').exists()


def test_other_words_draw_other_samples_of_the_same_protocol(protocol_file):
    public, other = read(str(protocol_file)), read(str(protocol_file), phrase='spring tide')
    digest = hashlib.sha256(b'spring tide').hexdigest()
    assert other.seed == seed_from('spring tide') == int(digest[:16], 16) >> 2
    assert replace(other, seed=public.seed) == public


def test_a_period_at_which_no_run_has_a_score_is_refused(protocol_file, tmp_path):
    content = yaml.safe_load(protocol_file.read_text())
    for period in (0.01, 0.02):
        content['set']['period'] = period
        path = tmp_path / f'{period}.yaml'
        path.write_text(yaml.safe_dump(content, sort_keys=False))
        if period == 0.01:
            assert read(str(path)).robots
    with pytest.raises(
        InputError, match=r'set\.period is 0\.02 s: the score is at the chattering'
    ):
        read(str(path))


def test_the_page_of_the_documentation_has_the_protocol_of_this_version():
    page = (config.directory().parent / 'docs' / 'benchmark.md').read_text()
    assert read().digest[:12] in page


def test_a_law_of_ones_own_is_told_by_its_source(protocol_file):
    path = config.directory().parent / 'docs' / 'example_law.py'
    found = competitors([str(path), 'pid'])
    assert found.names == ('example_law', 'pid')
    assert found.sources()['example_law'] == hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.endurance
def test_a_foreign_law_has_the_score_of_the_same_in_python(protocol_file, tmp_path):
    docs = config.directory().parent / 'docs'
    library = compiled(tmp_path / 'example_law.so', (docs / 'example_law.c').read_text())
    found = [
        judged(protocol_file, tmp_path / f'{k}', str(file)).as_data()['laws']['example_law']
        for k, file in enumerate((library, docs / 'example_law.py'))
    ]
    assert found[0]['default'] == found[1]['default']
    assert found[0]['source'] == hashlib.sha256(library.read_bytes()).hexdigest()
    assert found[0]['gains']['serial_2r']['example_law.limit'] == 10.0  # which is not varied


@pytest.mark.parametrize(
    ('words', 'says'),
    [
        ([], 'name a law'),
        (['pid'], '--out is missing'),
        (['pid', 'pid', '--out', 'x'], 'pid is named twice'),
        (['nothing.py', '--out', 'x'], 'there is no file'),
        (['pidd', '--out', 'x'], "unknown law 'pidd'"),
        (['pid', '--protocol', 'nine', '--out', 'x'], "unknown protocol 'nine'"),
        (['--check', 'none.json'], 'cannot read none.json'),
        (['--check', 'none.json', '--quick'], 'leave --quick out'),
        (['pid', '--workers', '0', '--out', 'x'], '--workers must be from 1'),
    ],
)
def test_what_is_wrong_is_one_line(words, says, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(['benchmark', *words]) == 2
    assert says in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ('change', 'says'),
    [
        ({'scrambles': 0}, 'scrambles'),
        ({'robots': []}, 'robots must hold keys and values'),
        ({'colour': 1}, "unknown key 'colour'"),
        ({'speeds': 'fast'}, 'speeds'),
        ({'search': {}}, 'search.trials'),
    ],
)
def test_a_protocol_with_a_mistake_is_refused(change, says, protocol_file, tmp_path):
    path = tmp_path / 'bad.yaml'
    path.write_text(yaml.safe_dump(yaml.safe_load(protocol_file.read_text()) | change))
    with pytest.raises(InputError, match=says):
        read(str(path))


def test_another_benchmark_in_the_directory_is_refused(whole, protocol_file):
    with pytest.raises(InputError, match='another laws'):
        judged(protocol_file, whole[1], 'pid')
