"""Described machines beside what an engine makes of their file: `verify` of one."""

import importlib
import json
import math
import re
import sys
from pathlib import Path

import pytest
from machine_files import five_bar, mjcf
from mjcf_features import FEATURES

import parallel_robot as pr
from parallel_robot.cli.command_line import main
from parallel_robot.studies.file_in_engine import compare
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration.config_files import builtin_machines, machine_path
from parallel_robot_model.configuration.robot_file import text_of
from parallel_robot_model.robots.registry import robot_of

mujoco = pytest.importorskip('mujoco')

LINKS = """
<body name="upper"><joint name="s" axis="0 1 0" damping="0.3" frictionloss="0.2" range="-1 2"
  limited="true" armature="0.1"/><inertial pos="0.1 0 0" mass="2" diaginertia="0.1 0.2 0.3"/>
<body name="lower" pos="0.3 0 0"><joint name="e" type="slide" axis="1 0 0"/>
  <inertial pos="0.1 0.1 0" mass="1" diaginertia="0.1 0.2 0.3"/></body></body>"""
MOTORS = '<actuator><motor joint="s" gear="2" ctrlrange="-4 4" ctrllimited="true"/>{}</actuator>'
ARM = mjcf(LINKS, MOTORS.format('<motor joint="e"/>'))


def read(path, **values):
    """The robot of a file."""
    given = {'robot_model': 'machine', 'robot_description': text_of(path), **values}
    return robot_of(resolve('paper_circle', given))


def written(tmp_path, text, name='machine.xml'):
    path = tmp_path / name
    path.write_text(text)
    return path


def differing(found):
    return {each.what: each for each in found if not each.agrees}


@pytest.mark.parametrize('name', builtin_machines())
def test_shipped_machines_are_those_of_mujoco(name):
    values = resolve('paper_circle', {'robot_model': name})
    engine, found = compare(robot_of(values), machine_path(name))
    assert engine == f'MuJoCo {mujoco.__version__}'
    assert max(each.share for each in found) < 1e-12
    assert {'inertia', 'gravity and springs', 'dampers', 'least effort'} <= {x.what for x in found}


@pytest.mark.parametrize(
    ('before', 'after', 'what', 'where'),
    [
        ('mass="2"', 'mass="2.00001"', 'gravity and springs', 's'),
        ('mass="1" ', 'mass="1.00001" ', 'inertia', 's|e|s and e'),
        ('armature="0.1"', 'armature="0.11"', 'inertia', 's'),
        ('damping="0.3"', 'damping="0.31"', 'dampers', 's'),
        ('frictionloss="0.2"', 'frictionloss="0.21"', 'dry friction', 's'),
        ('range="-1 2"', 'range="-2 2"', 'least travel', 's'),
        ('range="-1 2"', 'range="-1 3"', 'greatest travel', 's'),
        ('ctrlrange="-4 4"', 'ctrlrange="-5 5"', 'greatest effort', 's'),
        ('gear="2"', 'gear="3"', 'least effort', 's'),
        ('<mujoco>', '<mujoco><option viscosity="2" density="1000"/>', 'fluid', 's|e'),
    ],
)
def test_what_another_file_has_is_found(before, after, what, where, tmp_path):
    robot = read(written(tmp_path, ARM))
    other = written(tmp_path, ARM.replace(before, after), 'other.xml')
    assert not differing(compare(robot, tmp_path / 'machine.xml')[1])
    found = differing(compare(robot, other)[1])
    assert re.fullmatch(where, found[what].where)
    assert found[what].here != found[what].there


def test_loops_that_are_not_those_of_the_file_are_found(tmp_path):
    robot = read(written(tmp_path, five_bar()))
    moved = five_bar().replace('name="a" pos="0.3 0 0"', 'name="a" pos="0.3001 0 0"')
    found = differing(compare(robot, written(tmp_path, moved, 'moved.xml'))[1])
    assert 5e-5 < found['loops'].there < 1e-4
    ended = five_bar().replace('name="left_elbow"', 'name="left_elbow" range="-9 99"')
    found = differing(compare(robot, written(tmp_path, ended, 'ended.xml'))[1])
    assert {each.where for each in found.values()} == {'left_elbow'}
    assert found['greatest travel'].there == pytest.approx(math.radians(99.0))
    open_chain = re.sub('<equality>.*</equality>', '', five_bar())
    found = differing(compare(robot, written(tmp_path, open_chain, 'open.xml'))[1])
    assert found['idle motions'].there == 2


