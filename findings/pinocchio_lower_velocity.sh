#!/bin/sh
# Pinocchio reads a URDF's velocity="2" as least rate 2, greatest rate 2.
#
# pin 4.1.0. A model has lower and upper limits of positions, efforts and rates. Of
# <limit lower="-1" upper="1" effort="3" velocity="2"/> the efforts are -3 to 3 and the positions
# -1 to 1, but the rates are 2 to 2: lowerVelocityLimit has the sign of the upper one. A program
# that clips rates to these two moves each joint at its full speed. An unlimited (continuous)
# joint has it likewise.
#
# We had no guess: it stood beside the efforts when we looked for other limits.
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
python3 -m venv "$dir"
"$dir/bin/pip" install -q pin==4.1.0
"$dir/bin/python" - <<'EOF'
import sys

import numpy as np
import pinocchio

ARM = """<robot name="arm"><link name="base"/><joint name="j" type="{}">
<parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="3" velocity="2"/></joint><link name="arm"><inertial>
<origin xyz="0.1 0 0"/><mass value="1"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""
same = True
for kind in ('revolute', 'prismatic', 'continuous'):
    model = pinocchio.buildModelFromXML(ARM.format(kind))
    effort = model.lowerEffortLimit[0], model.upperEffortLimit[0]
    rate = model.lowerVelocityLimit[0], model.upperVelocityLimit[0]
    clipped = np.clip(0.0, *rate)
    print(f'{kind}: efforts {effort[0]:g} to {effort[1]:g}, rates {rate[0]:g} to {rate[1]:g}; '
          f'a rate of 0 is clipped to {clipped:g}')
    same &= effort == (-3, 3) and rate == (2, 2)
print('as described' if same else 'CHANGED')
sys.exit(not same)
EOF
