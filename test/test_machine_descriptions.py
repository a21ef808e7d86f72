"""The machines that come as descriptions, by MuJoCo and by what is published of them."""

import math

import mujoco
import numpy as np
import pytest
from vectors import boxed

from parallel_robot_model.compiler import vector
from parallel_robot_model.configuration.config import directory, resolve
from parallel_robot_model.robots import planar_3rrr, serial_2r
from parallel_robot_model.robots.contract import REACHED, PoseMotion
from parallel_robot_model.robots.registry import robot_of

MACHINES = directory() / 'machines'
# Joints (a ball counts three), actuated ones, independent closures, idle rods, moving mass [kg].
EXPECTED = {
    'arm6': (6, 6, 0, 0, 36.45),
    'delta': (24, 3, 15, 6, 3 * 1.2 + 6 * 0.141 + 1.6),
    'delta_rl5': (27, 3, 18, 6, 3 * 3.696 + 6 * 0.525 + 4.4664 + 9.65 + 12.481 + 6),
    'five_bar': (4, 2, 2, 0, 0.37),
    'hexapod': (21, 6, 15, 0, 6 * (92.1107 + 51.8123) + 1216.93),
    'planar_3rrr_described': (7, 3, 4, 0, 41.37),
    'serial_2r_described': (2, 2, 0, 0, 6.5),
}


class Machine:
    """A description in MuJoCo, at home."""

    def __init__(self, name):
        self.model = mujoco.MjModel.from_xml_path(str(MACHINES / f'{name}.xml'))
        self.data = mujoco.MjData(self.model)
        joints = self.model.actuator_trnid[:, 0]
        self.actuated = self.model.jnt_dofadr[joints]
        self.places = self.model.jnt_qposadr[joints]
        self.limit = self.model.actuator_forcerange[:, 1]
        mujoco.mj_resetDataKeyframe(self.model, self.data, self.model.key('home').id)
        mujoco.mj_forward(self.model, self.data)

    def at(self, qpos):
        self.data.qpos[:] = qpos
        mujoco.mj_forward(self.model, self.data)
        return self

    def jacobian(self, site):
        """Velocity and angular velocity of a site for the rates of all joints, shape (6, N)."""
        J = np.zeros((6, self.model.nv))
        mujoco.mj_jacSite(self.model, self.data, J[:3], J[3:], site)
        return J

    def pairs(self):
        return list(zip(self.model.eq_obj1id, self.model.eq_obj2id, strict=True))

    def gaps(self):
        """Distances of the points that coincide, and their rates for those of all joints."""
        places = self.data.site_xpos
        A = [self.jacobian(a)[:3] - self.jacobian(b)[:3] for a, b in self.pairs()]
        gaps = [np.zeros(0), *(places[a] - places[b] for a, b in self.pairs())]
        return np.concatenate(gaps), np.vstack([np.zeros((0, self.model.nv)), *A])

    def rates(self):
        """W: rates of all joints for those of the actuated ones, idle rods with the least."""
        A = self.gaps()[1]
        W = np.zeros((self.model.nv, len(self.actuated)))
        W[self.actuated] = np.eye(len(self.actuated))
        passive = np.setdiff1d(np.arange(self.model.nv), self.actuated)
        W[passive] = -np.linalg.pinv(A[:, passive], rcond=1e-9) @ A[:, self.actuated]
        return W

    def inertia(self):
        """M in the actuated joints."""
        M, W = np.zeros((self.model.nv, self.model.nv)), self.rates()
        for column, unit in zip(M, np.eye(self.model.nv), strict=True):
            mujoco.mj_mulM(self.model, self.data, column, unit)
        return W.T @ M @ W

    def gravity(self):
        """Torques that hold it, at rest."""
        return self.rates().T @ self.data.qfrc_bias

    def tool(self):
        """Position of the tool, and its twist for the rates of the actuated joints."""
        site = self.model.site('tool').id
        return self.data.site_xpos[site].copy(), self.jacobian(site) @ self.rates()


def joints_at(module, constants, pose):
    still = vector(np.zeros(len(pose)))
    motion = module.joint_motion(constants, PoseMotion(vector(pose), still, still))
    assert motion.out_of_reach == REACHED
    return np.array(motion.position), np.array(motion.passive)


