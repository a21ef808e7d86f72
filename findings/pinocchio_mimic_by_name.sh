#!/bin/sh
# Whether Pinocchio reads a joint that follows another depends on their names.
#
# pin 4.1.0, buildModelFromXML(..., mimic=True). Two fingers of a gripper slide from one palm, and
# one of them has <mimic joint="..."/> of the other. Where "left" leads "right" the model has one
# degree of freedom; where "right" leads "left", the same file but for the names, it is refused:
# "The parent joint of the mimic joint is not in the kinematic tree". The leader must come first in
# the alphabet; the order in the file does not count. MuJoCo 4.0.0 reads all of them.
#
# Our guess was that the order in the file decides: it was the counterweight of a surgical robot,
# which follows its insertion; called "weight" it was read.
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
python3 -m venv "$dir"
"$dir/bin/pip" install -q pin==4.1.0 mujoco==4.0.0
"$dir/bin/python" - <<'EOF'
import sys

import mujoco
import pinocchio

FINGER = """<joint name="{0}" type="prismatic"><parent link="palm"/><child link="{0}_finger"/>
<axis xyz="0 {1} 0"/><limit lower="0" upper="0.04" effort="20" velocity="0.2"/>{2}</joint>
<link name="{0}_finger"><inertial><mass value="0.1"/>
<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
REFUSED = 'The parent joint of the mimic joint is not in the kinematic tree'
same = True
for leader, follower, taken in (('left', 'right', True), ('right', 'left', False)):
    fingers = [
        FINGER.format(leader, 1, ''),
        FINGER.format(follower, -1, f'<mimic joint="{leader}"/>'),
    ]
    for order, written in (('first', fingers), ('last', fingers[::-1])):
        text = f'<robot name="gripper"><link name="palm"/>{"".join(written)}</robot>'
        try:
            told = f'{pinocchio.buildModelFromXML(text, mimic=True).nv} degree of freedom'
        except ValueError as error:
            told = str(error)
        model = mujoco.MjModel.from_xml_string(text)
        print(f'{leader} leads {follower}, {order} in the file: Pinocchio: {told}; '
              f'MuJoCo: {model.nv} joints, {model.neq} equality')
        wanted = '1 degree of freedom' if taken else REFUSED
        same &= told == wanted and (model.nv, model.neq) == (2, 1)
print('as described' if same else 'CHANGED')
sys.exit(not same)
EOF
