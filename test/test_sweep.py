"""Sweeps: one row a run, each the one that runs alone, and nothing of others touched."""

import io
import math
from dataclasses import replace

import numpy as np
import pytest
from bags import motion_of
from sweeping import FAILING, ROWS, RUNS, TEXT, Inline, content, planned, runs, swept

from parallel_robot.analysis import metrics
from parallel_robot.bags.run import recording
from parallel_robot.cli.command_line import main
from parallel_robot.studies import least_errors
from parallel_robot.studies.sweep import results
from parallel_robot.studies.sweep.run_chunk import Outcome, floor_of, run_task, tasks
from parallel_robot.studies.sweep.store import Store, schema, table
from parallel_robot.studies.sweep.sweep import FILES
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import InputError, RunError
from parallel_robot_sim.configuration import configure

pytest_plugins = ['sweeping']


def test_there_is_one_row_a_run_with_units_in_the_columns(whole):
    found = runs(whole)
    assert found['row'].to_pylist() == list(range(ROWS))
    assert set(found['status'].to_pylist()) == {'ok'} and not any(found['reason'].to_pylist())
    assert found['law'].to_pylist() == ['smc', 'computed_torque'] * RUNS
    assert {'xy_rms_m', 'torque_max_nm', 'chattering_nm', 'seed'} < set(found.column_names)
    for name in ('xy_rms_m', 'torque_max_nm', 'true_robot.m1', 'friction.viscous'):
        values = found[name].to_numpy()
        assert np.isfinite(values).all()
        assert len(np.unique(values.round(9))) >= (2 if name == 'torque_max_nm' else RUNS)
    assert set(found['plant.integrator'].to_pylist()) == {'"ode3"', '"rk4"'}
    assert np.isinf(found['to_0_1_mm_s'].to_numpy()).any()
    assert {path.name for path in whole.iterdir()} == {
        *('sweep.json', 'study.yaml', 'lock', 'runs.parquet'),
        *(f'summary.{suffix}' for suffix in ('txt', 'csv', 'tex', 'html')),
        *(f'distributions.{suffix}' for suffix in ('png', 'pdf')),
    }
    assert (whole / 'study.yaml').read_text() == TEXT


@pytest.mark.parametrize('row', [0, ROWS - 7])
def test_a_row_that_runs_alone_has_the_metrics_of_the_sweep(row, whole, tmp_path, capsys):
    bag = tmp_path / 'bag'
    assert main(['simulate', str(whole), '--row', str(row), '--out', str(bag)]) == 0
    assert capsys.readouterr().err == ''
    log = recording.read(bag).log
    found = metrics.evaluate(motion_of(log))
    (expected,) = runs(whole).slice(row, 1).to_pylist()
    assert expected['law'] == log.law
    assert found['xy_rms_m'] == expected['xy_rms_m']
    assert found['sync_rms_rad'] == expected['sync_rms_rad']
    assert found['torque_max_nm'] == expected['torque_max_nm']
    assert found['chattering_nm'] == expected['chattering_nm']
    assert found['torque_rms_nm'] == expected['torque_rms_nm']
    assert found['energy_j'] == expected['energy_j']
    assert 0.0 < expected['excess_chattering_nm'] <= expected['chattering_nm']
    assert (found['to_1_mm_s'] or math.inf) == expected['to_1_mm_s']


