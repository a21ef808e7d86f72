"""A simulation that comes in parts: the same run, bag and metrics as in one piece."""

import shutil

import numpy as np
import pytest
from bags import content, full_disk

from parallel_robot.analysis import metrics
from parallel_robot.analysis.run_results import SimulatedFigures
from parallel_robot.bags.run import recording
from parallel_robot.bags.writing import bag_writer, simulation_bag
from parallel_robot.bags.writing.recovery import recover
from parallel_robot.cli.command_line import main
from parallel_robot_control.configuration import resolve
from parallel_robot_sim import simulation
from parallel_robot_sim.closed_loop import COLUMNS
from parallel_robot_sim.configuration import configure
from parallel_robot_sim.motions import of_simulation
from parallel_robot_sim.simulation import RunSummary, attempt, parts
from trajectory_gen.configuration import with_duration

SIZE = 137  # samples of a part: no multiple of any rate
NOISE = {
    'sensor.position_noise': 1e-5,
    'sensor.velocity_noise': 1e-3,
    'sensor.delay': 0.003,
    'sensor.stamp': 'measured',
    'actuator.delay': 0.002,
    'actuator.jitter': 0.003,
    'actuator.lag': 0.001,
    'disturbance.noise': 0.5,
    'disturbance.bandwidth': 20.0,
    'seed': 7,
}
IDENTIFY = {
    'estimator.delay': 'identify',
    'lock_in.start': 0.2,
    'lock_in.duration': 0.4,
    'sensor.delay': 0.003,
}
HAZARDS = [
    'states_late delay 0.004 at 0.1 for 0.05',
    'states_lost at 0.25 for 0.005',
    'references_lost at 0.3 for 0.01',
    'encoder_frozen joint joint2 at 0.35 for 0.02',
]
CASES = {
    'memory': {'law': 'super_twisting'},
    'noise and delays': NOISE,
    'estimator': {'law': 'observer_s_fotsmc', 'estimator.kind': 'kalman', **NOISE},
    'delay found': IDENTIFY,
    'limits': {'safety.torque_limit': [3.0] * 3},
    'hazards': {'hazards': HAZARDS},
    'fault late': {'disturbance.pulse': [60.0] * 3, 'disturbance.pulse_start': 0.5,
                   'disturbance.pulse_duration': 0.2},
}  # fmt: skip


def values_of(**changes):
    return resolve('paper_circle', {'duration': 0.8, 'time_mode': 'lockstep', **changes})


@pytest.mark.parametrize('case', CASES)
def test_a_run_in_parts_is_that_in_one_piece(case, tmp_path, monkeypatch):
    values = values_of(**CASES[case])
    whole = attempt(configure(values))
    monkeypatch.setattr(bag_writer, 'CHUNK_SIZE', 20_000)
    simulation_bag.write(tmp_path / 'whole' / 'bag', values, [whole])
    summary, found = RunSummary(), []
    for part in parts(configure(values), SIZE):
        summary.add(part)
        found.append(part)
    assert len(found) > 3
    for name in COLUMNS:
        together = np.concatenate([getattr(part.run, name) for part in found])
        assert np.array_equal(together, getattr(whole.run, name), equal_nan=True), name
    assert (summary.faults, summary.failure) == (whole.faults, whole.failure)
    assert (
        bool(whole.faults) == (case in ('hazards', 'fault late'))
        and summary.steps == whole.run.steps
    )
    simulation_bag.write(tmp_path / 'parts' / 'bag', values, parts(configure(values), SIZE))
    paths = [tmp_path / name / 'bag' / 'bag_0.mcap' for name in ('whole', 'parts')]
    one, other = map(content, paths)
    assert one == other and len(one['joint_states']) > 700
    one, other = (path.read_bytes() for path in paths)
    assert one == other


