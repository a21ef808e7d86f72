"""Figures are drawn."""

import struct

import numpy as np
import pytest
from bags import motion_of, streams, write_foreign
from geometry import PAPER_START, legs
from matplotlib.figure import Figure

from parallel_robot.analysis import metrics, recorded_motions
from parallel_robot.analysis.report import figures
from parallel_robot.bags.run import recording


@pytest.fixture(scope='module')
def log(tmp_path_factory, robot):
    bag = tmp_path_factory.mktemp('figures') / 'bag'
    t = np.arange(300)[:, np.newaxis] * 1e-3
    path = PAPER_START + np.hstack([0.02 * np.sin(9 * t), 0.02 * np.cos(9 * t), 0 * t])
    reference = legs(robot, path)[0]
    write_foreign(
        bag, streams(reference, reference + 1e-4 * np.exp(-t), np.hstack([t, -t, 0 * t]))
    )
    return recording.read(bag).log


def test_a_picture_comes_out(log, tmp_path):
    figures.draw_run(log, motion_of(log), tmp_path / 'run.png')
    data = (tmp_path / 'run.png').read_bytes()
    assert data.startswith(b'\x89PNG\r\n\x1a\n') and len(data) > 20_000
    width, height = struct.unpack('>II', data[16:24])
    assert 1000 < width < 3000 and 500 < height < 2000


@pytest.mark.parametrize(('suffix', 'begin'), [('pdf', b'%PDF'), ('svg', b'<?xml')])
def test_the_suffix_chooses_the_format(suffix, begin, log, tmp_path):
    figures.draw_run(log, motion_of(log), tmp_path / f'run.{suffix}')
    assert (tmp_path / f'run.{suffix}').read_bytes().startswith(begin)


def drawn(monkeypatch):
    """Figures that are drawn from now on."""
    found = []
    monkeypatch.setattr(Figure, 'savefig', lambda figure, *_, **__: found.append(figure))
    return found


@pytest.mark.parametrize('count', [1, 2, 3, 5, 13])
@pytest.mark.parametrize('planar', [True, False])
def test_there_is_a_curve_for_each_joint(count, planar, log, tmp_path, monkeypatch):
    columns = np.arange(count) % 3
    names = tuple(f'axis{k + 1}' for k in range(count))
    fields = ('position', 'reference_position', 'effort', 'answer')
    other = log._replace(
        joints=names, **{field: getattr(log, field)[:, columns] for field in fields}
    )
    pose = metrics.Poses(other.position, other.reference_position, planar)
    if planar:
        pose = recorded_motions.poses_of_log(log)
    found = drawn(monkeypatch)
    figures.draw_run(other, motion_of(other, pose), tmp_path / 'run.png')
    panels = {axes.get_title('left') or axes.get_title(): axes for axes in found[0].axes}
    expected = ['Joint errors', 'Torques']
    expected += ['Path', 'End-effector error'] if planar else ['Synchronisation errors']
    assert sorted(panels) == sorted(expected)
    for title in {'Joint errors', 'Torques', 'Synchronisation errors'} & {*panels}:
        lines = panels[title].lines
        assert [line.get_label() for line in lines] == [f'axis {k + 1}' for k in range(count)]
        looks = {(line.get_color(), line.get_linestyle()) for line in lines}
        assert len(looks) == min(count, 12)
    figures.draw_torques(other, other.effort, 'pid', tmp_path / 'torques.png')
    assert [axes.get_title() for axes in found[1].axes] == [f'axis {k + 1}' for k in range(count)]


