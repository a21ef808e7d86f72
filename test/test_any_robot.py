"""The commands that evaluate a bag serve every robot: any number of joints, any pose."""

import json
import re

import numpy as np
import pandas
import pytest
from bags import table_of

from parallel_robot.analysis import metrics
from parallel_robot.analysis.pictures import JOINTS, STYLES
from parallel_robot.analysis.report import page, report_files, runs
from parallel_robot.analysis.report.charts import charts
from parallel_robot.analysis.report.report_files import draw_chart
from parallel_robot.bags.run import recording
from parallel_robot.cli.command_line import main

# Scenario to joints as they are labelled, columns of the pose, and lines of each part.
ROBOTS = {
    'paper_circle': (
        ['joint 1', 'joint 2', 'joint 3'],
        ['platform_x_m', 'platform_y_m', 'platform_phi_rad'],
        [['proximal', 3], ['distal', 3], ['platform', 3]],
    ),
    'axes_step': (
        [f'axis {k}' for k in range(1, 6)],
        [f'pose_q{k}_rad' for k in range(1, 6)],
        None,
    ),
    'serial_2r_circle': (
        ['shoulder', 'elbow'],
        ['platform_x_m', 'platform_y_m'],
        [['proximal', 1], ['distal', 1]],
    ),
}


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    """A bag of each robot."""
    folder = tmp_path_factory.mktemp('robots')
    for scenario in ROBOTS:
        assert (
            main(['simulate', scenario, '--duration', '2.1', '--out', f'{folder / scenario}']) == 0
        )
    return {scenario: folder / scenario for scenario in ROBOTS}


@pytest.fixture(params=ROBOTS)
def case(request, bags):
    """Bag, labels, columns and parts of one robot."""
    return (bags[request.param], *ROBOTS[request.param])


def test_analyze_shows_what_is_defined(case, tmp_path, capsys):
    bag, _, pose, parts = case
    words = [str(bag), '--json', str(tmp_path / 'run.json'), '--figure', str(tmp_path / 'run.png')]
    assert main(['analyze', *words]) == 0
    out, err = capsys.readouterr()
    text = (tmp_path / 'run.json').read_text()
    assert not err and not re.search(r'\bnan\b', out + text, re.IGNORECASE)
    found = json.loads(text)
    planar = parts is not None
    assert ('end-effector error' in out) == planar
    assert set(found['transient']) == ({'to_1_mm_s', 'to_0_1_mm_s'} if planar else set())
    distances = {'xy_rms_m', 'xy_max_m'} if planar else set()
    if 'platform_phi_rad' in pose:
        distances |= {'rotation_rms_rad', 'rotation_max_rad'}
    assert set(found['steady']) == {'joint_rms_rad', 'sync_rms_rad'} | distances
    assert all(0.0 < value < 0.02 for value in found['steady'].values())
    assert (tmp_path / 'run.png').read_bytes().startswith(b'\x89PNG')


def test_the_table_has_the_joints_and_the_pose(case, tmp_path):
    bag, _, pose, parts = case
    log = recording.read(bag).log
    assert main(['export', str(bag), '--out', str(tmp_path / 'run.csv')]) == 0
    back = pandas.read_csv(tmp_path / 'run.csv')
    of_joints = [
        f'{joint}_{name}' for name in ('position_rad', 'effort_nm') for joint in log.joints
    ]
    assert {*of_joints} <= {*back.columns}
    prefix = 'pose' if parts is None else 'platform'
    expected = [*pose, *(re.sub(f'^{prefix}', f'{prefix}_reference', name) for name in pose)]
    expected += [] if parts is None else ['platform_error_m']
    assert [name for name in back.columns if name.startswith(prefix)] == expected
    assert not back[expected].isna().to_numpy().any()
    positions = back[[f'{joint}_position_rad' for joint in log.joints]].to_numpy()
    assert np.array_equal(positions, log.position)
    if parts is None:
        assert np.array_equal(back[pose].to_numpy(), log.position)
    assert list(table_of(bag).columns) == list(back.columns)