def turned(angle, *point):
    """A point, turned about z."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ point


def test_these_are_all():
    assert sorted(path.stem for path in MACHINES.glob('*.xml')) == sorted(EXPECTED)


@pytest.fixture(params=EXPECTED)
def name(request):
    return request.param


def test_home_is_closed_and_has_the_freedoms_of_the_machine(name):
    machine = Machine(name)
    joints, actuated, closures, idle, mass = EXPECTED[name]
    gaps, A = machine.gaps()
    assert np.abs(gaps).max(initial=0.0) < 1e-12
    assert (machine.model.nv, machine.model.nu) == (joints, actuated)
    assert np.linalg.matrix_rank(A, 1e-9) == closures == joints - actuated - idle
    assert np.linalg.matrix_rank(A @ machine.rates(), 1e-9) == 0
    assert machine.model.body_subtreemass[0] == pytest.approx(mass, rel=1e-5)


def test_its_tool_moves_with_all_its_motors(name):
    machine = Machine(name)
    assert np.linalg.matrix_rank(machine.tool()[1], 1e-6) == machine.model.nu


def test_its_motors_can_carry_it(name):
    machine = Machine(name)
    assert np.all(machine.limit > 0)
    assert np.all(np.abs(machine.gravity()) < 0.45 * machine.limit)


def test_a_proportional_law_with_gravity_holds_it_for_a_second(name):
    machine = Machine(name)
    model, data = machine.model, machine.data
    home, place = data.qpos[machine.places].copy(), machine.tool()[0]
    stiffness = 400.0 * np.diag(machine.inertia())
    gravity = machine.gravity()
    for _ in range(round(1.0 / model.opt.timestep)):
        error = home - data.qpos[machine.places]
        data.ctrl = gravity + stiffness * (error - 0.1 * data.qvel[machine.actuated])
        mujoco.mj_step(model, data)
    assert np.all(np.abs(data.actuator_force) < machine.limit)
    assert np.abs(data.qpos[machine.places] - home).max() < 2e-4
    assert np.abs(machine.tool()[0] - place).max() < 2e-4


def test_the_planar_robot_is_its_closed_form():
    machine = Machine('planar_3rrr_described')
    values = resolve('paper_circle')
    robot = robot_of(values).parameters
    constants = boxed(planar_3rrr, robot)
    margins = planar_3rrr.SafetyMargins(0.05, 0.1)
    rng = np.random.default_rng(1)
    assert machine.tool()[0][:2] == pytest.approx(np.mean([robot.base_x, robot.base_y], axis=1))
    for k in range(21):
        pose = np.array([0.5, math.sqrt(3) / 6, 0.0])
        if k:
            pose += rng.uniform([-0.08, -0.08, -0.2], [0.08, 0.08, 1.8])
        theta, beta = joints_at(planar_3rrr, constants, pose)
        psi = np.mod(beta - theta, 2 * math.pi) - 2 * math.pi
        wrist = pose[2] - theta[0] - psi[0]
        qpos = [theta[0], psi[0], wrist, theta[1], psi[1], theta[2], psi[2]]
        if not k:
            assert qpos == pytest.approx(machine.data.qpos, abs=1e-12)
        machine.at(qpos)
        assert np.abs(machine.gaps()[0]).max() < 1e-12
        place, twist = machine.tool()
        assert place == pytest.approx([*pose[:2], 0.0], abs=1e-12)
        velocity = rng.normal(size=3)
        estimate = planar_3rrr.estimate(
            constants, margins, vector(theta), vector(velocity), vector(pose)
        )
        assert estimate.fault == 0
        assert np.abs(machine.inertia() - np.array(estimate.model.M)).max() < 1e-9
        assert np.abs(machine.gravity()).max() < 1e-9
        rate = twist[[0, 1, 5]] @ velocity
        motion = PoseMotion(vector(pose), vector(rate), vector(np.zeros(3)))
        back = planar_3rrr.joint_motion(constants, motion).velocity
        assert np.array(back) == pytest.approx(velocity, abs=1e-9)
    says_the_same(machine, values)


def test_the_arm_of_two_links_is_its_closed_form():
    machine = Machine('serial_2r_described')
    values = resolve('serial_2r_circle')
    robot = boxed(serial_2r, robot_of(values).parameters)
    margins = serial_2r.SafetyMargins(0.1)
    rng = np.random.default_rng(2)
    for _ in range(20):
        pose = np.array([0.3, 0.3]) + rng.uniform(-0.12, 0.12, 2)
        theta, _ = joints_at(serial_2r, robot, pose)
        assert machine.at(theta).tool()[0] == pytest.approx([*pose, 0.0], abs=1e-12)
        still = vector(np.zeros(2))
        model = serial_2r.estimate(robot, margins, vector(theta), still, vector(pose)).model
        assert np.abs(machine.inertia() - np.array(model.M)).max() < 1e-9
        assert np.abs(machine.gravity() - np.array(model.gravity)).max() < 1e-9
    says_the_same(machine, values)


def says_the_same(machine, values):
    """Names, friction and torque limits are those of the robot's file."""
    joints = [machine.model.joint(k).name for k in machine.model.actuator_trnid[:, 0]]
    damping, dry = machine.model.dof_damping, machine.model.dof_frictionloss
    assert joints == values['joints']
    assert damping[machine.actuated].tolist() == list(values['friction.viscous'])
    assert dry[machine.actuated].tolist() == list(values['friction.coulomb'])
    assert machine.limit.tolist() == list(values['plant.torque_limit'])


