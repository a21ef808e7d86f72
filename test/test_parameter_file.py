"""Parameter files in both forms say the same; what is for no node of the suite is left out."""

import pytest

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import yaml_file

PLAIN = 'law: smc\ncircle:\n  radius: 0.02\nsmc.z: 21.0\n'
OF_ROS = """
/**:
  ros__parameters:
    law: smc
    use_sim_time: false
    qos_overrides: {/clock: {subscription: {depth: 1}}}
    smc.z: 1.0
trajectory:
  ros__parameters:
    circle: {radius: 0.02}
/left/controller:
  ros__parameters:
    smc: {z: 21.0}
    granted.realtime: none
    custom_laws: []
"""


@pytest.fixture
def file(tmp_path):
    return tmp_path / 'my.yaml'


@pytest.mark.parametrize('text', [PLAIN, OF_ROS])
def test_both_forms_give_the_same(file, text, caplog):
    file.write_text(text)
    found = {'law': 'smc', 'circle.radius': 0.02, 'smc.z': 21.0}
    assert yaml_file.read_parameter_file(file) == found and not caplog.messages


def test_namespaces_are_looked_into(file):
    file.write_text('left:\n  cell:\n    plant:\n      ros__parameters: {period: 0.002}\n')
    assert yaml_file.read_parameter_file(file) == {'period': 0.002}


def test_a_node_wins_over_all_wherever_it_stands(file):
    file.write_text(
        '/plant: {ros__parameters: {period: 0.002}}\n/**: {ros__parameters: {period: 0.005}}\n'
    )
    assert yaml_file.read_parameter_file(file) == {'period': 0.002}


def test_nodes_of_others_are_left_out_with_a_warning(file, caplog):
    file.write_text('/rviz: {ros__parameters: {a: 1}}\n/plant: {ros__parameters: {period: 0.01}}')
    assert yaml_file.read_parameter_file(file) == {'period': 0.01}
    assert caplog.messages == [
        f'{file}: /rviz is not a node of the suite; its parameters are left out'
    ]


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        (
            '/a/plant: {ros__parameters: {period: 0.002}}\n'
            '/b/plant: {ros__parameters: {period: 0.005}}\n',
            'period is 0.002 for /a/plant and 0.005 for /b/plant',
        ),
        (
            '/**: {ros__parameters: {law: pid}}\n/*: {ros__parameters: {law: smc}}\n',
            'law is pid for /** and smc for /*',
        ),
        ('/**: {ros__parameters: {law: pid}}\nlaw: smc\n', 'law stands outside ros__parameters'),
        ('ros__parameters: {law: pid}\n', 'must stand under the name of a node, or /**'),
        ('custom_laws: [evil.py]\n', 'custom_laws is code: give it by --set custom_laws=[FILE]'),
        ('custom_robots: [evil.py]\n', 'custom_robots is code'),
        ('custom_trajectories: [evil.py]\n', 'custom_trajectories is code'),
        ('/plant: {ros__parameters: {custom_robots: [evil.py]}}\n', 'custom_robots is code'),
    ],
)
def test_what_is_wrong_is_said(file, text, reason):
    file.write_text(text)
    with pytest.raises(InputError) as caught:
        yaml_file.read_parameter_file(file)
    assert str(caught.value).startswith(str(file)) and reason in str(caught.value)
