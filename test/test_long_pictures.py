"""Reports and videos of bags that are read in windows show what those of whole ones show."""

import numpy as np
import pytest
from test_long_bags import WINDOW, simulation, windows  # noqa: F401 fixture

from parallel_robot.analysis import thinned
from parallel_robot.analysis.report.charts import charts
from parallel_robot.analysis.report.page import postures
from parallel_robot.analysis.report.runs import read_runs
from parallel_robot.analysis.thinned import Series, thinned_series
from parallel_robot.analysis.video import frame_times, magnification, scene
from parallel_robot.cli.command_line import main


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    return simulation(tmp_path_factory.mktemp('long') / 'bag', duration=6.0)


def read(*bags):
    (runs,) = read_runs(bags).values()
    return runs


def spans(curve):
    return [bound(values) for values in curve[2:] for bound in (np.nanmin, np.nanmax)]


def test_a_report_in_windows(bag, windows):  # noqa: F811
    whole = read(bag)
    windows()
    long = read(bag)
    assert len(whole[0].log.time) == whole[0].samples == long[0].samples
    assert len(long[0].motion.time) < len(whole[0].motion.time)
    assert long[0].metrics.values == pytest.approx(whole[0].metrics.values, rel=1e-12, nan_ok=True)
    assert long[0].doubts == whole[0].doubts and long[0].log.messages == whole[0].log.messages
    for chart, other in zip(charts(long), charts(whole), strict=True):
        for panel, one in zip(chart.panels, other.panels, strict=True):
            for curve, wanted in zip(panel.curves, one.curves, strict=True):
                assert curve[:2] == wanted[:2]
                within = 1e-3 if chart.equal else 0.0  # mm, of a path that is drawn at 100 Hz
                assert spans(curve) == pytest.approx(spans(wanted), rel=0.0, abs=within)
                assert len(curve.x) > 6.0 / WINDOW or curve.label == 'start'
    for one, other in zip(postures(long), postures(whole), strict=True):
        assert np.array_equal(one, other)


def test_a_video_in_windows(bag, windows):  # noqa: F811
    whole = read(bag)
    windows()
    long = read(bag)
    times = frame_times(long, 7.0, 1.3, 1000)
    assert np.array_equal(times, frame_times(whole, 7.0, 1.3, 1000))
    assert magnification(long) == magnification(whole)
    one, other = (scene(runs[0], times, 10.0) for runs in (long, whole))
    for name, parts in one.parts.items():
        assert np.array_equal(parts, other.parts[name])
    assert np.array_equal(one.now.time, other.now.time)
    assert one.error.max() == other.error.max()
    drawn = long[0].motion.time[one.rows]
    assert ((drawn <= one.now.time) & (one.now.time - drawn < WINDOW)).all()
    drawn = long[0].path.time[one.path_rows]
    assert ((drawn <= one.now.time) & (one.now.time - drawn < 0.011)).all()


def test_what_is_kept_does_not_grow_with_the_bag(bag, windows, monkeypatch):  # noqa: F811
    windows()
    for name, value in (('INTERVALS', 20), ('FIRST', 0.1), ('PATH', 0.5), ('SHORTEST', 0.2)):
        monkeypatch.setattr(thinned, name, value)
    (run,) = read(bag)
    parts = 14  # 6 s / WINDOW
    assert len(run.motion.time) <= parts * (28 + 2) + 102  # of 14 curves, and the first 0.1 s
    assert len(run.cross_coupling.time) <= parts * (6 + 2)
    assert len(run.path.time) < 100 * (WINDOW + 0.5 + 0.2) + 10  # the first window is whole


def test_very_many_parts_keep_their_extremes():
    values = np.random.default_rng(3).normal(size=(40_000, 2))
    found = thinned_series(Series(np.arange(40_000.0), values))
    assert len(found.time) < 20_000 and (np.diff(found.time) > 0).all()
    assert np.array_equal(found.values.max(axis=0), values.max(axis=0))
    assert np.array_equal(found.values.min(axis=0), values.min(axis=0))
    assert np.histogram(found.time, 10, (0.0, 4e4))[0].min() > 500  # all of it is drawn


def test_the_commands_take_long_bags(bag, windows, tmp_path, capsys):  # noqa: F811
    windows()
    assert main(['report', str(bag), '--out', str(tmp_path / 'report')]) == 0
    assert '<td>6001</td>' in (tmp_path / 'report' / 'report.html').read_text()
    words = ['--out', str(tmp_path / 'run.gif'), '--rate', '2', '--from', '1', '--to', '5']
    assert main(['video', str(bag), *words]) == 0
    assert ', 9 frames' in capsys.readouterr().out
