"""After a type 2 singularity the same joint angles fit two poses: the wrong one is never taken."""

import numpy as np
import pytest
from geometry import PAPER_START, ROBOT, jacobian, legs, wrap
from hypothesis import given
from hypothesis import strategies as st
from rig import Rig

from parallel_robot_control.contract import JointReference
from parallel_robot_control.messages import LOST
from parallel_robot_control.safety.faults import NONE
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.robots import planar_3rrr
from parallel_robot_model.robots.planar_3rrr.estimate import TYPE_2
from parallel_robot_sim.plant_core import state_layout

PUSHES = [(-8.0, -5.0, -3.0), (-14.0, 7.0, -30.0), (22.0, 30.0, 28.0)]  # N m


class Crossed(Rig):
    """A robot that strange torques have driven into the other assembly mode, at rest there."""

    def __init__(self, push, passive=False, zero=(0.0, 0.0, 0.0)):
        self.zero = np.array(zero)
        super().__init__(sensor__zero_angle=[*zero], estimator__zero_angle=[*zero])
        self.controller.expect(state_layout(tuple(self.values['joints']), 3), [0, 1, 2])
        self.passive = passive
        side = np.sign(np.linalg.det(jacobian(ROBOT, PAPER_START)))
        while side * np.linalg.det(jacobian(ROBOT, self.simulator.pose)) > -0.3:
            self.move(np.array(push))
        for _ in range(500):
            self.move(np.clip(-40.0 * self.measured().velocity, -200.0, 200.0))
        assert side * np.linalg.det(jacobian(ROBOT, self.simulator.pose)) < -0.3

    def measured(self):
        joints = super().measured()
        return joints._replace(position=np.array(joints.position) + self.zero)

    def rest(self):
        position = self.measured().position - self.zero
        return JointReference(position, np.zeros(3), np.zeros(3))

    def tell(self):
        """The state, and a reference that rests where the joints are."""
        self.controller.add_reference(self.stamp, self.rest())
        if self.passive:
            assert self.controller.answer(self.simulator.message(self.stamp)) > 0
        else:
            assert self.controller.add_state(self.stamp, self.measured())

    def move(self, torque):
        self.tell()
        self.simulator.advance(torque)
        self.k += 1

    def error(self):
        """How far the believed pose is from the true one."""
        way = np.array(self.controller.state.pose) - self.simulator.pose
        way[2] = wrap(way[2])
        return np.abs(way).max()

    def goes_on_calmly(self):
        """Cleared, the robot stays at rest by small torques."""
        before, largest, rest = self.simulator.pose, 0.0, self.rest()
        for _ in range(500):
            largest = max(largest, np.abs(self.step(reference=rest).torque).max())
        assert self.controller.fault == NONE and self.error() < 1e-6
        return largest < 2.0 and np.abs(self.simulator.pose - before).max() < 1e-3


@pytest.mark.parametrize('push', PUSHES)
def test_the_other_assembly_mode_is_not_taken_in_silence(push):
    rig = Crossed(push)
    assert rig.controller.fault != NONE and rig.controller.status.pose == LOST
    assert rig.error() > 0.3  # what is believed is wrong
    said = rig.controller.clear_fault()
    assert 'the pose is not known' in said and '~/confirm_pose' in said and '\n' not in said
    assert f'phi {rig.simulator.pose[2]:.4g}' in said or f'{rig.simulator.pose[0]:.4g}' in said
    fault = rig.controller.fault
    rig.tell(), rig.simulator.advance(np.zeros(3))
    assert fault != NONE and rig.controller.fault == fault  # it stays as it was


@pytest.mark.parametrize('push', PUSHES)
def test_the_pose_that_the_user_tells_is_taken(push):
    rig = Crossed(push)
    about = rig.simulator.pose + np.array([0.02, -0.02, 0.1])
    rig.controller.set_pose(rig.controller.pose_near(about.tolist()))
    assert rig.error() < 1e-4 and rig.controller.status.pose != LOST  # it still creeps
    assert rig.controller.clear_fault() == ''
    assert rig.goes_on_calmly()


@pytest.mark.parametrize('push', PUSHES)
def test_passive_joints_tell_the_pose(push):
    rig = Crossed(push, passive=True, zero=(0.3, -0.2, 0.1))
    assert rig.error() > 0.3
    assert 'in another assembly mode' in rig.controller.clear_fault()
    assert rig.controller.confirm_pose() == rig.controller.clear_fault() == ''
    assert rig.error() < 1e-4
    rig.passive = False
    assert rig.goes_on_calmly()


def test_the_user_confirms_what_was_named():
    """A robot that came back to the mode in which it was."""
    rig = Rig()
    nowhere = rig.measured()._replace(position=np.array([0.0, np.pi, -np.pi / 2]))
    rig.ask(nowhere._replace(velocity=np.zeros(3)))
    rig.k += 1
    rest = rig.reference()
    rig.ask(reference=rest)  # a jump
    rig.k += 1
    rig.ask(reference=rest)
    assert rig.controller.status.pose == LOST
    assert 'no pose was named' in rig.controller.confirm_pose()
    assert f'x {PAPER_START[0]:.4g}' in rig.controller.clear_fault()
    assert rig.controller.confirm_pose() == '' and rig.controller.clear_fault() == ''
    assert rig.controller.confirm_pose() == 'the pose is known'
    assert np.abs(np.array(rig.controller.state.pose) - PAPER_START).max() < 1e-9


def test_a_pose_that_cannot_be_is_refused():
    rig = Rig()
    rig.step()
    with pytest.raises(InputError, match='in a fault alone'):
        rig.controller.pose_near(PAPER_START.tolist())
    rig.controller.trip(20)
    with pytest.raises(InputError, match='no pose there'):
        rig.controller.pose_near([5.0, 5.0, 0.0])
    with pytest.raises(InputError, match='must be empty or'):
        rig.controller.pose_near([0.5])


def test_a_margin_alone_loses_no_pose():
    rig = Rig(safety__min_determinant=5.0)
    assert rig.ask().status.fault and rig.controller.status.pose == ''
    assert rig.controller.clear_fault() == planar_3rrr.FAULTS[TYPE_2].text


@given(st.floats(0.3, 0.7), st.floats(0.1, 0.5), st.floats(-3.1, 3.1))
def test_all_joints_tell_one_pose(x, y, phi):
    theta, beta = legs(ROBOT, np.array([x, y, phi]))
    if np.isfinite(theta).all():
        found = planar_3rrr.pose_with(ROBOT, theta, beta - theta)
        assert np.allclose(found, [x, y, phi], atol=1e-12)
        spoilt = planar_3rrr.pose_with(ROBOT, theta, beta - theta + [0.0, 0.2, 0.0])
        assert np.isnan(spoilt).all()
