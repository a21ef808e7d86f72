"""Machines for the tests of mechanisms, each as MJCF of hinges and slides, and read from there."""

import functools
import math
from typing import NamedTuple

import mujoco
import numpy as np
from geometry import ROBOT, legs
from scipy.linalg import qr

from parallel_robot_model.mechanisms.mechanism import (
    BASE,
    COUPLING,
    ORIENTATION,
    POINT,
    Mechanism,
    elements,
)
from parallel_robot_model.mechanisms.workspace import boxed

NEAR = 0.15  # rad or lengths, of joints near home
POSE_3RRR = np.array([0.5284, 0.3681, 0.1247])


class Machine(NamedTuple):
    """A machine, and its MJCF compiled: joint i of one is joint i of the other."""

    mechanism: Mechanism
    model: mujoco.MjModel

    @property
    def n(self):
        return len(self.mechanism.actuated)

    def boxed(self):
        """Mechanism and a new workspace."""
        return boxed(self.mechanism)


@functools.cache
def made(name):
    """A machine by its name in MACHINES."""
    return MACHINES[name]()


OF_CLOSURES = (  # fields of a Mechanism
    'closure', 'first', 'second', 'first_point', 'second_point', 'relative_rotation', 'direction',
    'ratio', 'offset',
)  # fmt: skip


def samples(machine, count, seed=0, near=NEAR):
    """Positions of the actuated joints around home, shape (count, n)."""
    m = machine.mechanism
    scale = np.where(m.turns[m.actuated] == 0.0, m.length, 1.0)
    spread = np.random.default_rng(seed).uniform(-near, near, (count, machine.n))
    return m.home[m.actuated] + scale * spread


def compiled(bodies, equalities='', actuated=(), gravity='0 0 -9.81'):
    """The model of an MJCF."""
    motors = ''.join(f'<motor joint="{name}"/>' for name in actuated)
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option gravity="{gravity}"/><compiler angle="radian" eulerseq="XYZ"/>'
        f'<worldbody>{bodies}</worldbody><equality>{equalities}</equality>'
        f'<actuator>{motors}</actuator></mujoco>'
    )


def words(*numbers):
    return ' '.join(repr(float(x)) for x in np.ravel(numbers))


def machine(model, home=None, coordinate=(), length=1.0):
    """A compiled MJCF as a mechanism; its site `tool` is the tool."""
    home = np.zeros(model.nq) if home is None else np.asarray(home, float)
    joints, frame = _tree(model)
    closures = _closures(model, frame)
    data = mujoco.MjData(model)
    data.qpos = home
    mujoco.mj_forward(model, data)
    actuated = model.actuator_trnid[:, 0].astype(np.int64)
    tool, point, rotation = _site(model, frame, model.site('tool').id)
    mechanism = Mechanism(
        **joints,
        gravity=model.opt.gravity.copy(),
        elements=elements(model.nv),
        **closures,
        actuated=actuated,
        passive=np.setdiff1d(np.arange(model.nv), actuated),
        home=home,
        tool=tool,
        tool_point=point,
        tool_rotation=rotation,
        tool_home=data.site('tool').xmat.reshape(3, 3).copy(),
        coordinate=np.array(coordinate, np.int64),
        length=length,
    )
    return Machine(_independent(mechanism, model, data), model)


def _matrix(quaternion):
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, quaternion)
    return R.reshape(3, 3)


