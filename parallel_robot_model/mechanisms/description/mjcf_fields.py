"""All that a compiled model of MuJoCo says, and what becomes of it.

Each field of `MjModel` and `MjOption` stands here once: as read, as without effect on motion, or
with what people are told where its value is another one than that which means nothing. A test
holds the table to the oldest and the newest release; fields of a release that is newer still are
told by their names.
"""

from __future__ import annotations

from collections.abc import Iterator
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from parallel_robot_model.mechanisms.description.parts import listed

# What `mechanisms.description.mjcf` reads.
READ = """
body_parentid body_pos body_quat body_ipos body_iquat body_mass body_inertia body_gravcomp
jnt_type jnt_qposadr jnt_dofadr jnt_bodyid jnt_limited jnt_actfrclimited jnt_pos jnt_axis
jnt_stiffness jnt_stiffnesspoly jnt_range jnt_actfrcrange qpos0 qpos_spring
dof_frictionloss dof_armature dof_damping dof_dampingpoly
eq_type eq_obj1id eq_obj2id eq_objtype eq_active0 eq_data
tendon_type tendon_adr tendon_num tendon_limited tendon_range tendon_stiffness
tendon_stiffnesspoly tendon_damping tendon_dampingpoly tendon_armature tendon_frictionloss
tendon_lengthspring wrap_objid wrap_prm
actuator_trntype actuator_trnid actuator_dyntype actuator_dynprm actuator_gaintype
actuator_gainprm actuator_biastype actuator_ctrllimited actuator_ctrlrange actuator_ctrladr
actuator_forcelimited actuator_forcerange actuator_actlimited actuator_actrange actuator_gear
actuator_outadr actuator_delay actuator_damping actuator_dampingpoly actuator_armature
actuator_group
site_bodyid site_pos site_quat key_qpos
opt.gravity opt.wind opt.density opt.viscosity opt.disableflags opt.disableactuator
"""

# What does not move a robot that touches nothing: pictures, sensors, contacts, the solver, tables
# that MuJoCo makes of the rest. `geom_*` count by the inertia that they give to bodies.
INERT = """
n* *adr *num *_user *_group *_rgba *_matid *_margin *_sol[ri]* *_invweight0 *_length0
bvh_* oct_* cam_* exclude_* flex_* flexedge_* geom_* hfield_* light_* mat_* mesh_* numeric_* pair_*
paths sensor_* signature skin_* stat tex_* text_* tuple_* vis plugin* tree_* ten_J_* efm* B_* D_*
M_* map* flg_* site_* key_* dof_M0 dof_length dof_bodyid dof_jntid dof_parentid dof_treeid
body_rootid body_weldid body_treeid body_simple body_sameframe body_subtreemass body_contype
body_conaffinity jnt_actuatorid tendon_treeid tendon_actfrcrange tendon_width tendon_actuatorid
wrap_type actuator_ctrlspec actuator_actearly actuator_history actuator_acc0
actuator_lengthrange actuator_cranklength actuator_biasprm actuator_plugin
opt opt.timestep opt.impratio opt.*tolerance opt.magnetic opt.o_* opt.integrator opt.cone
opt.jacobian opt.solver opt.*iterations opt.enableflags opt.sdf_* opt.apirate
"""

# What is left out: the value that means nothing, and what people are told.
REPORTED = {
    'body_mocapid': (-1, 'bodies that mocap moves stand still: {}'),
    'body_plugin': (-1, 'plugins of bodies are left out: {}'),
    'jnt_actgravcomp': (0, 'gravcomp is no load of the motors of joints: {}'),
    'jnt_springyield': (0, 'the springs of joints never yield: {}'),
    'tendon_springyield': (0, 'the springs of tendons never yield: {}'),
    'tendon_actfrclimited': (0, 'actuatorfrcrange of tendons is left out: {}'),
}
PREFIXES = {'body': 'body', 'jnt': 'joint', 'tendon': 'tendon'}  # to what MuJoCo calls them


def unread(model: Any) -> Iterator[str]:
    """What is left out of a compiled model, one line for each field."""
    for field, (nothing, text) in REPORTED.items():
        values = getattr(model, field, None)
        if values is not None and len(found := np.flatnonzero(values != nothing)):
            part = getattr(model, PREFIXES[field.partition('_')[0]])
            yield text.format(listed(part(i).name or str(i) for i in found))
    known = (*READ.split(), *INERT.split(), *REPORTED)
    unknown = (name for name in fields(model) if not any(fnmatchcase(name, k) for k in known))
    if names := sorted({*unknown}):
        yield f'fields that a newer MuJoCo has are not known: {listed(names)}'


def fields(model: Any) -> list[str]:
    """Names of the fields of a compiled model, those of its options with ``opt.``."""
    names = [name for name in dir(model) if not callable(getattr(model, name, None))]
    options = [f'opt.{name}' for name in dir(model.opt) if not callable(getattr(model.opt, name))]
    return [name for name in (*names, *options) if not name.rpartition('.')[2].startswith('_')]