def test_a_row_of_a_study_file_is_that_of_its_sweep(whole, tmp_path):
    (tmp_path / 'study.yaml').write_text(TEXT)
    bags = [tmp_path / 'a', tmp_path / 'b']
    for origin, bag in zip((whole, tmp_path / 'study.yaml'), bags, strict=True):
        assert main(['simulate', str(origin), '--row', '3', '--out', str(bag)]) == 0
    a, b = (recording.read(bag).log for bag in bags)
    np.testing.assert_array_equal(a.position, b.position)


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (['--row', str(ROWS)], f'--row must be from 0 to {ROWS - 1}, not {ROWS}'),
        (['--row', '-1'], '--row must be from 0'),
        (['--row', '1', '--law', 'smc'], '--law and --row exclude each other'),
        (['--row', '1', '--duration', '3'], '--duration and --row exclude each other'),
        (['--row', '1', '--set', 'smc.z=3'], 'a row of a sweep is run as it was'),
    ],
    ids=str,
)
def test_a_row_that_cannot_be_run(words, message, whole, tmp_path, capsys):
    assert main(['simulate', str(whole), *words, '--out', str(tmp_path / 'bag')]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count('\n') == 1 and not list(tmp_path.iterdir())


def test_a_directory_that_is_no_sweep_has_no_rows(tmp_path, capsys):
    words = ['simulate', str(tmp_path), '--row', '1', '--out', str(tmp_path / 'bag')]
    assert main(words) == 2
    assert 'is not the directory of a sweep' in capsys.readouterr().err


def test_more_runs_of_a_sweep_only_add_rows(whole, tmp_path):
    swept(tmp_path, runs=5)
    assert runs(tmp_path).num_rows == 10
    swept(tmp_path)
    assert content(tmp_path) == content(whole)


def test_a_terminal_sees_how_long_it_takes(tmp_path, monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    screen = Terminal()
    monkeypatch.setattr('sys.stderr', screen)
    swept(tmp_path, runs=4)
    assert '/8 [' in screen.getvalue() and 'run/s]' in screen.getvalue()


def test_a_worker_of_another_version_is_refused():
    one = next(tasks(planned(), np.zeros(ROWS, dtype=bool), 2))
    with pytest.raises(RunError, match='a worker has another version of the suite'):
        run_task(replace(one, version='0.0.0'))


def test_failures_are_rows_with_their_reason(tmp_path):
    summary = swept(tmp_path, FAILING, summarised=True)
    found = runs(tmp_path).to_pylist()
    assert [row['row'] for row in found] == list(range(6))
    assert {row['status'] for row in found} == {'ok', 'failed'}
    for row in found:
        if row['status'] == 'failed':
            expected = 'motion refused' if row['true_robot.m1'] > 0.0 else 'true_robot.m1 must be'
            assert expected in row['reason'] and row['xy_rms_m'] is None
        else:
            assert row['circle.radius'] == 0.03 and row['true_robot.m1'] > 0.0
            assert row['xy_rms_m'] > 0.0 and row['reason'] == ''
    assert 'motion refused at t = ' in summary


def test_a_fault_of_the_controller_is_a_row_with_its_metrics(tmp_path):
    swept(tmp_path, TEXT + 'set: {safety.speed_limit: 0.1}\n', runs=1)
    for row in runs(tmp_path).to_pylist():
        assert row['status'] == 'fault' and row['reason'].startswith('fault at t = 0.')
        assert row['xy_rms_m'] > 0.0


def refused(out, text=TEXT, **more):
    with pytest.raises(InputError) as raised:
        swept(out, text, **more)
    return str(raised.value)


def test_a_changed_study_a_version_and_fewer_runs_are_refused(whole, monkeypatch):
    before = {path: path.read_bytes() for path in whole.iterdir()}
    assert 'whose seed differs' in refused(whole, TEXT.replace('seed: 3', 'seed: 4'))
    assert 'whose uncertainty differs' in refused(whole, TEXT.replace('0.2}', '0.3}'))
    assert 'whose laws differs' in refused(whole, TEXT.replace('smc, c', 'pid, c'))
    changed = TEXT + 'set: {circle.radius: 0.02}\n'
    assert 'whose configuration differs' in refused(whole, changed)
    assert '--runs must be at least that, not 5' in refused(whole, runs=5)
    monkeypatch.setattr('parallel_robot.studies.sweep.store.version', lambda: '9.9')
    assert 'made by another version of the suite' in refused(whole)
    assert {path: path.read_bytes() for path in whole.iterdir()} == before


def test_a_comment_may_change(whole, tmp_path):
    swept(tmp_path, runs=2)
    swept(tmp_path, '# the same\n' + TEXT, runs=2)


@pytest.mark.parametrize(
    'manifest', ['', '[]', '{}', '{"format": "parallel_robot sweep 1", "runs": "x"}', '\x00']
)
def test_a_directory_of_something_else_is_left_alone(manifest, tmp_path):
    (tmp_path / 'sweep.json').write_text(manifest)
    assert 'choose another --out' in refused(tmp_path)
    (tmp_path / 'sweep.json').unlink()
    (tmp_path / 'thesis.tex').write_text('mine')
    assert 'is not the directory of a sweep' in refused(tmp_path)
    assert (tmp_path / 'thesis.tex').read_text() == 'mine'


def test_a_place_that_cannot_be_written(tmp_path):
    (tmp_path / 'file').write_text('mine')
    assert 'cannot write to' in refused(tmp_path / 'file' / 'out')
    assert 'file' in refused(tmp_path / 'file')


def test_two_sweeps_do_not_share_a_directory(whole):
    with Store(whole, planned(), TEXT):
        assert 'another sweep is writing' in refused(whole)


def test_many_rows_are_merged_window_by_window(whole, tmp_path, monkeypatch):
    monkeypatch.setattr('parallel_robot.studies.sweep.store.WINDOW', 7)
    swept(tmp_path)
    assert runs(tmp_path).equals(runs(whole))


def test_of_a_robot_without_a_plane_the_joints_are_compared(tmp_path):
    def outcome(k):
        values = dict.fromkeys((metric.key for metric in metrics.TABLE), math.nan)
        values |= {'joint_rms_rad': 1e-6 * (k + 1), 'torque_max_nm': 1.0, 'chattering_nm': 3.0}
        window = metrics.Window(0.1, 0.2, 0.2)
        return Outcome('ok', metrics=metrics.Metrics(values, 0.2, window))

    found = planned(runs=2)
    with Store(tmp_path, found, TEXT) as store:
        rows = [(found.row(k), outcome(k)) for k in range(4)]
        store.add(table(schema(found), rows))
        store.finish()
    assert runs(tmp_path)['xy_rms_m'].null_count == runs(tmp_path)['to_1_mm_s'].null_count == 4
    (result,) = results.evaluate(tmp_path / 'runs.parquet', found).values()
    assert result.quantities[0].name == 'joint error, rms'
    assert result.laws['smc'].medians[0].value == pytest.approx(2.0)  # of 1 and 3 µrad
    assert [(duel.winner, duel.probability.value) for duel in result.duels] == [('smc', 1.0)]


def test_results_name_a_scenario_by_its_name_not_by_its_path(tmp_path):
    file = tmp_path / 'eight.yaml'
    file.write_text('base: paper_circle\n')
    text = TEXT.replace('paper_circle', str(file))
    out = tmp_path / 'out'
    assert '\neight: medians\n' in swept(out, text, runs=2, summarised=True)
    assert set(runs(out)['scenario'].to_pylist()) == {'eight'}
    for name in FILES:
        found = (out / name).read_text(encoding='utf-8')
        assert 'eight' in found and str(file) not in found


@pytest.mark.usefixtures('inline')
def test_paths_of_a_study_count_from_its_file(tmp_path, monkeypatch, capsys):
    """And the command line may say how many runs there are."""
    (tmp_path / 'studies' / 'mine').mkdir(parents=True)
    file = tmp_path / 'studies' / 'one.yaml'
    file.write_text('scenarios: [mine/eight.yaml]\nlaws: [smc]\nduration: 0.1\n')
    (tmp_path / 'studies' / 'mine' / 'eight.yaml').write_text('base: paper_circle\n')
    for here, count in ('.', 1), ('studies', 2), ('studies/mine', 2):
        monkeypatch.chdir(tmp_path / here)
        words = ['sweep', str(file), '--runs', str(count), '--workers', '1']
        assert main([*words, '--out', str(tmp_path / 'out')]) == 0
        assert '\neight: medians\n' in capsys.readouterr().out
        bag = tmp_path / f'bag {len(here)}'
        assert main(['simulate', str(tmp_path / 'out'), '--row', '0', '--out', str(bag)]) == 0
        assert recording.read(bag).log.scenario == 'eight'
    assert runs(tmp_path / 'out').num_rows == 2
    assert main(['sweep', str(file), '--out', str(tmp_path / 'other')]) == 2
    error = capsys.readouterr().err
    assert (
        error
        == 'parallel_robot sweep: runs is missing: neither the study nor --runs says how many\n'
    )


def test_the_order_of_the_rows_does_not_matter(whole, tmp_path):
    class Backwards(Inline):
        slots = 1000

        def __init__(self):
            self.waiting = []

        def submit(self, task):
            self.waiting.append(task)

        def wait(self):
            task = self.waiting.pop()
            return [(task, run_task(task))]

    swept(tmp_path, workers=Backwards(), count=7)
    assert content(tmp_path) == content(whole)


NOISY = """
scenarios: [paper_circle]
laws: [smc, pid]
runs: 3
duration: 0.2
set: {sensor.position_noise: 1.0e-5, sensor.velocity_noise: 5.0e-3, disturbance.bandwidth: 10.0}
uncertainty:
  disturbance.noise: {distribution: uniform, low: 0.1, high: 1.0}
  sensor.delay: {distribution: uniform, low: 0.001, high: 0.005}
"""


def test_every_row_has_the_limit_of_its_sample_which_is_computed_once(tmp_path, monkeypatch):
    asked = []

    def counted(configuration):
        asked.append(configuration)
        return floor_of(configuration)

    monkeypatch.setattr('parallel_robot.studies.sweep.run_chunk.floor_of', counted)
    text = swept(tmp_path, NOISY, summarised=True)
    found = runs(tmp_path).to_pylist()
    assert len(asked) == 3 and len(found) == 6
    plan = planned(NOISY)
    for row in found:
        chosen = plan.row(row['row'])
        expected = floor_of(configure(resolve(chosen.scenario, chosen.overrides)))
        assert row['limit_um'] == expected.limit_um and row['delay_um'] == expected.delay_um
        assert row['limit_urad'] is None and row['limit_reason'] == ''
        assert 0.0 < row['limit_um'] < 1e6 * row['xy_rms_m'] and row['delay_um'] > 10.0
    (result,) = results.evaluate(tmp_path / 'runs.parquet', plan).values()
    ratios = [1e6 * row['xy_rms_m'] / row['limit_um'] for row in found if row['law'] == 'pid']
    assert result.quantities[1].name == 'error / limit'
    assert result.laws['pid'].medians[1].value == pytest.approx(np.median(ratios))
    limits = [row['limit_um'] for row in found[::2]]
    assert result.levels['limit'].median.value == pytest.approx(np.median(limits))
    assert 'error / limit' in text and '\n  limit ' in text and '\n  v d ' in text
    lines = (tmp_path / 'summary.csv').read_text().splitlines()
    assert any(line.startswith('paper_circle,,median of limit,µm,') for line in lines)
    assert 'limit & ' in (tmp_path / 'summary.tex').read_text()


def test_errors_are_held_against_the_limit_at_their_own_chattering(tmp_path):
    text = swept(tmp_path, NOISY + 'calm: true\n', summarised=True)
    found, plan = runs(tmp_path).to_pylist(), planned(NOISY + 'calm: true\n')
    ratios = []
    for row in (row for row in found if row['law'] == 'pid'):  # the curve is with all laws
        chosen = plan.row(row['row'])
        limits = least_errors.compute(chosen.scenario, chosen.overrides, calm=True)
        (robot,) = limits.members['paper_circle']
        spent = max(row['chattering_nm'], robot.calm.chattering[0])
        ratios.append(row['xy_rms_m'] / robot.calm.at(spent))
    (result,) = results.evaluate(tmp_path / 'runs.parquet', plan).values()
    names = [quantity.name for quantity in result.quantities]
    place = names.index('error / limit at own chattering')
    assert result.laws['pid'].medians[place].value == pytest.approx(np.median(ratios), rel=1e-9)
    assert min(ratios) > 1.0 and names[place] in text


@pytest.mark.parametrize(
    'encoder',
    [
        ('set: {', 'set: {sensor.resolution: 1.0e-4, '),
        ('set: {', 'set: {sensor.counts_per_turn: 65536, '),
        (
            '  disturbance.noise',
            '  sensor.resolution: {distribution: uniform, low: 0.0, high: 1.0e-4}\n'
            '  disturbance.noise',
        ),
    ],
)
def test_with_an_encoder_the_limit_is_called_an_estimate(tmp_path, encoder):
    text = swept(tmp_path, NOISY.replace(*encoder), summarised=True)
    assert 'error / estimated limit' in text and '\n  estimated limit ' in text


def test_a_sweep_that_goes_on_gives_the_limit_to_every_row(tmp_path):
    swept(tmp_path / 'once', NOISY)
    swept(tmp_path / 'more', NOISY, runs=1)
    found = planned(NOISY)
    with Store(tmp_path / 'more', found, NOISY) as store:
        assert store.done.tolist() == [True, True] + [False] * 4
        (first, *_) = tasks(found, store.done, 2)
        store.add(
            table(schema(found), zip(first.rows, run_task(first), strict=True))
        )  # then killed
    swept(tmp_path / 'more', NOISY)
    assert runs(tmp_path / 'more').equals(runs(tmp_path / 'once'))


def test_a_sample_without_a_limit_says_why(tmp_path):
    swept(tmp_path, FAILING)
    reasons = {
        row['limit_reason'] for row in runs(tmp_path).to_pylist() if row['limit_um'] is None
    }
    assert any('out of reach' in str(reason) for reason in reasons)


def test_the_limit_of_a_robot_without_a_plane_is_that_of_its_joints(tmp_path):
    text = NOISY.replace('paper_circle', 'axes_step')
    swept(tmp_path, text)
    for row in runs(tmp_path).to_pylist():
        assert row['limit_um'] is None and row['delay_um'] is None
        assert 0.0 < row['limit_urad'] < 1e6 * row['joint_rms_rad']


@pytest.mark.usefixtures('inline')
def test_an_effort_that_no_run_has_is_left_out(tmp_path, capsys):
    """States 20 ms apart have no chattering."""
    study = tmp_path / 'coarse.yaml'
    study.write_text(TEXT.replace(f'runs: {RUNS}', 'runs: 4'))
    words = ['sweep', str(study), '--set', 'period=0.02', '--out', str(tmp_path / 'out')]
    assert main(words) == 0
    out = capsys.readouterr().out
    assert 'nan' not in out and 'chattering' not in out and 'torque, rms [N m]' in out