def _tree(model):
    """Fields of the joints, and for each body its joint and its frame seen from that."""
    frame = {0: (BASE, np.eye(3), np.zeros(3))}
    rows = []
    for b in range(1, model.nbody):
        joint, R, p = frame[model.body_parentid[b]]
        p = p + R @ model.body_pos[b]
        R = R @ _matrix(model.body_quat[b])
        for k in range(model.body_jntnum[b]):
            i = model.body_jntadr[b] + k
            anchor = model.jnt_pos[i]
            turns = float(model.jnt_type[i] == mujoco.mjtJoint.mjJNT_HINGE)
            rows.append(
                [
                    joint,
                    turns,
                    1.0 - turns,
                    R,
                    p + R @ anchor,
                    model.jnt_axis[i],
                    0.0,
                    np.zeros(3),
                    np.zeros((3, 3)),
                    model.dof_armature[i],
                ]
            )
            joint, R, p = i, np.eye(3), -anchor
        frame[b] = (joint, R, p)
        turn = R @ _matrix(model.body_iquat[b])
        rows[joint][6:9] = [
            model.body_mass[b],
            p + R @ model.body_ipos[b],
            turn @ np.diag(model.body_inertia[b]) @ turn.T,
        ]
    names = 'parent', 'turns', 'slides', 'rotation', 'origin', 'axis', 'mass', 'centre', 'inertia'
    columns, names = zip(*rows, strict=True), (*names, 'armature')
    return {name: np.array(x) for name, x in zip(names, columns, strict=True)}, frame


def _site(model, frame, site):
    joint, R, p = frame[model.site_bodyid[site]]
    return joint, p + R @ model.site_pos[site], R @ _matrix(model.site_quat[site])


def _closures(model, frame):
    rows = []
    for e in range(model.neq):
        one, other = model.eq_obj1id[e], model.eq_obj2id[e]
        if model.eq_type[e] == mujoco.mjtEq.mjEQ_JOINT:
            offset, ratio = model.eq_data[e][:2]
            nothing = [np.zeros(3), np.zeros(3), np.eye(3), np.zeros(3)]
            rows.append([COUPLING, one, other, *nothing, ratio, offset])
            continue
        (first, x, R), (second, y, T) = (_site(model, frame, s) for s in (one, other))
        kinds = [POINT] if model.eq_type[e] == mujoco.mjtEq.mjEQ_CONNECT else [POINT, ORIENTATION]
        rows += [
            [kind, first, second, x, y, R @ T.T, direction, 0.0, 0.0]
            for kind in kinds
            for direction in np.eye(3)
        ]
    shapes = (), (), (), (3,), (3,), (3, 3), (3,), (), ()
    kinds = (np.int64,) * 3 + (float,) * 6
    columns = list(zip(*rows, strict=True)) or [()] * 9
    return {
        name: np.array(x, kind).reshape((-1, *shape))
        for name, x, kind, shape in zip(OF_CLOSURES, columns, kinds, shapes, strict=True)
    }


def _independent(m, model, data):
    """As many closures as passive joints, independent at home; other joints are held."""
    J = np.array([closure_row(m, model, data, k) for k in range(len(m.closure))])
    if not len(J):
        return m._replace(passive=m.passive[:0])
    block = J[:, m.passive]
    rank = np.linalg.matrix_rank(block, 1e-9)
    rows = np.sort(qr(block.T, pivoting=True)[2][:rank])
    columns = np.sort(qr(block[rows], pivoting=True)[2][:rank])
    fields = {name: getattr(m, name)[rows] for name in OF_CLOSURES}
    return m._replace(passive=m.passive[columns], **fields)


def closure_row(m, model, data, k):
    """Derivative of a closure by all joints, by MuJoCo, shape (N,)."""
    row = np.zeros(model.nv)
    for joint, point, sign in (
        (m.first[k], m.first_point[k], 1.0),
        (m.second[k], m.second_point[k], -1.0),
    ):
        if joint == BASE:
            continue
        if m.closure[k] == COUPLING:
            row[joint] += sign if sign > 0 else -m.ratio[k]
            continue
        body = int(model.jnt_bodyid[joint])
        R = data.xmat[body].reshape(3, 3)
        anchor = model.jnt_pos[joint] if body else np.zeros(3)
        linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
        world = data.xpos[body] + R @ (point + anchor)
        mujoco.mj_jac(model, data, linear, angular, world, body)
        row += sign * m.direction[k] @ (linear if m.closure[k] == POINT else angular)
    return row