def test_the_charts_have_a_curve_or_a_panel_for_each_joint(case):
    bag, joints, _, parts = case
    (found,) = runs.read_runs([bag]).values()
    drawn = {chart.name: chart for chart in charts(found)}
    names = ['joint_errors', 'coupling_errors', 'torques']
    path = ['path', 'x_error', 'y_error']
    assert list(drawn) == (names if parts is None else path + names)
    assert [panel.title for panel in drawn['joint_errors'].panels] == joints
    assert len(drawn['coupling_errors'].panels) == 2 * len(joints)
    for panel in drawn['torques'].panels:
        assert [curve.label for curve in panel.curves] == joints
        assert len({STYLES[curve.style] for curve in panel.curves}) == len(joints)
    error = 1e3 * (found[0].log.reference_position - found[0].log.position)
    for k, panel in enumerate(drawn['joint_errors'].panels):
        assert panel.curves[0].y == pytest.approx(error[:, k])  # few enough to be drawn all


def test_the_report_shows_what_there_is(case, tmp_path, monkeypatch):
    monkeypatch.setattr(report_files, 'FORMATS', ('svg',))  # of the two, the faster
    bag, _, _, parts = case
    assert main(['report', str(bag), '--out', str(tmp_path / 'report')]) == 0
    text = (tmp_path / 'report' / 'report.html').read_text(encoding='utf-8')
    (data,) = re.findall(r'<script type="application/json"[^>]*>(.*?)</script>', text, re.DOTALL)
    own = re.sub(r'<script>.*?</script>', '', text, flags=re.DOTALL).partition('</style>')[2]
    assert not re.search(r'\bnan\b', own, re.IGNORECASE)
    assert ('<figure class="animation"' in own) == ('The robot in motion' in own) == bool(parts)
    assert ('end-effector error' in own) == ('time to 1 mm' in own) == bool(parts)
    found = json.loads(data)
    assert len(found['plots']) == own.count('class="plot"') == (3 if parts is None else 6)
    assert found.get('animation', {}).get('parts') == parts
    files = sorted(path.suffix for path in (tmp_path / 'report').iterdir())
    assert files == sorted(['.html', *['.svg'] * len(found['plots'])])


def test_compare_has_a_column_for_each_metric_that_is_defined(bags, tmp_path, capsys):
    words = ['axes_step', '--duration', '1', '--laws', 's_fotsmc', 'pid']
    assert main(['compare', *words, '--json', str(tmp_path / 'laws.json')]) == 0
    title, heads, units, *rows = capsys.readouterr().out.splitlines()
    assert 'end-effector' not in title and 'nan' not in ' '.join(rows)
    assert heads.split() == [
        'law',
        'joint',
        'rms',
        'sync',
        'rms',
        'torque',
        'variation',
        'chatter',
        'torque',
        'rms',
        'energy',
        'excess',
    ]
    assert [len(row.split()) for row in rows] == [9, 9] and units.count('[') == 8
    found = json.loads((tmp_path / 'laws.json').read_text())
    assert set(found['laws']['pid']['steady']) == {'joint_rms_rad', 'sync_rms_rad'}


def test_robots_of_one_scenario_are_not_drawn_together(bags, monkeypatch):
    """A scenario may be run with another robot; foreign bags have no scenario at all."""
    read = recording.read

    def same(*words, **options):
        found = read(*words, **options)
        return found._replace(log=found.log._replace(scenario='same'))

    monkeypatch.setattr(recording, 'read', same)
    found = runs.read_runs([bags['axes_step'], bags['serial_2r_circle'], bags['axes_step']])
    names = {name: [len(run.log.joints) for run in members] for name, members in found.items()}
    assert names == {'same (axes, 5 joints)': [5, 5], 'same (serial_2r, 2 joints)': [2]}
    drawn = {name: charts(members) for name, members in found.items()}
    text = page.render(found, drawn)
    assert text.count('<figure class="animation"') == 1
    assert 'Robot axes: same (axes, 5 joints) under' in text and 'Robot serial_2r: same' in text


def test_more_joints_than_styles_are_drawn(bags, tmp_path):
    (members,) = runs.read_runs([bags['axes_step']]).values()
    count, run = JOINTS + 2, members[0]
    columns = np.arange(count) % 5
    fields = ('position', 'reference_position', 'effort')
    many = {field: getattr(run.motion, field)[:, columns] for field in fields}
    poses = metrics.Poses(many['position'], many['reference_position'], place=0)
    motion = run.motion._replace(poses=poses, **many)
    log = run.log._replace(joints=tuple(f'q{k}' for k in range(count)))
    drawn = charts([run._replace(log=log, motion=motion, cross_coupling=None)])
    styles = [curve.style for curve in drawn[2].panels[0].curves]
    assert len(styles) == count and len(set(styles)) == len({STYLES[s] for s in styles}) == JOINTS
    _, svg = draw_chart(drawn[0], tmp_path, 'joint_errors')
    assert svg.read_text().count('<g id="axes_') == count
