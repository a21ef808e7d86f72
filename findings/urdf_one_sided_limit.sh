#!/bin/sh
# One end of travel in a URDF: three readers, three robots.
#
# pin 4.1.0, mujoco 4.0.0, yourdfpy 0.0.60. The specification of <limit> says that lower and upper
# are optional and default to 0. Of <limit upper="1" effort="3" velocity="2"/> Pinocchio makes a
# travel from 0 to 1, as specified. MuJoCo compiles the range 0 to 1, and leaves it off: the joint
# turns without end, though the file has a limit. In yourdfpy the lower end is None and the upper
# one 1. The same with lower="-1" alone. None of them says a word.
#
# Our guess was that they differ, not that MuJoCo keeps the numbers of a limit that it leaves off.
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
python3 -m venv "$dir"
"$dir/bin/pip" install -q pin==4.1.0 mujoco==4.0.0 yourdfpy==0.0.60
cd "$dir"
bin/python - <<'EOF'
import sys
from pathlib import Path

import mujoco
import pinocchio
import yourdfpy

ARM = """<robot name="arm"><link name="base"/><joint name="j" type="revolute">
<parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit {} effort="3" velocity="2"/></joint><link name="arm"><inertial><origin xyz="0.1 0 0"/>
<mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
</robot>"""
CASES = {
    'lower="-1" upper="1"': ((-1, 1), (True, -1, 1), (-1, 1)),
    'upper="1"': ((0, 1), (False, 0, 1), (None, 1)),
    'lower="-1"': ((-1, 0), (False, -1, 0), (-1, None)),
}
same = True
for limit, wanted in CASES.items():
    Path('arm.urdf').write_text(ARM.format(limit))
    of_pin = pinocchio.buildModelFromUrdf('arm.urdf')
    of_mujoco = mujoco.MjModel.from_xml_path('arm.urdf')
    of_yourdfpy = yourdfpy.URDF.load('arm.urdf').joint_map['j'].limit
    found = (
        (of_pin.lowerPositionLimit[0], of_pin.upperPositionLimit[0]),
        (bool(of_mujoco.jnt_limited[0]), *of_mujoco.jnt_range[0]),
        (of_yourdfpy.lower, of_yourdfpy.upper),
    )
    (low, high), (limited, first, last), (lower, upper) = found
    print(f'{limit}: Pinocchio {low:g} to {high:g}, MuJoCo {first:g} to {last:g}'
          f'{"" if limited else ", not limited"}, yourdfpy {lower} to {upper}')
    same &= found == wanted
print('as described' if same else 'CHANGED')
sys.exit(not same)
EOF
