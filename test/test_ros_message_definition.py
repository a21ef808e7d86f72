"""Definitions beside those of rosbags and of the installed files."""

import sys
from pathlib import Path

import pytest
from bags import STORE
from rosbags.typesys import get_types_from_msg

from parallel_robot.bags.messages import message_types
from parallel_robot.bags.writing.ros_topics import concatenate, definition
from parallel_robot_model.common.errors import InputError


@pytest.mark.parametrize(
    'name',
    ['std_msgs/msg/String', 'sensor_msgs/msg/JointState', 'visualization_msgs/msg/MarkerArray'],
)
def test_installed_files_say_what_rosbags_knows(name):
    text = concatenate(name, [Path(sys.prefix)])
    types = get_types_from_msg(text, name)
    assert all(types[part][1] == STORE.fielddefs[part][1] for part in types)
    known = get_types_from_msg(definition(name), name)
    assert types.keys() == known.keys()


def test_parts_are_found_wherever_they_are_installed(tmp_path):
    files = {
        'one/share/odd_msgs/msg/Whole.msg': """
            # Part and other/Nothing in a comment
            uint8 KIND=3
            string<=7 name 'x'
            Part[<=4] parts      # of the same package
            std_msgs/Header header
            Part again
        """,
        'two/share/odd_msgs/msg/Part.msg': 'float64[3] values\nstd_msgs/msg/Empty empty\n',
        'two/share/std_msgs/msg/Header.msg': 'string frame_id\n',
        'two/share/std_msgs/msg/Empty.msg': '',
    }
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    text = concatenate('odd_msgs/msg/Whole', [tmp_path / 'one', tmp_path / 'two'])
    assert [line for line in text.splitlines() if line.startswith('MSG')] == [
        'MSG: odd_msgs/Part',
        'MSG: std_msgs/Header',
        'MSG: std_msgs/Empty',
    ]
    assert text.startswith(files['one/share/odd_msgs/msg/Whole.msg'])
    assert set(get_types_from_msg(text, 'odd_msgs/msg/Whole')) == {
        'odd_msgs/msg/Whole', 'odd_msgs/msg/Part', 'std_msgs/msg/Header', 'std_msgs/msg/Empty',
    }  # fmt: skip


@pytest.mark.parametrize('name', ['odd_msgs/msg/Absent', 'odd_msgs/action/Do_Feedback', 'odd'])
def test_what_is_not_installed_as_msg_is_refused(name):
    with pytest.raises(InputError, match=r'not installed as a \.msg file'):
        definition(name)


def test_the_types_of_the_suite_are_those_of_rosbags():
    known = {name: message_types.message_type(name) for name in message_types.from_rosbags()}
    assert known == message_types.from_rosbags(), (
        'python -m parallel_robot.bags.messages.message_types'
    )
