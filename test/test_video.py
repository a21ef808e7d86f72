"""Videos of bags: decoded by other libraries, and each wrong word refused."""

import av
import numpy as np
import pytest
from bags import full_disk
from PIL import Image

from parallel_robot.analysis.report.runs import read_runs
from parallel_robot.analysis.video import frame_times, magnification, scene
from parallel_robot.cli.command_line import main

BLUE = np.array([0x00, 0x44, 0x88])  # of S-FOTSMC


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    """Two laws, the second for half as long."""
    folder = tmp_path_factory.mktemp('video')
    for law, duration in (('smc', '1'), ('s_fotsmc', '0.5')):
        words = ['simulate', 'paper_circle', '--law', law, '--duration', duration]
        assert main([*words, '--out', str(folder / law)]) == 0
    return folder / 'smc', folder / 's_fotsmc'


def made(bags, out, *words):
    """The frames of a video, shape (F, height, width, 3), by another library, and their rate."""
    assert main(['video', *map(str, bags), '--out', str(out), *words]) == 0
    if out.suffix == '.mp4':
        with av.open(out) as container:
            (stream,) = container.streams
            assert stream.codec.name == 'h264'
            frames = [frame.to_ndarray(format='rgb24') for frame in container.decode(stream)]
            return np.array(frames), float(stream.average_rate)
    with Image.open(out) as moving:
        frames = []
        for k in range(moving.n_frames):
            moving.seek(k)
            frames.append(np.array(moving.convert('RGB')))
        return np.array(frames), 1e3 / moving.info['duration']


@pytest.mark.parametrize('suffix', ['.mp4', '.gif'])
def test_others_see_the_robot_move(suffix, bags, tmp_path):
    frames, rate = made(bags, tmp_path / f'both{suffix}', '--rate', '10')
    assert len(frames) == 11 and rate == 10.0  # of 1 s, the longer one
    changed = (np.abs(np.diff(frames.astype(int), axis=0)).max(axis=-1) > 60).sum(axis=(1, 2))
    assert (changed > 50).all()
    right = frames[:, 30:, frames.shape[2] // 2 + 20 :].astype(int)  # below the clock
    moved = (np.abs(np.diff(right, axis=0)).max(axis=-1) > 60).sum(axis=(1, 2))
    assert (moved[:5] > 50).all() and (moved[5:] < 20).all(), 'the shorter run stays at its end'


def test_the_end_effector_is_where_the_bag_has_it(bags, tmp_path):
    frames, _ = made(bags[1:], tmp_path / 'one.gif', '--rate', '10', '--magnify', '1')
    half = frames.shape[1] // 2, frames.shape[2] // 2
    path = frames[:, : half[0], half[1] :].astype(int)  # the second panel
    (runs,) = read_runs(bags[1:]).values()
    motion = runs[0].motion
    actual = motion.poses.actual[np.searchsorted(motion.time, np.arange(6) / 10), :2]
    centres = []
    for frame in path:
        y, x = np.nonzero(np.abs(frame - BLUE).max(axis=-1) < 30)
        dots = [(np.hypot(x - u, y - v) < 3.0).sum() for u, v in zip(x, y, strict=True)]
        full = np.array(dots) >= 0.95 * max(dots)  # the inside of the dot, not the line
        centres.append((x[full].mean(), -y[full].mean()))
    drawn = np.diff(centres, axis=0)
    moved = np.diff(actual, axis=0)
    scale = (drawn * moved).sum() / (moved * moved).sum()  # dots a metre
    assert scale > 1000.0
    assert np.abs(drawn - scale * moved).max() < 2.5


def test_slow_motion_has_more_frames(bags, tmp_path):
    frames, rate = made(bags[1:], tmp_path / 'slow.mp4', '--rate', '10', '--speed', '0.25')
    assert len(frames) == 21 and rate == 10.0
    frames, _ = made(bags[1:], tmp_path / 'part.mp4', '--speed', '0.25', '--from', '0.25')
    assert len(frames) == 26


def test_errors_are_magnified_alike(bags):
    runs = next(iter(read_runs(bags).values()))
    most = magnification(runs)
    assert most == min(magnification([run]) for run in runs)
    times = frame_times(runs, 25.0, 1.0, 100)
    for run in runs:
        shown = scene(run, times, most)
        error = np.linalg.norm(shown.path - shown.reference, axis=1)
        assert error == pytest.approx(most * shown.error)


def test_wrong_words_are_refused(bags, tmp_path, capsys):
    out = tmp_path / 'x.gif'
    bag = bags[0]
    for words, text in (
        ([bag, '--out', tmp_path / 'x.avi'], "unknown video format '.avi' (known: .gif, .mp4)"),
        ([bag, '--out', bag], 'unknown video format'),
        ([bag] * 5 + ['--out', out], 'a video takes up to 4 bags, not 5'),
        ([bag, '--out', out, '--rate', '0'], '--rate must be 1 to 100 Hz, not 0'),
        ([bag, '--out', out, '--speed', 'nan'], '--speed must be 0.001 to 1000, not nan'),
        ([bag, '--out', out, '--magnify', '0.5'], '--magnify must be 1 to 1e+09, not 0.5'),
        ([bag, '--out', out, '--speed', '0.001'], 'are 25001 frames, more than 1500'),
        ([tmp_path, '--out', out], 'is not a bag: no MCAP file there'),
    ):
        assert main(['video', *map(str, words)]) == 2, words
        err = capsys.readouterr().err
        assert text in err and err.count('\n') == 1, err
    out.write_text('mine')
    assert main(['video', str(bag), '--out', str(out)]) == 2
    assert 'exists; nothing is overwritten' in capsys.readouterr().err
    assert out.read_text() == 'mine'


def test_a_robot_that_is_not_planar_has_no_video(tmp_path, capsys):
    bag = str(tmp_path / 'axes')
    assert main(['simulate', 'axes_step', '--duration', '0.2', '--out', bag]) == 0
    capsys.readouterr()
    assert main(['video', bag, '--out', str(tmp_path / 'x.gif')]) == 2
    assert 'the pose of its robot is not a place' in capsys.readouterr().err


def test_a_full_disk_leaves_no_file(bags, tmp_path, capsys):
    out = tmp_path / 'x.gif'
    with full_disk(100):
        assert main(['video', str(bags[1]), '--out', str(out), '--rate', '5']) == 1
    assert 'cannot write' in capsys.readouterr().err
    assert not out.exists()
