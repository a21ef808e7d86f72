"""`parallel_robot fronts`: several tunings in one picture, and what it refuses."""

import json
from dataclasses import replace

import pytest
from matplotlib.figure import Figure

from parallel_robot.cli.command_line import main
from parallel_robot.studies.tuning import front
from parallel_robot.studies.tuning.tune import Store
from parallel_robot_model.common.errors import InputError

TABLE = """trial,chosen,xy_rms_m,chattering_nm,Kp
3,0,0.0001,0.9,1.0
1,1,0.0002,0.3,2.0
"""


def tuning(folder, name, law='pid', table=TABLE, **manifest):
    directory = folder / name
    directory.mkdir()
    same = {'scenario': 'paper_circle', 'measure of effort': 'chattering', 'number of runs': 8}
    content = {'format': Store.FORMAT, 'law': law, **same, **manifest}
    (directory / 'tune.json').write_text(json.dumps(content))
    (directory / 'front.csv').write_text(table)
    return directory


def test_each_front_is_drawn_and_named(tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(Figure, 'savefig', lambda figure, *_, **__: drawn.append(figure))
    laws = {'a': 'pid', 'b': 's_fotsmc', 'c': 'pid'}
    found = [front.read_front(tuning(tmp_path, name, law)) for name, law in laws.items()]
    front.draw_fronts(found)
    (axes,) = drawn[0].axes
    assert {text.get_text(): text.get_fontweight() for text in axes.texts} == {
        'PID (a)': 'normal',
        'S-FOTSMC': 'bold',
        'PID (c)': 'normal',
    }
    curve, star = axes.lines[:2]
    assert [*curve.get_xdata()] == [0.9, 0.3] and [*curve.get_ydata()] == pytest.approx([100, 200])
    assert (star.get_xdata(), star.get_ydata()) == ([0.3], [pytest.approx(200.0)])
    assert 'end-effector error' in axes.get_ylabel() and 'chattering' in axes.get_xlabel()


def test_a_front_is_drawn_by_its_effort_though_its_errors_do_not_fall(tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(Figure, 'savefig', lambda figure, *_, **__: drawn.append(figure))
    points = ((1.5, 8e-6), (0.1, 54e-6), (0.34, 55e-6))  # by error, on robots of a sweep
    front.draw_fronts([replace(front.read_front(tuning(tmp_path, 'a')), points=points, chosen=2)])
    curve, star = drawn[0].axes[0].lines
    assert [*curve.get_xdata()] == [1.5, 0.34, 0.1]
    assert [*curve.get_ydata()] == pytest.approx([8.0, 55.0, 54.0])
    assert (star.get_xdata(), star.get_ydata()) == ([0.34], [pytest.approx(55.0)])


def test_it_writes_one_file_of_either_kind(tmp_path, capsys):
    directory = str(tuning(tmp_path, 'a'))
    for name, start in (('all.png', b'\x89PNG'), ('all.svg', b'<?xml')):
        assert main(['fronts', directory, '--out', str(tmp_path / name)]) == 0
        assert (tmp_path / name).read_bytes().startswith(start)
    assert main(['fronts', directory, '--out', str(tmp_path / 'all.png')]) == 2
    assert main(['fronts', directory, '--out', str(tmp_path / 'all.txt')]) == 2
    assert "--out must end with .svg or .png, not 'all.txt'" in capsys.readouterr().err


def test_what_cannot_be_compared_is_refused(tmp_path):
    first = front.read_front(tuning(tmp_path, 'a'))
    other = front.read_front(tuning(tmp_path, 'b', **{'number of runs': 9}))
    with pytest.raises(InputError, match='differ in the number of runs'):
        front.check_fronts([first, other])
    front.check_fronts([first, front.read_front(tuning(tmp_path, 'c', 'smc'))])


@pytest.mark.parametrize(
    ('broken', 'wanted'),
    [
        ({'table': ''}, 'is not the front of a tuning'),
        ({'table': TABLE.replace('0.9', 'x')}, 'is not the front of a tuning'),
        ({'table': TABLE.replace('1.0', '{')}, "front.csv Kp: '{' is not a YAML value"),
        ({'format': 'other'}, 'is not that of a tuning'),
        ({'measure of effort': 'noise'}, 'is not the front of a tuning'),
    ],
)
def test_a_broken_directory_costs_one_line(broken, wanted, tmp_path, capsys):
    directory = tuning(tmp_path, 'a', **broken)
    assert main(['fronts', str(directory), '--out', str(tmp_path / 'all.svg')]) == 2
    error = capsys.readouterr().err
    assert wanted in error and error.count('\n') == 1
    assert main(['fronts', str(tmp_path / 'no'), '--out', str(tmp_path / 'all.svg')]) == 2
    assert 'is not the directory of a tuning' in capsys.readouterr().err
