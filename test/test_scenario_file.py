"""Scenarios of one's own are files, with the same layers as the shipped ones."""

import pytest

from parallel_robot_model.common.errors import InputError, UnknownNameError
from parallel_robot_model.configuration import config, config_files


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Write a file into the current directory; return its path as a text."""
    monkeypatch.chdir(tmp_path)

    def make(text, name='mine.yaml'):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
        return str(path)

    return make


def test_a_file_is_a_scenario_with_the_name_of_its_file(write):
    mine = write('base: paper_circle\ncircle.radius: 0.02\n')
    values = config.resolve(mine, {'duration': 3.0})
    shipped = config.resolve('paper_circle', {'duration': 3.0})
    changed = {key: value for key, value in values.items() if shipped[key] != value}
    assert changed == {'scenario': 'mine', 'circle.radius': 0.02}


@pytest.mark.parametrize('path', ['mine.yaml', './mine.yaml', '~/mine.yaml', 'x/../mine.yaml'])
def test_ways_to_name_it(write, path, tmp_path, monkeypatch):
    monkeypatch.setenv('HOME', str(tmp_path))
    (tmp_path / 'x').mkdir()
    write('period: 0.002\n')
    values = config.resolve(path)
    assert (values['scenario'], values['period']) == ('mine', 0.002)


@pytest.mark.parametrize('name', ['v1.2.yml', 'odd', 'with blank.yaml'])
def test_the_suffix_is_no_part_of_the_name(write, name):
    values = config.resolve(write('period: 0.002\n', name))
    assert values['scenario'] == name.removesuffix('.yml').removesuffix('.yaml')


def test_it_starts_from_another(write):
    write('base: heavy_circle\ncircle.radius: 0.01\nrobot.m1: 5.0\n', 'sub/first.yml')
    write('base: sub/first.yml\nline.duration: 3.0\ncircle.radius: 0.02\n', 'second.yaml')
    write('base: ../second.yaml\nline.duration: 4.0\n', 'sub/third.yaml')
    values, shipped = config.resolve('sub/third.yaml'), config.resolve('heavy_circle')
    changed = {key: value for key, value in values.items() if shipped[key] != value}
    expected = {'scenario': 'third', 'circle.radius': 0.02, 'robot.m1': 5.0, 'line.duration': 4.0}
    assert changed == expected
    assert values['true_robot.m1'] == shipped['true_robot.m1']  # set by the base


def test_another_robot(write):
    values = config.resolve(write('robot_model: axes\ntrajectory.shape: move\n'))
    assert len(values['joints']) == 5 and values['trajectory.shape'] == 'move'


def test_the_file_of_a_shipped_scenario_is_that_scenario():
    path = str(config.directory() / 'scenarios' / 'paper_line.yaml')
    assert config.resolve(path) == config.resolve('paper_line')


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('base: mine.yaml\n', 'lead in a circle: mine.yaml -> mine.yaml'),
        ('base: two.yaml\n', 'lead in a circle: mine.yaml -> two.yaml -> mine.yaml'),
        ('base: deep0.yaml\n', 'are more than 20'),
        ('base: paper_cirle\n', "mine.yaml, line 1: unknown base 'paper_cirle'; did you mean"),
        ('base: gone.yaml\n', 'gone.yaml does not exist'),
        ('base: [a]\n', 'base must be the name or the path of a scenario'),
        ('base: /\n', '/ is not a file'),
        ('circle.radios: 1\n', "line 1: unknown parameter 'circle.radios'; did you mean 'circle."),
        ('circle:\n', 'mine.yaml, line 1: unknown parameter'),
        ('scenario: other\n', 'a scenario has the name of its file'),
        ('custom_laws: [a.py]\n', 'custom_laws is given on a command line alone: it is code'),
        ('custom_robots: [a.py]\n', 'custom_robots is given on a command line alone'),
        ('custom_trajectories: [a.py]\n', 'custom_trajectories is given on a command line alone'),
        ('/**: {ros__parameters: {law: pid}}\n', 'is a parameter file of ROS'),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said(write, text, reason):
    write('base: mine.yaml\n', 'two.yaml')
    for k in range(25):
        write(f'base: deep{k + 1}.yaml\n', f'deep{k}.yaml')
    with pytest.raises(InputError) as caught:
        config.resolve(write(text))
    assert reason in str(caught.value) and '\n' not in str(caught.value)


@pytest.mark.parametrize(
    ('name', 'reason'),
    [
        ('paper_circle.yaml', 'there is already a scenario paper_circle; rename the file'),
        ('a\nb.yaml', 'the name of a scenario has at most 200 characters'),
        ('x' * 201 + '.yaml', 'the name of a scenario has at most 200 characters'),
    ],
)
def test_names_that_cannot_be(write, name, reason):
    path = write('', name)
    with pytest.raises(InputError, match=reason):
        config.resolve(path)


@pytest.mark.parametrize('path', ['gone.yaml', 'x/', '~nobody_of_this_name/a.yaml', 'a\0b.yaml',
                                  '/dev/zero', 'y' * 5000 + '/'])  # fmt: skip
def test_what_is_not_there(write, path):
    with pytest.raises(InputError):
        config.resolve(path)


def test_a_name_without_suffix_is_never_a_file(write):
    write('period: 0.002\n', 'mine')
    with pytest.raises(UnknownNameError, match="unknown scenario 'mine'"):
        config.resolve('mine')


def test_another_scenario_is_no_parameter(write):
    mine = write('period: 0.002\n')
    for same in (mine, 'mine', './mine.yaml'):
        assert config.resolve('mine.yaml', {'scenario': same})['scenario'] == 'mine'
    for other in ('paper_circle', 'other.yaml', 5):
        with pytest.raises(InputError, match='the scenario is mine; it cannot be changed'):
            config.resolve(mine, {'scenario': other})


@pytest.mark.parametrize('scenario', [*config.scenarios(), 'mine.yaml'])
def test_each_source_has_the_value_that_counts(write, scenario):
    write('base: heavy_circle\ns_fotsmc.G: 12.0\nrobot.m2: 7.0\n')
    changed = {'law': 'smc', 'robot.m1': 6.0} if scenario == 'mine.yaml' else {}
    values, sources = config.resolve_with_sources(scenario, changed)
    assert sources.keys() == values.keys() and values == config.resolve(scenario, changed)
    for key, source in sources.items():
        if key in ('scenario', 'preset'):
            continue
        if key in ('robot_description', 'robot_compiled'):
            assert source == 'robot_model'
        elif source == 'robot_description':
            assert values[source].lstrip().startswith('<mujoco')
        elif source in values:
            assert values[source] == values[key] and key == f'true_{source}'
        elif source == config.OVERRIDE:
            assert changed[key] == values[key]
        else:  # relative to config/, or absolute
            found = config_files.flat(config_files.read(config.directory() / source))
            assert found[key] == values[key]
    if scenario == 'mine.yaml':
        assert (values['preset'], sources['preset']) == ('custom', 's_fotsmc.G')
        assert sources['robot.m2'].endswith('/mine.yaml')
        assert sources['true_robot.m1'] == 'scenarios/heavy_circle.yaml'
        assert sources['true_robot.l1'] == 'robot.l1'
