"""A mechanism as a tree of joints and contacts of Pinocchio."""

import numpy as np
import pinocchio as pin

from parallel_robot_model.mechanisms.mechanism import ORIENTATION, POINT


def tree(m):
    """The joints of a mechanism as a model of Pinocchio."""
    found = pin.Model()
    found.gravity.linear = m.gravity
    for i in range(len(m.parent)):
        kind = pin.JointModelRevoluteUnaligned if m.turns[i] else pin.JointModelPrismaticUnaligned
        place = pin.SE3(m.rotation[i], m.origin[i])
        joint = found.addJoint(int(m.parent[i]) + 1, kind(m.axis[i]), place, f'j{i}')
        body = pin.Inertia(m.mass[i], m.centre[i], m.inertia[i])
        found.appendBodyToJoint(joint, body, pin.SE3.Identity())
    found.armature = m.armature
    return found


def contacts(m, tree_model):
    """Points and frames that coincide."""
    found = pin.StdVec_RigidConstraintModel()
    for first, second in sorted(set(zip(m.first.tolist(), m.second.tolist(), strict=True))):
        rows = np.flatnonzero((m.first == first) & (m.second == second))
        k = rows[m.closure[rows] == POINT][0]
        turns = rows[m.closure[rows] == ORIENTATION]
        kind = pin.ContactType.CONTACT_6D if len(turns) else pin.ContactType.CONTACT_3D
        turned = m.relative_rotation[turns[0]] if len(turns) else np.eye(3)
        places = pin.SE3(turned, m.first_point[k]), pin.SE3(np.eye(3), m.second_point[k])
        joints = first + 1, second + 1
        found.append(
            pin.RigidConstraintModel(kind, tree_model, joints[0], places[0], joints[1], places[1])
        )
    return found