@pytest.mark.parametrize('scale', ['auto', 'linear', 'log'])
def test_errors_are_magnitudes_where_they_would_look_like_zero(scale, log, tmp_path, monkeypatch):
    found = drawn(monkeypatch)
    settled = np.where(log.time[:, np.newaxis] < 0.02, 1e-3, 1e-6)
    for k, error in enumerate((np.full_like(log.position, 1e-3), settled)):
        run = log._replace(position=log.reference_position - error)
        figures.draw_run(run, motion_of(run), tmp_path / f'{k}.png', scale)
    scales = [{axes.get_title('left'): axes.get_yscale() for axes in f.axes} for f in found]
    even, spread = (one['Joint errors'] for one in scales)
    assert (even, spread) == (('linear', 'log') if scale == 'auto' else (scale, scale))
    lowest, highest = found[1].axes[2].get_ylim()
    assert highest > 1e3 and (lowest < 1.0)
    assert all(one['Torques'] == 'linear' for one in scales)


def test_runs_are_drawn_over_one_another(log, monkeypatch):
    far = log._replace(position=log.reference_position + 1e-2, law='smc')
    both = {'near': (log, motion_of(log)), 'far': (far, motion_of(far))}
    path, error, joints, torque = figures.figure_of_runs(both).axes
    assert [len(axes.lines) for axes in (path, error, joints, torque)] == [5, 2, 2, 2]
    near, away = joints.lines
    assert (near.get_label(), away.get_label()) == ('near', 'far')
    assert near.get_color() != away.get_color()
    np.testing.assert_allclose(away.get_ydata(), 1e4)
    largest = np.abs(log.effort).max(axis=1)
    np.testing.assert_array_equal(torque.lines[0].get_ydata(), largest)
    distance = 1e6 * metrics.distances(both['near'][1].poses)
    np.testing.assert_allclose(error.lines[0].get_ydata(), distance)
    bare = {
        name: (run, motion._replace(poses=motion.poses._replace(place=0)))
        for name, (run, motion) in both.items()
    }
    assert len(figures.figure_of_runs(bare).axes) == 3


def test_errors_are_drawn_in_the_units_of_their_axes(log):
    log = log._replace(position=log.position + np.array([1e-5, 0.0, -2e-5]))
    motion = motion_of(log, recorded_motions.poses_of_log(log))
    error = log.reference_position - log.position
    errors = {
        'End-effector error': ('[µm]', (motion.poses.reference - motion.poses.actual)[:, :2]),
        'Joint errors': ('[µrad]', error),
        'Synchronisation errors': ('[µrad]', error - np.roll(error, -1, axis=1)),
    }
    bare = motion._replace(poses=motion.poses._replace(place=0))
    shown = set()
    for each in (motion, bare):
        for axes in figures.figure_of_run(log, each).axes:
            if (title := axes.get_title('left')) in errors:
                unit, expected = errors[title]
                found = np.transpose([line.get_ydata() for line in axes.lines])
                np.testing.assert_allclose(np.abs(found), 1e6 * np.abs(expected), atol=1e-6)
                assert unit in axes.get_ylabel()
                shown.add(title)
    assert shown == {*errors}


def test_errors_of_zero_can_be_drawn(log, tmp_path):
    exact = log._replace(position=log.reference_position)
    figures.draw_run(exact, motion_of(exact), tmp_path / 'run.png')
    assert (tmp_path / 'run.png').stat().st_size > 10_000


def test_names_that_look_like_mathematics_are_drawn(log, tmp_path):
    named = log._replace(law='$\\frac{', scenario='two\nlines')
    figures.draw_run(named, motion_of(named), tmp_path / 'run.svg')
    assert (tmp_path / 'run.svg').stat().st_size > 10_000


def test_laws_are_written_as_in_print(log, tmp_path, monkeypatch):
    run, replay = drawn(monkeypatch), log.answer
    figures.draw_run(log._replace(law='s_fotsmc'), motion_of(log), tmp_path / 'run.png')
    figures.draw_torques(log._replace(law='s_smc'), replay, 'mine', tmp_path / 'replay.png')
    assert run[0].get_suptitle() == 'unknown, S-FOTSMC'
    legend = run[1].axes[0].get_legend()
    assert [text.get_text() for text in legend.texts] == ['recorded, S-SMC', 'replayed, mine']
