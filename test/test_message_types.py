"""Types from installed interface packages, and from nowhere else."""

import pytest
from sensor_msgs.msg import JointState

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.nodes.connections import INDEX, message_class


def test_a_type_that_is_installed_is_found():
    assert message_class('sensor_msgs/msg/JointState') is JointState


@pytest.mark.parametrize(
    'name',
    [
        'gadget/msg/X', 'sensor_msgs/msg/Gadget', 'sensor_msgs/msg/__doc__', 'os/path/join',
        '../gadget/msg/X', 'gadget', '', 'sensor_msgs/msg/JointState/x', 'x' * 10**6,
    ],
)  # fmt: skip
def test_no_other_module_is_imported(name, tmp_path, monkeypatch):
    """Not even one on the path that has the name of a package and of a type."""
    trap = tmp_path / 'gadget' / 'msg'
    trap.mkdir(parents=True)
    (trap / '__init__.py').write_text('raise AssertionError("imported")')
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(InputError, match=r'no type .* is installed') as caught:
        message_class(name)
    assert len(str(caught.value)) < 300


def test_a_package_that_ros_knows_is_one(tmp_path, monkeypatch):
    (tmp_path / INDEX).mkdir(parents=True)
    (tmp_path / INDEX / 'widget').touch()
    (tmp_path / 'widget').mkdir()
    (tmp_path / 'widget' / 'msg.py').write_text('class Gear: pass')
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'/nowhere:{tmp_path}')
    assert message_class('widget/msg/Gear').__name__ == 'Gear'