def test_what_differs_is_told_and_is_a_failure(tmp_path, capsys):
    path = written(tmp_path, ARM.replace('<mujoco>', '<mujoco><option density="1000"/>'))
    assert main(['verify', '--set', f'robot_model={path}']) == 1
    first, second = capsys.readouterr().out.splitlines()
    version = re.escape(mujoco.__version__)
    head = rf'machine\.xml beside MuJoCo {version}, 6 postures near home: differs: fluid by '
    assert re.fullmatch(head + r'\S+ N( m)? at [se] \(0 here, \S+ there\)', first)
    assert second == 'machine: its functions agree with each other'


def test_what_agrees_is_told_with_its_figure(tmp_path, capsys):
    path = written(tmp_path, ARM)
    assert main(['verify', '--set', f'robot_model={path}', '--format', 'json']) == 0
    rows = json.loads(capsys.readouterr().out)
    of_file = {row['what']: row for row in rows if row['function'] == 'file'}
    end = of_file['least travel']
    assert end['here'] == end['there'] == pytest.approx(math.radians(-1.0))
    assert (end['where'], end['unit'], end['agrees']) == ('s', 'rad', True)
    assert main(['verify', '--set', f'robot_model={path}']) == 0
    assert re.search(r'near home: agrees, \d\.\de-1\d\n', capsys.readouterr().out)
    assert pr.verify(robot_model=str(path)).agrees.all()
    assert 'file' in set(pr.verify(robot_model=str(path)).function)


URDF = """<robot name="a"><link name="b"/><joint name="j" type="revolute"><parent link="b"/>
<child link="l"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="3" velocity="2"/>
<dynamics damping="0.5" friction="0.2"/></joint><link name="l"><inertial><origin xyz="0.1 0 0"/>
<mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link>
</robot>"""


def test_a_file_of_which_there_is_no_engine_says_so(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, 'pinocchio', None)
    path = written(tmp_path, URDF, 'one.urdf')
    assert main(['verify', '--set', f'robot_model={path}']) == 0
    wanted = 'not compared with an engine: Pinocchio is not installed; pip install pin'
    assert capsys.readouterr().out.splitlines()[0] == wanted


def test_what_mujoco_does_not_take_is_told(tmp_path):
    mesh = '<asset><mesh name="m" file="none.stl"/></asset>'
    path = written(tmp_path, ARM.replace('<mujoco>', f'<mujoco>{mesh}'))
    with pytest.raises(InputError, match=r'MuJoCo does not take it: .*none\.stl'):
        compare(read(path), path)


def test_a_urdf_is_held_against_pinocchio(tmp_path):
    pytest.importorskip('pinocchio')
    robot = read(written(tmp_path, URDF, 'one.urdf'))
    engine, found = compare(robot, tmp_path / 'one.urdf')
    assert engine.startswith('Pinocchio') and not differing(found)
    assert {'inertia', 'greatest rate'} <= {each.what for each in found}
    for before, after, what in [
        ('mass value="1"', 'mass value="2"', 'inertia'),
        ('damping="0.5"', 'damping="0.6"', 'dampers'),
        ('velocity="2"', 'velocity="3"', 'greatest rate'),
        ('lower="-1"', 'lower="-2"', 'least travel'),
    ]:
        other = written(tmp_path, URDF.replace(before, after), 'other.urdf')
        assert what in differing(compare(robot, other)[1])


@pytest.fixture
def descriptions(monkeypatch):
    """The script that holds folders of descriptions against engines."""
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / 'benchmarks')
    return importlib.import_module('descriptions')


@pytest.mark.parametrize('name', FEATURES)
def test_what_people_write_in_mjcf_is_obeyed(name, tmp_path, descriptions):
    path = written(tmp_path, FEATURES[name])
    row = descriptions.row_of(path, tmp_path)
    assert not row.refused and max(each.share for each in row.compared) < 1e-12


def test_a_folder_of_files_is_a_table(tmp_path, descriptions, capsys):
    written(tmp_path, ARM, 'agrees.xml')
    written(tmp_path, '<mujoco><worldbody/></mujoco>', 'refused.xml')
    assert descriptions.main([str(tmp_path)]) == 0
    first, _, agrees, refused = capsys.readouterr().out.splitlines()
    assert first == '2 files: 1 agree, 0 differ, 1 are refused'
    assert re.fullmatch(r' *agrees\.xml( +(0|\de-1\d)){3} *', agrees)
    assert refused.split(None, 1)[0] == 'refused.xml' and 'no joints that move' in refused
    written(tmp_path, ARM.replace('<mujoco>', '<mujoco><option density="9"/>'), 'fluid.xml')
    assert descriptions.main([str(tmp_path), '--format', 'markdown']) == 1
    assert re.search(r'\| fluid\.xml .*\| fluid by \S+ N', capsys.readouterr().out)
