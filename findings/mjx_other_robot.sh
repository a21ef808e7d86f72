#!/bin/sh
# MuJoCo and MJX of the same release make two robots of one compiled model.
#
# mujoco 3.17.0 with mujoco-mjx 3.17.0. A hinge whose motor has a rotor (armature="1e-4" behind
# gear="50") or a damper, and joints with growing damping or stiffness (damping="0.5 0.8",
# stiffness="0 5"), all of them plain MJCF. `mjx.put_model` takes the model without an error or a
# warning, and MJX computes without these: the arm accelerates 3.7 times as fast as in MuJoCo.
#
# Our guess was this for the rotor; of springs and dampers we had none.
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
python3 -m venv "$dir"
"$dir/bin/pip" install -q mujoco==3.17.0 mujoco-mjx==3.17.0 jax==0.10.2 jaxlib==0.10.2
JAX_PLATFORMS=cpu "$dir/bin/python" - <<'EOF'
import sys
import warnings

import jax

jax.config.update('jax_enable_x64', True)
warnings.simplefilter('error')  # a warning would be a change

import mujoco
from mujoco import mjx

ARM = """<mujoco><option gravity="0 0 0"/><worldbody><body>
<joint name="j" axis="0 1 0" {}/><geom size="0.1" mass="1" pos="0.3 0 0"/></body></worldbody>
<actuator><motor joint="j" gear="50" {}/></actuator></mujoco>"""
CASES = {
    'rotor, armature="1e-4"': ('', 'armature="1e-4"', 2.907, 10.638),
    'damper of the motor, damping="1e-3"': ('', 'damping="1e-3"', -15.957, 10.638),
    'damping="0.5 0.8"': ('damping="0.5 0.8"', '', -3.191, 5.319),
    'stiffness="0 5"': ('stiffness="0 5"', '', 8.511, 10.638),
}
same = True
for name, (joint, motor, wanted, wanted_of_mjx) in CASES.items():
    model = mujoco.MjModel.from_xml_string(ARM.format(joint, motor))
    data = mujoco.MjData(model)
    data.ctrl[:] = 0.02
    data.qpos[:] = 0.2 if 'stiffness' in joint else 0.0
    data.qvel[:] = 1.0 if 'damping' in joint + motor else 0.0
    mujoco.mj_forward(model, data)
    there = mjx.forward(mjx.put_model(model), mjx.put_data(model, data))
    found = round(float(data.qacc[0]), 3), round(float(there.qacc[0]), 3)
    print(f'{name}: {found[0]} rad/s^2 in MuJoCo, {found[1]} in MJX')
    same &= found == (wanted, wanted_of_mjx)
print('as described' if same else 'CHANGED')
sys.exit(not same)
EOF