def test_a_robot_that_leaves_its_workspace_ends_the_run_within_a_part():
    values = values_of(**{'disturbance.constant': [80.0, -80.0, 50.0]})
    whole = attempt(configure(values))
    for size in (SIZE, whole.run.steps):  # the second: at the end of a part
        found = list(parts(configure(values), size))
        summary = RunSummary()
        assert list(summary.taken(found)) == found
        assert summary.steps == whole.run.steps < 801
        assert summary.failure == whole.failure != ''


@pytest.mark.parametrize(
    'changes',
    [
        {},
        {'true_robot.m2': 9.0, **NOISE},
        {'hold': 0.3},
        {'scenario': 'axes_step', 'law': 'smc'},
        {'hazards': HAZARDS[:2]},
        {'disturbance.noise': 1.0, 'disturbance.bandwidth': 5.0, 'actuator.noise': 0.1},
    ],
)
def test_metrics_of_parts_are_those_of_the_run(changes):
    changes = {'duration': 1.5, 'time_mode': 'lockstep', **changes}
    scenario, hold = changes.pop('scenario', 'paper_circle'), changes.pop('hold', None)
    if hold:
        scenario = 'paper_line'
        del changes['duration']
    values = resolve(scenario, with_duration(scenario, changes, hold))
    whole = metrics.figures(of_simulation(attempt(configure(values))))
    running = SimulatedFigures()
    for part in parts(configure(values), 211):
        running.add(part)
    assert flat(running.result()) == pytest.approx(flat(whole), rel=1e-8, abs=1e-12, nan_ok=True)


def flat(found):
    """All numbers of metrics, by their place."""
    own = {**found.values, **found.window._asdict(), 'duration_s': found.duration_s}
    falls = own.pop('unsettled') or ()
    own |= {f'unsettled.{k}': number for k, number in enumerate(falls)}
    seen = {} if found.seen is None else flat(found.seen)
    own |= {f'seen.{key}': number for key, number in seen.items()}
    return {key: np.nan if number is None else number for key, number in own.items()}


def test_what_a_kill_leaves_can_be_recovered(tmp_path, monkeypatch):
    values = values_of(duration=1.2)
    monkeypatch.setattr(bag_writer, 'CHUNK_SIZE', 20_000)

    def killed():
        for k, part in enumerate(parts(configure(values), SIZE)):
            if k == 6:
                shutil.copytree(tmp_path / 'bag', tmp_path / 'left' / 'bag')
            yield part

    simulation_bag.write(tmp_path / 'bag', values, killed())
    recover(tmp_path / 'left' / 'bag', tmp_path / 'recovered')
    whole = content(tmp_path / 'bag' / 'bag_0.mcap')
    found = content(next((tmp_path / 'recovered').glob('*.mcap')))
    count = len(found['joint_states'])
    assert 4 * SIZE < count < 6 * SIZE
    assert found['joint_states'] == whole['joint_states'][:count]


def test_a_run_that_is_interrupted_leaves_a_whole_bag_of_what_there_is(tmp_path):
    values = values_of()

    def interrupted():
        some = parts(configure(values), SIZE)
        yield from (next(some) for _ in range(3))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulation_bag.write(tmp_path / 'bag', values, interrupted())
    assert len(recording.read(tmp_path / 'bag').log.time) == 2 * SIZE


def test_a_disk_that_becomes_full_in_a_later_part_costs_one_line(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(simulation, 'AT_ONCE', 500)
    words = ['simulate', 'paper_circle', '--duration', '3', '--out', str(tmp_path / 'bag')]
    with full_disk(500_000):
        assert main(words) == 1
    out, err = capsys.readouterr()
    assert out == '' and err == (
        f'parallel_robot simulate: cannot write {tmp_path / "bag"}: File too large\n'
    )
    assert 500 < len(recording.read(tmp_path / 'bag').log.time) < 3000


def test_nothing_is_written_of_a_run_that_cannot_begin(tmp_path, capsys):
    words = [
        'simulate',
        'paper_circle',
        '--set',
        'circle.radius=3',
        '--out',
        str(tmp_path / 'bag'),
    ]
    assert main(words) == 2
    assert capsys.readouterr().err.count('\n') == 1 and not (tmp_path / 'bag').exists()
