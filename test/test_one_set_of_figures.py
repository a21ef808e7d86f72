"""A run has one set of figures, whoever prints them: commands, studies, Python."""

import itertools
import json

import pytest

from parallel_robot.analysis import metrics
from parallel_robot.analysis.metrics import METRICS
from parallel_robot.analysis.readable_metrics import as_data, brief, defined
from parallel_robot.analysis.report.runs import read_runs
from parallel_robot.cli.command_line import main
from parallel_robot.cli.commands import simulate as command
from parallel_robot.python import notebook
from parallel_robot.studies.sweep import store
from parallel_robot.studies.sweep.run_chunk import run_chunk

LAWS = ('s_fotsmc', 'computed_torque', 'pid')
SENSED = (
    {},
    {'sensor.delay': 2e-3, 'sensor.position_noise': 1e-5},
    {'sensor.delay': 3e-3, 'sensor.stamp': 'measured', 'actuator.lag': 1e-3},
    {'sensor.resolution': 1e-5, 'sensor.jitter': 2e-3, 'actuator.delay': 1e-3, 'seed': 3,
     'sensor.zero_angle': 3e-4, 'estimator.zero_angle': 2e-4},
    {'hazards': ['motors_clipped limit 0.4 at 0.05 for 0.05', 'states_lost at 0.12 for 0.01']},
)  # fmt: skip
BUILT = {
    'paper_circle': ({'true_robot.l1': 0.4005}, {'friction.coulomb': 0.05}),
    'serial_2r_circle': ({'true_robot.l2': 0.4001}, {'plant.integrator': 'rk4'}),
}
MIXES = [
    (scenario, LAWS[k % len(LAWS)], {**sensed, **built})
    for k, (scenario, sensed) in enumerate(itertools.product(BUILT, SENSED))
    for built in ({}, *BUILT[scenario])
]
assert len(MIXES) == 30


@pytest.mark.parametrize(('scenario', 'law', 'values'), MIXES)
def test_a_run_has_one_set_of_figures(scenario, law, values, tmp_path, capsys):
    run = notebook.simulate(scenario, law=law, duration=0.2, **values)
    found = notebook.metrics(run)
    bag = tmp_path / 'bag'
    notebook.save(run, bag)
    lines = brief(found, {})
    # simulate
    failed = run.simulation.failure
    made = command._Run(iter([run.simulation]))
    assert [*made] == [run.simulation]
    told = command.evaluate(made.last, made.summary.failure, made.figures)
    assert 'no figures' in told[0] if failed else told[-len(lines) :] == lines
    # metrics(load()), report
    for other in (notebook.metrics(notebook.load(bag)), *_reported(bag)):
        for metric in defined(METRICS, other):
            assert metric.of(other) == metric.of(found), metric.name
        assert defined(METRICS, other) == defined(METRICS, found)
    # sweep
    [outcome] = run_chunk([run.simulation.configuration])
    columns = store.columns_of(found)
    assert store.columns_of(outcome.metrics) == pytest.approx(columns, nan_ok=True, rel=0, abs=0)
    # analyze, as text and as JSON
    assert main(['analyze', str(bag), '--json', str(tmp_path / 'found.json')]) == 0
    data = json.loads((tmp_path / 'found.json').read_text())
    assert ('failure' in data) == bool(failed)
    if failed:
        return
    expected = as_data(found)
    assert 'excess_chattering_nm' in expected['effort']
    assert {key: data[key] for key in expected} == expected
    assert ('seen' in data) == (found.seen is not None)


@pytest.mark.parametrize(
    'hazard',
    [
        'states_ahead size 0.05 at 0.1 for 0.08',
        'states_ahead size 0.2 at 0.1 for 0.19',  # beyond the last reference
        'states_ahead size 1.5 at 0.1 for 0.02',
        'states_late delay 0.05 at 0.1 for 0.1',
        'velocity_nan joint joint1 at 0.1 for 0.02',
        'states_lost at 0.22 for 0.2',  # to the end
        'references_lost at 0.1 for 0.3',
    ],
)
def test_states_that_are_stale_or_of_wrong_stamps_change_no_figure(hazard, tmp_path):
    run = notebook.simulate('paper_circle', duration=0.3, hazards=[hazard])
    found = notebook.metrics(run)
    notebook.save(run, tmp_path / 'bag')
    other = notebook.metrics(notebook.load(tmp_path / 'bag'))
    for metric in defined(METRICS, found):
        if metric.key != 'excess_chattering_nm':
            assert metric.of(other) == metric.of(found), metric.name


def _reported(bag):
    return [one.metrics for runs in read_runs([bag]).values() for one in runs]


def test_compare_has_the_same_figures(tmp_path, capsys):
    values = {'sensor.delay': 2e-3, 'true_robot.l1': 0.4005}
    out = tmp_path / 'found.json'
    words = [word for key, value in values.items() for word in ('--set', f'{key}={value}')]
    options = ['--laws', 'pid', '--duration', '0.2', '--json', str(out)]
    assert main(['compare', 'paper_circle', *words, *options]) == 0
    found = notebook.metrics(notebook.simulate('paper_circle', law='pid', duration=0.2, **values))
    assert json.loads(out.read_text())['laws']['pid'] == as_data(found)
    assert {*metrics.named('seen_xy_rms_m', 'seen_joint_rms_rad')} < set(defined(METRICS, found))


def test_a_robot_of_another_geometry_is_as_far_away_as_it_is():
    found = notebook.metrics(
        notebook.simulate('paper_circle', duration=1, **{'true_robot.l1': 0.4005})
    )
    assert abs(found['xy_rms_m'] - found.seen['xy_rms_m']) > 1e-5
    assert found.source == metrics.TRUE
    assert found['joint_rms_rad'] == found.seen['joint_rms_rad']