@pytest.mark.parametrize(
    ('name', 'base', 'arm', 'rod', 'platform', 'tool'),
    [
        ('delta', 0.164, 0.524, 1.244, 0.044, (0.0, 0.0)),  # Williams (2016)
        ('delta_rl5', 0.33, 0.42, 1.055, 0.125, (0.0632, -0.267)),  # Alikoc et al. (2023)
    ],
)
def test_a_delta_has_the_dimensions_of_its_source(name, base, arm, rod, platform, tool):
    # A rod keeps its length, s . v = s . (rate of the elbow).
    place, twist = Machine(name).tool()
    reach = base + arm - platform
    height = -math.sqrt(rod**2 - reach**2)
    assert place == pytest.approx([tool[0], 0, height + tool[1]], abs=1e-12)
    assert np.abs(twist[3:]).max() < 1e-9  # the platform keeps its direction
    for k in range(3):
        along = turned(k * 2 * math.pi / 3, -reach, 0.0, height)
        down = np.array([0.0, 0.0, -arm])
        assert along @ twist[:3] == pytest.approx(along @ down * np.eye(3)[k], abs=1e-9)


def test_arm_and_pin_of_the_rl5_have_the_inertia_of_their_source():
    model = Machine('delta_rl5').model
    arm, pin = model.body('arm1'), model.body('pin1')
    found = arm.inertia[1] + arm.mass[0] * np.sum(arm.ipos**2)
    found += pin.inertia[1] + pin.mass[0] * np.sum(pin.pos**2)
    assert found == pytest.approx(0.208218, rel=1e-3)


def test_the_hexapod_has_the_dimensions_of_its_source():
    # SimMechanics' case study: the rate of a leg is n . (v + w x r).
    machine = Machine('hexapod')
    place, twist = machine.tool()
    assert place == pytest.approx([0, 0, 2], abs=1e-12)
    for k in range(6):
        pair, side = k // 2 * 2 * math.pi / 3, 1 if k % 2 else -1
        foot = turned(pair + side * math.radians(2.5), 3.0, 0.0, 0.0)
        arm = turned(pair + side * math.radians(50), 1.0, 0.0, 0.0)
        leg = place + arm - foot
        rate = leg @ (twist[:3] + np.cross(twist[3:].T, arm).T) / np.linalg.norm(leg)
        assert rate == pytest.approx(np.eye(6)[k], abs=1e-9)
    # Forces in the legs carry platform, and of each cylinder and rod what hangs on it.
    assert machine.gravity() == pytest.approx(np.full(6, machine.gravity()[0]))


def test_the_five_bar_has_the_dimensions_of_its_source():
    machine = Machine('five_bar')
    place, twist = machine.tool()
    assert place == pytest.approx([0, 0.14, 0], abs=1e-12)
    for k, foot in enumerate((-0.059, 0.059)):
        angle = machine.data.qpos[machine.places[k]]
        elbow = np.array([foot, 0, 0]) + turned(angle, 0.09, 0, 0)
        link = place - elbow
        assert np.linalg.norm(link) == pytest.approx(0.09, abs=1e-12)
        assert math.copysign(1, elbow[0] - foot) == math.copysign(1, foot)  # outward
        rate = np.cross([0, 0, 1], elbow - [foot, 0, 0])
        assert link @ twist[:3] == pytest.approx(link @ rate * np.eye(2)[k], abs=1e-12)


def test_the_arm_weighs_what_its_source_says():
    # Armstrong, Khatib, Burdick (1986), gravity of joints 2 and 3 with their rounded constants.
    machine = Machine('arm6')
    g1, g2, g3, g4, g5 = -37.2, -8.44, 1.02, 0.249, -0.0282
    rng = np.random.default_rng(3)
    for _ in range(20):
        q = rng.uniform(-2.0, 2.0, 6)
        c2, s2, c23, s23 = (f(a) for a in (q[1], q[1] + q[2]) for f in (math.cos, math.sin))
        c4, (c5, s5) = math.cos(q[3]), (math.cos(q[4]), math.sin(q[4]))
        third = g2 * s23 + g4 * c23 + g5 * (s23 * c5 + c23 * c4 * s5)
        second = g1 * c2 + g3 * s2 + third
        gravity = machine.at(q).gravity()
        assert gravity[1:3] == pytest.approx([second, third], abs=0.06)
        assert gravity[0] == pytest.approx(0.0, abs=1e-9)
