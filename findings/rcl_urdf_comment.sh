#!/bin/sh
# A URDF as a parameter on the command line: a comment in it decides whether the node starts.
#
# ros-jazzy-rclpy 7.1.6. Pages of robot_state_publisher and ros2_control give a node its description
# as -p robot_description:="$(cat robot.urdf)". rcl takes the value for YAML of one line, so an
# XML comment that says "<!-- units: m, kg -->" is a mapping to it, and rclpy.init raises RCLError,
# "Failed to parse global arguments". The same file without the space after the colon, or with the value in
# quotes of YAML, is taken, and the text comes back as it was.
#
# Our guess was that what begins with < is a text.
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
python3 -m venv "$dir"
"$dir/bin/pip" install -q 'ros-jazzy-rclpy[fastrtps]==7.1.6'
cd "$dir"
ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST ROS_LOG_DIR="$dir" bin/python - <<'EOF'
import sys

import rclpy
from rclpy.node import Node

ROBOT = '<robot name="arm"><!-- units:{}m, kg --><link name="base"/></robot>'


def told(value):
    """What a node has as its description; None: rcl refuses the command line."""
    context = rclpy.Context()
    words = ['--ros-args', '-p', f'robot_description:={value}']
    try:
        rclpy.init(args=words, context=context, domain_id=87)
    except Exception as error:
        print(f'  {type(error).__name__}')
        return None
    try:
        node = Node('reader', context=context)
        text = node.declare_parameter('robot_description', '').value
        node.destroy_node()
        return text
    finally:
        rclpy.shutdown(context=context)


same = True
for what, text, quoted, taken in (
    ('colon and space', ROBOT.format(' '), False, False),
    ('colon alone', ROBOT.format(''), False, True),
    ('colon and space, in quotes of YAML', ROBOT.format(' '), True, True),
):
    found = told(f"'{text}'" if quoted else text)
    print(f'{what}: {"refused" if found is None else "taken"}')
    same &= found == (text if taken else None)
print('as described' if same else 'CHANGED')
sys.exit(not same)
EOF