def planar_3rrr(robot=ROBOT, pose=POSE_3RRR):
    """The 3-RRR of the suite: three legs, the platform on the first; angles from x."""
    theta, beta = legs(robot, pose)
    bodies = ''
    for k in range(3):
        last = ''
        if k == 0:
            first = robot.l3 * np.exp(1j * np.array(robot.platform_angle))
            ends = [(c.real, c.imag) for c in first - first[0]]
            sites = ''.join(f'<site name="e{j}" pos="{words(*ends[j], 0)}"/>' for j in (1, 2))
            centre = words(-first[0].real, -first[0].imag, 0)
            last = (
                f'<body pos="{words(robot.l2, 0, 0)}"><joint name="platform" axis="0 0 1"/>'
                f'<inertial pos="{centre}" mass="{robot.mp}" diaginertia="{words([robot.Ip] * 3)}"'
                f'/><site name="tool" pos="{centre}"/>{sites}</body>'
            )
        else:
            last = f'<site name="d{k}" pos="{words(robot.l2, 0, 0)}"/>'
        bodies += (
            f'<body pos="{words(robot.base_x[k], robot.base_y[k], 0)}">'
            f'<joint name="a{k}" axis="0 0 1"/>'
            f'<inertial pos="{words(robot.lc1, 0, 0)}" mass="{robot.m1}" '
            f'diaginertia="{words([robot.I1] * 3)}"/>'
            f'<body pos="{words(robot.l1, 0, 0)}"><joint name="p{k}" axis="0 0 1"/>'
            f'<inertial pos="{words(robot.lc2, 0, 0)}" mass="{robot.m2}" '
            f'diaginertia="{words([robot.I2] * 3)}"/>{last}</body></body>'
        )
    equalities = ''.join(f'<connect site1="e{k}" site2="d{k}"/>' for k in (1, 2))
    model = compiled(bodies, equalities, [f'a{k}' for k in range(3)])
    home = {f'a{k}': theta[k] for k in range(3)} | {f'p{k}': beta[k] - theta[k] for k in range(3)}
    home['platform'] = pose[2] - beta[0]
    positions = [home[model.joint(i).name] for i in range(model.njnt)]
    found = machine(model, positions, (0, 1, 5), robot.l1)
    return Machine(found.mechanism._replace(tool_home=np.eye(3)), model)


def hexapod(welded=False):
    """6-UPS: slides are actuated, the platform is on the first leg; one end may be welded."""
    base, platform, height = 0.6, 0.35, 0.7
    B = [_on_circle(base, a, 0.0) for a in (10, 110, 130, 230, 250, 350)]
    P = [_on_circle(platform, a, height) for a in (50, 70, 170, 190, 290, 310)]
    bodies = ''
    for k in range(6):
        z = P[k] - B[k]
        length = np.linalg.norm(z)
        z = z / length
        x = np.cross([0, 0, 1], z)
        x /= np.linalg.norm(x)
        R = np.column_stack([x, np.cross(z, x), z])
        end = f'<site name="d{k}" pos="0 0 {length / 2}"/>'
        upright = f'xyaxes="{words(R.T[:, 0], R.T[:, 1])}"'
        ball = ''.join(f'<joint name="b{k}{a}" axis="{words(np.eye(3)[a])}"/>' for a in range(3))
        if k == 0:
            centre = words(-P[0][0], -P[0][1], 0)
            sites = ''.join(f'<site name="e{j}" pos="{words(P[j] - P[0])}"/>' for j in range(1, 6))
            end = (
                f'<body pos="0 0 {length / 2}" {upright}>{ball}'
                f'<inertial pos="{centre}" mass="8" diaginertia=".3 .3 .5"/>'
                f'<site name="tool" pos="{centre}"/>{sites}</body>'
            )
        elif k == 5 and welded:
            end = (
                f'<body pos="0 0 {length / 2}" {upright}>{ball}'
                f'<inertial pos=".01 .02 -.01" mass=".2" diaginertia=".001 .0015 .002"/>'
                f'<site name="d{k}"/></body>'
            )
        bodies += (
            f'<body pos="{words(B[k])}" xyaxes="{words(R[:, 0], R[:, 1])}">'
            f'<joint name="u{k}" axis="1 0 0"/><joint name="v{k}" axis="0 1 0"/>'
            f'<inertial pos="0 0.01 .2" mass="1.5" diaginertia=".03 .031 .002"/>'
            f'<body pos="0 0 {length / 2}">'
            f'<joint name="s{k}" type="slide" axis="0 0 1" armature=".3"/>'
            f'<inertial pos="0.005 0 .1" mass="1" diaginertia=".02 .02 .001"/>{end}</body></body>'
        )
    kinds = ['connect'] * 4 + ['weld' if welded else 'connect']
    equalities = ''.join(
        f'<{kind} site1="e{k}" site2="d{k}"/>' for k, kind in enumerate(kinds, start=1)
    )
    model = compiled(bodies, equalities, [f's{k}' for k in range(6)])
    return machine(model, None, range(6), 0.5)


