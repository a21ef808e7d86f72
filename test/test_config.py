"""Files, scenarios and overrides become one dictionary in which no typo passes."""

import shutil
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml

from parallel_robot.bags import trust
from parallel_robot_control import configuration
from parallel_robot_control.laws import LAWS
from parallel_robot_control.safety.faults import SafetyParameters
from parallel_robot_model.common.errors import InputError, UnknownNameError
from parallel_robot_model.configuration import config, config_files, yaml_file
from parallel_robot_model.configuration.fields import group
from parallel_robot_model.messages import topics
from parallel_robot_model.robots import registry
from parallel_robot_model.robots.joint_load import FrictionParameters
from parallel_robot_model.robots.registry import robot_of
from parallel_robot_sim.configuration import configure, configure_plant
from parallel_robot_sim.plant import PlantParameters
from trajectory_gen.configuration import motions_of
from trajectory_gen.shapes import SHAPES
from trajectory_gen.trajectory import TrajectoryParameters


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Return a copy of the configuration that may be changed."""
    copy = tmp_path / 'config'
    shutil.copytree(config.directory(), copy)
    monkeypatch.setattr(config, 'directory', lambda: copy)
    monkeypatch.setattr(config_files, 'directory', lambda: copy)
    return copy


@pytest.mark.parametrize('scenario', config.scenarios())
def test_every_scenario_gives_complete_groups(scenario):
    values = configuration.resolve(scenario)
    for kind, prefix in [
        (PlantParameters, 'plant'),
        (FrictionParameters, 'friction'),
        (TrajectoryParameters, 'trajectory'),
        *((shape.Parameters, name) for name, shape in SHAPES.items()),
        *((law.Gains, name) for name, law in LAWS.items()),
    ]:
        group(values, kind, prefix)
    for prefix in ('robot', 'true_robot'):
        robot_of(values, prefix)


def test_the_strict_parameters_are_of_ros_and_for_every_node():
    path = config.directory() / 'hardware' / 'strict.yaml'
    (nodes,) = yaml.safe_load(path.read_text()).items()
    assert nodes[0] == '/**' and set(nodes[1]) == {'ros__parameters'}
    given = config.flat(nodes[1]['ros__parameters'])
    values = config.resolve('paper_circle', given)
    assert given.items() <= values.items()
    group(values, SafetyParameters, 'safety')
    group(values, PlantParameters, 'plant')


def test_the_strict_parameters_are_tighter_than_those_of_a_desktop():
    strict = yaml.safe_load((config.directory() / 'hardware' / 'strict.yaml').read_text())
    values = config.resolve('paper_circle')
    for key, value in config.flat(strict['/**']['ros__parameters']).items():
        tighter = value and not values[key] if isinstance(value, bool) else value < values[key]
        assert tighter, key


def test_ros2_control_is_asked_for_what_the_controller_speaks_to(values):
    """Its controllers take what is below their own names; joints are those of the suite."""
    hardware = config.directory() / 'hardware'
    asked = yaml.safe_load((hardware / 'ros2_control.yaml').read_text())
    manager = asked['controller_manager']['ros__parameters']
    name = topics.COMMANDS.name.removesuffix('/commands')
    assert manager[name]['type'] == 'effort_controllers/JointGroupEffortController'
    assert manager['update_rate'] == round(1 / values['period'])
    assert asked[name]['ros__parameters']['joints'] == values['joints']
    robot = ElementTree.parse(hardware / 'topic_based.urdf').getroot()
    tree = {joint.get('name') for joint in robot.findall('joint')}
    control = robot.find('ros2_control')
    joints = {joint.get('name'): joint for joint in control.findall('joint')}
    assert list(joints) == values['joints'] and tree == {*joints}  # the order of the efforts
    for joint in joints.values():
        assert [one.get('name') for one in joint.findall('command_interface')] == ['effort']
        names = [one.get('name') for one in joint.findall('state_interface')]
        assert names == ['position', 'velocity', 'effort']


def test_the_papers_numbers_are_in_the_files(robot):
    values = config.resolve('paper_circle')
    table_1 = {
        'l1': 0.4, 'l2': 0.6, 'l3': 0.2, 'lc1': 0.2, 'lc2': 0.3, 'm1': 5.12, 'm2': 7.39,
        'mp': 3.84, 'I1': 0.091, 'I2': 0.267, 'Ip': 0.065,
    }  # fmt: skip
    table_2 = {
        'lambda': 0.9, 'G': 10, 'g': 0.01, 'Gamma1': 16, 'Gamma2': 6.5, 'gamma1': 0.5,
        'gamma2': 0.67,
    }  # fmt: skip
    assert {key: getattr(robot, key) for key in table_1} == table_1
    assert {key: values[f's_fotsmc.{key}'] for key in table_2} == table_2
    assert values['friction.viscous'] == [2.5] * 3 and values['friction.coulomb'] == [0.5] * 3
    assert values['period'] == 1e-3 and values['plant.integrator'] == 'ode3'


def test_a_scenario_inherits_from_its_base():
    base, derived = config.resolve('paper_circle'), config.resolve('circle_pi12')
    changed = {key for key in base if base[key] != derived[key]}
    assert changed == {'scenario', 'circle.phi', 'plant.initial_pose'}


def test_inheritance_goes_over_generations(files):
    (files / 'scenarios' / 'child.yaml').write_text('base: circle_pi12\ncircle.radius: 0.01\n')
    child, parent = config.resolve('child'), config.resolve('circle_pi12')
    assert child['circle.radius'] == 0.01
    assert child['circle.phi'] == parent['circle.phi']
    assert child['plant.initial_pose'] == parent['plant.initial_pose']


def test_later_wins(files):
    (files / 'scenarios' / 'own.yaml').write_text('period: 0.002\nduration: 3.0\n')
    values = config.resolve('own', {'duration': 4.0})
    assert (values['period'], values['duration'], values['scenario']) == (0.002, 4.0, 'own')


def test_the_true_robot_follows_the_robot_unless_set():
    values = config.resolve('paper_circle', {'robot.m1': 6.0, 'true_robot.m2': 8.0})
    assert values['true_robot.m1'] == 6.0
    assert (values['robot.m2'], values['true_robot.m2']) == (7.39, 8.0)


@pytest.mark.parametrize('change', ['resolve', 'changed'])
def test_numbers_of_numpy_become_plain(change):
    numbers = {
        'true_robot.m1': np.float64(5.13),
        'friction.coulomb': np.array([0.0, 0.5, 1.0]),
        'plant.publish_passive': np.bool_(False),
        'joints': tuple(np.array(['a', 'b', 'c'])),
    }
    base = config.resolve('paper_circle')
    values = (
        config.resolve('paper_circle', numbers)
        if change == 'resolve'
        else config.changed(base, numbers)
    )
    text = yaml.safe_dump(values)  # which refuses NumPy's
    assert yaml.safe_load(text) == base | {
        'true_robot.m1': 5.13,
        'friction.coulomb': [0.0, 0.5, 1.0],
        'plant.publish_passive': False,
        'joints': ['a', 'b', 'c'],
    }
    same = config.resolve('paper_circle', {'s_fotsmc.G': np.int64(10)})
    assert same['preset'] == 'paper'


def test_an_unknown_scenario_names_the_nearest():
    with pytest.raises(UnknownNameError, match="did you mean 'paper_circle'"):
        config.resolve('paper_cirle')


@pytest.mark.parametrize(
    ('key', 'nearest'),
    [('periot', 'period'), ('robot.m3', 'robot.m'), ('true_robot.mq', 'true_robot.m')],
)
def test_an_unknown_override_names_the_nearest(key, nearest):
    with pytest.raises(UnknownNameError, match=f"did you mean '{nearest}"):
        config.resolve('paper_circle', {key: 1.0})


@pytest.mark.parametrize('name', ['nope', '3.0', 'zzz'])
def test_what_is_near_to_nothing_has_no_hint(name):
    with pytest.raises(UnknownNameError) as caught:
        config.resolve(name)
    assert 'did you mean' not in str(caught.value) and 'paper_circle' in str(caught.value)
    for choices in (LAWS, config.resolve('paper_circle')):
        assert 'did you mean' not in str(UnknownNameError('law', name, choices))


def test_an_unknown_key_in_a_scenario_is_refused(files):
    (files / 'scenarios' / 'typo.yaml').write_text('circle:\n  radios: 0.1\n')
    with pytest.raises(UnknownNameError, match=r"'circle\.radios'.*'circle\.radius'"):
        config.resolve('typo')


def test_a_scenario_brings_no_code(files):
    (files / 'scenarios' / 'coded.yaml').write_text('custom_laws: [law.py]\n')
    with pytest.raises(
        InputError, match=r'coded\.yaml, line 1: custom_laws is given on a command line'
    ):
        config.resolve('coded')


@pytest.mark.parametrize('content', ['a: [', '', '- 1\n- 2\n'])
def test_a_broken_file_is_named(files, content):
    (files / 'scenarios' / 'broken.yaml').write_text(content)
    with pytest.raises(InputError, match=r'broken\.yaml'):
        config.resolve('broken')


@pytest.mark.parametrize(
    ('word', 'value'),
    [
        ('a=1', 1),
        ('a=0.5', 0.5),
        ('a=1e-3', 1e-3),
        ('a=[1, 2.5]', [1, 2.5]),
        ('a=true', True),
        ('a=rk4', 'rk4'),
        ('a=x=y', 'x=y'),
    ],
)
def test_words_of_the_command_line_are_yaml(word, value):
    parsed = yaml_file.parse_assignments([word])['a']
    assert parsed == value and type(parsed) is type(value)


@pytest.mark.parametrize(
    'word', ['period', '=1', 'a=[1', 'a=2026-01-01', 'a=2026-13-45', 'a=' + 5000 * '[']
)
def test_words_that_assign_nothing_are_refused(word):
    with pytest.raises(InputError):
        yaml_file.parse_assignments([word])


def test_a_group_takes_only_its_own_keys(values):
    assert group(values, FrictionParameters, 'friction').coulomb == (0.5, 0.5, 0.5)
    with pytest.raises(InputError, match=r'friction\.smoothing must be at least 0'):
        group({**values, 'friction.smoothing': -1.0}, FrictionParameters, 'friction')


@pytest.mark.parametrize('place', ['lib/python3/site-packages', '../elsewhere/site-packages'])
def test_an_installed_package_finds_its_files(tmp_path, monkeypatch, place):
    share = tmp_path / 'prefix' / 'share' / config.PACKAGE / 'config'
    shutil.copytree(config.directory(), share)
    module = tmp_path / 'prefix' / place / 'parallel_robot_model' / 'configuration' / 'config.py'
    monkeypatch.setattr(config_files, '__file__', str(module))
    if 'elsewhere' in place:
        monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path / 'prefix'))
    assert config.directory() == share


def test_a_package_without_its_files_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr(config_files, '__file__', str(tmp_path / 'a' / 'b' / 'c' / 'config.py'))
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    with pytest.raises(InputError, match='not installed'):
        config.directory()


@pytest.mark.parametrize(
    'resolve',
    [config.resolve, registry.resolve, configuration.resolve],
    ids=['base', 'model', 'control'],
)
def test_every_floor_takes_the_gains_of_a_custom_law(resolve):
    """Trajectory and plant are given them, too, and do not load the law."""
    law = {'custom_laws': [str(Path(__file__).parents[1] / 'docs' / 'example_law.py')]}
    assert resolve('paper_circle', law | {'example_law.Kp': 700.0})['example_law.Kp'] == 700.0
    with pytest.raises(UnknownNameError, match=r"'exemple_law\.Kp'"):
        resolve('paper_circle', law | {'exemple_law.Kp': 700.0})


@pytest.mark.parametrize('path', ['docs/example_law.py', '~/docs/example_law.py'])
def test_files_of_laws_are_absolute(path, monkeypatch):
    """A recorder with another current directory finds them by what the controller says."""
    root = Path(__file__).parents[1]
    monkeypatch.chdir(root)
    monkeypatch.setenv('HOME', str(root))
    values = config.resolve('paper_circle', {'custom_laws': [path]})
    assert values['custom_laws'] == [str(root / 'docs' / 'example_law.py')]
    name, _ = trust.attachment('custom_laws', *values['custom_laws'])
    assert name == 'custom_laws/example_law'


def test_a_link_is_attached_as_what_it_leads_to(tmp_path):
    law, link = tmp_path / 'mine.py', tmp_path / 'link.py'
    law.write_bytes(b'x = 1')
    link.symlink_to(law)
    assert trust.attachment('custom_laws', str(link)) == ('custom_laws/mine', b'x = 1')
    for target in ('secret', 'folder.py'):
        link.unlink()
        link.symlink_to(tmp_path / target)
        (tmp_path / target).mkdir() if target == 'folder.py' else (tmp_path / target).touch()
        with pytest.raises(InputError, match=f'link.py is no .py file but .*{target}'):
            trust.attachment('custom_laws', str(link))
    (tmp_path / 'id_rsa').touch()
    with pytest.raises(InputError, match=r'id_rsa is no \.py file'):
        trust.attachment('custom_laws', str(tmp_path / 'id_rsa'))


@pytest.mark.parametrize('names', [['a', 'b'], ['a', 'b', 'c', 'd']])
@pytest.mark.parametrize(
    'build', [configuration.configure, configure_plant, motions_of, configure]
)
def test_joints_of_another_number_are_told_before_the_lists_that_have_one_for_each(build, names):
    values = config.resolve('paper_circle', {'joints': names})
    with pytest.raises(InputError, match=r'^joints must be 3 names, one for each joint'):
        build(values)


@pytest.mark.parametrize('build', [configuration.configure, motions_of, configure])
def test_a_controller_looks_at_its_motion_too(build):
    """Also at shapes that are not used: it starts from the first pose of the motion."""
    values = config.resolve('paper_circle', {'trajectory.shape': 'hold', 'circle.radius': -1.0})
    with pytest.raises(InputError, match=r'^circle\.radius must be'):
        build(values)


def test_a_part_of_a_configuration_is_another_one_where_it_is_asked_for():
    made = configure(config.resolve('paper_circle'))
    faster = made.with_parts(loop=made.loop._replace(period=0.002))
    assert (made.loop.period, faster.loop.period) == (0.001, 0.002)
    here = made.at_pose((0.3, 0.3, 0.0))
    assert here.here == (0.3, 0.3, 0.0) and here.trajectory is not None
    for name in ('margins', 'limits', 'made_of'):
        with pytest.raises(TypeError, match=f'{name} follows from other parts'):
            made.with_parts(**{name: None})
    one, other = (configure(config.resolve('paper_circle', {'pid.Kp': Kp})) for Kp in (9.0, 8.0))
    assert made.made_of == configure(config.resolve('paper_circle')).made_of != one.made_of
    assert one.made_of != other.made_of