def _on_circle(radius, degrees, z):
    angle = math.radians(degrees)
    return np.array([radius * math.cos(angle), radius * math.sin(angle), z])


def arm():
    """Six hinges in space."""
    places = (
        ('0 0 .2', '0 0 0', '0 0 1', 4.0),
        ('.05 0 .15', '.1 0 0', '0 1 0', 6.0),
        ('0 0 .45', '0 .7 0', '0 1 .1', 3.0),
        ('.3 .02 0', '0 0 .3', '1 0 0', 1.5),
        ('.12 0 0', '0 .6 .1', '0 1 0', 0.8),
        ('.08 0 .01', '.2 0 0', '1 0 0', 0.3),
    )
    bodies, ends = '', ''
    for k, (place, euler, axis, mass) in enumerate(places):
        bodies += (
            f'<body pos="{place}" euler="{euler}">'
            f'<joint name="j{k}" axis="{axis}" pos="0 {0.01 * k} 0" armature="{0.01 * k}"/>'
            f'<inertial pos=".03 .01 {0.05 + 0.01 * k}" mass="{mass}" '
            f'fullinertia="{words(mass * np.array([0.02, 0.018, 0.01, 0.001, -0.002, 0.0015]))}"/>'
        )
        ends += '</body>'
    bodies += '<site name="tool" pos=".1 .02 .03" euler=".2 .1 .4"/>'
    model = compiled(bodies + ends, actuated=[f'j{k}' for k in range(6)], gravity='1 -2 -9.5')
    return machine(model, None, range(6), 0.6)


def five_bar(welded=False):
    """Two cranks and their rods in a vertical plane; the last hinge may be a weld's."""
    size = '<inertial pos=".1 0 0" mass="{}" diaginertia=".001 .004 .004"/>'
    hinge = '<joint name="{}" axis="0 -1 0"/>'
    end = '<site name="d" pos=".28 0 0"/>'
    if welded:
        small = '<inertial pos=".01 0 .02" mass=".1" diaginertia="1e-4 1e-4 1e-4"/>'
        end = f'<body pos=".28 0 0">{hinge.format("t")}{small}<site name="d"/></body>'
    chain = (
        '<body pos="{x} 0 0">' + hinge.format('a{k}') + size.format(0.5) + '<body pos=".2 0 0">'
        '' + hinge.format('p{k}') + size.format(0.3) + '{end}</body></body>'
    )
    bodies = chain.format(
        x=-0.1, k=0, end='<site name="e" pos=".28 0 0"/><site name="tool" pos=".28 0 0"/>'
    )
    bodies += chain.format(x=0.1, k=1, end=end)
    kind = 'weld' if welded else 'connect'
    model = compiled(bodies, f'<{kind} site1="e" site2="d"/>', ['a0', 'a1'])
    left = 2.2  # rad, of the left crank; the right one is its image
    elbow = np.array([-0.1 + 0.2 * math.cos(left), 0.2 * math.sin(left)])
    rod = math.acos(-elbow[0] / 0.28)
    home = [left, rod - left, math.pi - left, left - rod]
    if welded:
        home.append(rod - (math.pi - rod))
    return machine(model, home, (0, 2), 0.2)


def parallelogram():
    """Two equal cranks and the rod between them; one crank is actuated."""
    size = '<inertial pos=".1 0 0" mass=".5" diaginertia=".001 .004 .004"/>'
    bodies = (
        f'<body><joint name="a" axis="0 0 1"/>{size}<body pos=".2 0 0">'
        f'<joint name="rod" axis="0 0 1"/>{size}<site name="e" pos=".5 0 0"/>'
        '<site name="tool"/></body></body>'
        f'<body pos=".5 0 0"><joint name="b" axis="0 0 1"/>{size}'
        '<site name="d" pos=".2 0 0"/></body>'
    )
    model = compiled(bodies, '<connect site1="e" site2="d"/>', ['a'])
    return machine(model, [1.0, -1.0, 1.0], (0,), 0.2)


def coupled():
    """Two hinges and a slide that follow, by toothed wheels and a rack; a free one is actuated."""
    bodies = (
        '<body><joint name="a" axis="0 0 1"/>'
        '<inertial pos=".1 0 0" mass="1" diaginertia=".01 .02 .02"/>'
        '<body pos=".3 0 0"><joint name="b" axis="0 1 0"/>'
        '<inertial pos=".1 .1 0" mass=".7" diaginertia=".01 .02 .02"/>'
        '<body pos=".2 0 .1"><joint name="c" axis="0 1 0"/>'
        '<inertial pos=".1 0 .05" mass=".5" diaginertia=".01 .02 .02"/>'
        '<body pos=".2 0 0"><joint name="d" type="slide" axis="1 0 .5"/>'
        '<inertial pos=".05 0 0" mass=".4" diaginertia=".001 .002 .002"/>'
        '<site name="tool" pos=".1 0 0"/></body></body></body></body>'
    )
    equalities = (
        '<joint joint1="c" joint2="b" polycoef=".1 -1.5 0 0 0"/>'
        '<joint joint1="d" joint2="c" polycoef=".02 .05 0 0 0"/>'
    )
    model = compiled(bodies, equalities, ['a', 'b'])
    home = [0.0, 0.2, 0.1 - 0.3, 0.02 - 0.2 * 0.05]
    return machine(model, home, (), 0.3)


def wrist(axes='xyz'):
    """Hinges whose axes meet; the pose is the rotation, or a part of it."""
    directions = {'x': '1 0 0', 'y': '0 1 0', 'z': '0 0 1'}
    bodies = ''.join(
        f'<body><joint name="{a}" axis="{directions[a]}"/>'
        '<inertial pos=".1 .02 -.1" mass="1" diaginertia=".01 .02 .015"/>'
        for a in axes
    )
    bodies += '<site name="tool" pos=".1 0 .1" euler=".1 .2 .3"/>' + len(axes) * '</body>'
    coordinate = [3 + 'xyz'.index(a) for a in axes]
    return machine(compiled(bodies, actuated=axes), None, coordinate, 0.2)


def serial_2r(robot):
    """The serial arm of the suite, in its vertical plane."""
    bodies = (
        f'<body><joint name="a" axis="0 0 1"/><inertial pos="{robot.lc1} 0 0" mass="{robot.m1}" '
        f'diaginertia="{words([robot.I1] * 3)}"/><body pos="{robot.l1} 0 0">'
        f'<joint name="b" axis="0 0 1"/><inertial pos="{robot.lc2} 0 0" mass="{robot.m2}" '
        f'diaginertia="{words([robot.I2] * 3)}"/><site name="tool" pos="{robot.l2} 0 0"/>'
        '</body></body>'
    )
    model = compiled(bodies, actuated=['a', 'b'], gravity='0 -9.81 0')
    return machine(model, [0.3, 0.7], (0, 1), 0.5)


MACHINES = {
    'planar_3rrr': planar_3rrr,
    'hexapod': hexapod,
    'welded_hexapod': lambda: hexapod(welded=True),
    'arm': arm,
    'five_bar': five_bar,
    'welded_five_bar': lambda: five_bar(welded=True),
    'parallelogram': parallelogram,
    'coupled': coupled,
    'wrist': wrist,
    'universal': lambda: wrist('xy'),
}
