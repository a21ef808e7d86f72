"""The course of the plant, without ROS: hold, start, step, pause, reset, time-out, end."""

import numpy as np
import pytest
from geometry import legs

from parallel_robot_model.common.errors import DRIVEN_OUT
from parallel_robot_model.configuration.loop import STEP_START, WAIT
from parallel_robot_model.messages import cdr
from parallel_robot_model.robots.registry import resolve
from parallel_robot_sim.configuration import configure_plant
from parallel_robot_sim.plant_core import state_layout
from parallel_robot_sim.plant_run import ANNOUNCED, REPEAT, PlantRun, Simulator

MS = 10**6  # ns, the period
START = 7000 * MS  # ns
TORQUE = np.array([1.0, -2.0, 0.5])  # N m
FORCES = {  # N m, which drive the robot out of its workspace
    'no pose': np.array([200.0, 200.0, 200.0]),  # the integrator finds none
    'no joint angles': np.array([-100.0, -100.0, 0.0]),  # the integrator steps over the edge
}
FOREVER = 10**12  # ns without an answer


class Rig:
    """A run of the plant, with all that it has published."""

    def __init__(self, mode, **changes):
        changes = {key.replace('__', '.'): value for key, value in changes.items()}
        values = resolve('paper_circle', {'time_mode': mode, **changes})
        self.configuration = configure_plant(values)
        self.layout = state_layout(self.configuration.loop.joints, 3)
        # states: stamp [ns], pose and torque of each published state; events: what was
        # reported
        self.states, self.events = [], []
        self.run = PlantRun(
            lambda: Simulator(self.configuration),
            self.configuration.loop,
            lambda: self.events.append('time-out'),
            lambda: self.events.append('driven out'),
        )

    def publish(self, published):
        """Note the state if there is one to publish."""
        if published:
            run = self.run
            state = run.simulator.state
            joints = self.layout.decode(run.message)
            assert cdr.stamps_of(joints)[0] == run.stamp
            assert np.isfinite(joints['position']).all()
            assert np.array_equal(joints['effort'][0, :3], state.torque)
            self.states.append((run.stamp, *state.coordinates, *state.torque))
        return published

    def tick(self, stamp, command=None):
        """Give a command, if there is one, then a tick; returns whether a state came of it."""
        if command is not None:
            assert not self.run.take_command(command)
        return self.publish(self.run.tick(stamp))

    def command(self, torque=TORQUE, times=1):
        """Give commands in lockstep; returns how many states came of it."""
        return sum(self.publish(self.run.take_command(torque)) for _ in range(times))

    def poll(self, ready=True, unanswered=FOREVER):
        return self.publish(self.run.poll(ready, unanswered))

    def begin(self):
        """Publish the first state of a motion without a common start."""
        assert not self.poll() and self.poll()

    def advanced(self, *torques):
        """The states of a robot that is nothing but advanced, from the initial one on."""
        simulator = Simulator(self.configuration)
        states = [simulator.state]
        for torque in torques:
            simulator.advance(torque)
            states.append(simulator.state)
        return [(*state.coordinates, *state.torque) for state in states]


def bare(states):
    """States without their stamps."""
    return [state[1:] for state in states]


def test_the_robot_is_held_until_the_first_command():
    rig = Rig('wall')
    for k in range(3):
        assert rig.tick(START + k * MS)
    assert rig.run.index is None and rig.run.skipped == 0
    assert rig.tick(START + 3 * MS, TORQUE)
    assert rig.run.index == 1 and rig.run.stamp == START + 3 * MS
    assert rig.tick(START + 4 * MS, -TORQUE)
    held, *moving = rig.advanced(TORQUE, -TORQUE)
    assert bare(rig.states) == [held, held, held, *moving]


def test_a_motion_starts_at_the_common_stamp_and_not_with_a_command():
    rig = Rig('wall', start_stamp=WAIT)
    assert not rig.tick(START - 10 * ANNOUNCED, TORQUE)  # nobody has given it its start
    assert not rig.run.start(START)
    assert not rig.tick(START - ANNOUNCED - MS)
    assert rig.tick(START - ANNOUNCED)  # by which the controller knows where the robot is
    assert rig.tick(START - MS, TORQUE)
    assert rig.run.index is None
    assert rig.tick(START) and rig.run.index == 0
    assert rig.tick(START + MS, TORQUE) and rig.run.index == 1
    held, moving = rig.advanced(TORQUE)
    assert bare(rig.states) == [held, held, held, moving]
    assert rig.run.skipped == 0


def test_a_start_that_was_configured_needs_no_announcement():
    rig = Rig('wall', start_stamp=START)
    assert rig.tick(START - 10 * ANNOUNCED) and rig.run.index is None
    assert rig.tick(START) and rig.run.index == 0


def test_a_command_that_comes_before_the_common_start_does_not_act_after_it():
    rig = Rig('wall', start_stamp=START)
    rig.tick(START, TORQUE)
    rig.tick(START + MS)
    assert rig.run.skipped == 1


def test_without_a_command_in_time_the_last_one_holds_until_the_time_out():
    rig = Rig('wall', plant__command_timeout=0.004, plant__timeout_action='zero')
    rig.tick(START, TORQUE)
    for k in range(1, 6):
        assert rig.tick(START + k * MS)
        assert rig.run.skipped == k
        assert rig.events == ['time-out'] * (k >= 4)
    torques = [list(state[-3:]) for state in rig.states]
    assert torques == [list(TORQUE)] * 4 + [[0.0, 0.0, 0.0]] * 2
    rig.tick(START + 6 * MS, TORQUE)
    assert list(rig.states[-1][-3:]) == list(TORQUE) and rig.run.skipped == 5
    for k in range(7, 12):
        rig.tick(START + k * MS)
    assert rig.events == ['time-out'] * 2


def test_motors_that_hold_do_so_where_the_robot_was_at_the_time_out(robot):
    """Not where it was with the last command: a spring there would pull it back."""
    spring = {'safety__stiffness': 400.0, 'safety__damping': 0.0}
    rig = Rig('wall', plant__command_timeout=0.004, plant__timeout_action='hold', **spring)
    rig.tick(START, TORQUE)
    for k in range(1, 9):
        rig.tick(START + k * MS)
    states = np.array(bare(rig.states))
    joints, torques = legs(robot, states[:, :3])[0], states[:, 3:]
    begun = 4  # the first state after a step with the safe action
    assert (torques[:begun] == TORQUE).all()
    held = joints[begun - 1]
    expected = 400.0 * (held - joints[begun - 1 : -1])
    np.testing.assert_allclose(torques[begun:], expected, atol=1e-9)
    assert np.abs(expected[1:]).min() > 1e-6


def test_in_lockstep_each_command_leads_to_the_next_state():
    rig = Rig('lockstep')
    assert rig.command() == 0  # nothing has begun yet
    assert not rig.poll(ready=False)
    rig.begin()
    assert rig.command(times=3) == 3
    assert [stamp for stamp, *_ in rig.states] == [STEP_START + k * MS for k in range(4)]
    assert bare(rig.states) == rig.advanced(TORQUE, TORQUE, TORQUE)
    assert rig.run.skipped == 0


def test_in_lockstep_a_common_start_publishes_the_first_state():
    rig = Rig('lockstep', start_stamp=WAIT)
    assert rig.command() == 0 and not rig.poll() and not rig.poll()
    assert rig.publish(rig.run.start(START))
    assert rig.command() == 1
    assert [stamp for stamp, *_ in rig.states] == [START, START + MS]
    assert not rig.poll()


def test_a_state_that_nobody_answers_is_repeated():
    rig = Rig('lockstep')
    rig.begin()
    rig.command()
    assert not rig.poll(unanswered=REPEAT - 1)
    assert not rig.poll(ready=False)
    assert rig.poll(unanswered=REPEAT)
    assert rig.states[1] == rig.states[2]
    rig.run.pause()
    assert not rig.poll()


def test_a_pause_and_steps_change_no_state():
    rig = Rig('lockstep')
    rig.begin()
    rig.command(times=3)
    rig.run.pause()
    assert rig.run.describe() == 'paused at state 3'
    assert rig.command() == 0  # it was on its way, and is kept
    assert rig.publish(rig.run.resume(3))
    assert rig.run.describe() == '2 steps to go at state 4'
    assert rig.command(times=5) == 2
    assert rig.run.describe() == 'paused at state 6'
    assert rig.publish(rig.run.resume())
    assert rig.command(times=2) == 2
    assert rig.run.describe() == 'running at state 9'
    assert bare(rig.states) == rig.advanced(*[TORQUE] * 9)


def test_a_paused_robot_without_a_command_waits_for_one():
    rig = Rig('lockstep')
    rig.begin()
    rig.run.pause()
    assert not rig.run.resume()
    assert rig.command() == 1


def test_a_reset_in_lockstep_begins_again():
    rig = Rig('lockstep')
    rig.begin()
    rig.command(times=3)
    assert rig.run.reset()
    assert rig.run.index is None and rig.command() == 0
    assert rig.poll() and rig.command(times=3) == 3
    assert rig.states[:4] == rig.states[4:]


def test_after_a_common_start_no_state_is_repeated_but_a_reset_begins_again():
    rig = Rig('lockstep', start_stamp=WAIT)
    assert not rig.run.reset()  # there is nothing to begin yet
    rig.publish(rig.run.start(START))
    rig.command(times=3)
    assert not rig.poll() and not rig.poll()
    assert rig.run.reset() and rig.command() == 0
    assert not rig.poll(unanswered=REPEAT - 1)  # commands may be on their way
    rig.begin()
    assert rig.command(times=3) == 3 and rig.states[:4] == rig.states[4:]
    assert not rig.poll() and not rig.poll()


def test_a_motion_stands_still_without_a_command_that_is_due():
    rig = Rig('lockstep')
    assert not rig.run.is_stalled(60.0)
    rig.begin()
    assert rig.run.is_stalled(0.5) and not rig.run.is_stalled(0.4)
    rig.run.pause()
    assert not rig.run.is_stalled(60.0)
    rig.run.resume()
    assert rig.run.is_stalled(60.0) and rig.run.reset() and not rig.run.is_stalled(60.0)


@pytest.mark.parametrize('start', [0, WAIT, START])
def test_a_reset_in_wall_time_holds_the_robot_until_the_next_command(start):
    rig = Rig('wall', start_stamp=start)
    if start == WAIT:
        rig.run.start(START)
    rig.tick(START, TORQUE)
    rig.tick(START + MS, TORQUE)
    assert rig.run.reset()
    for k in range(2, 5):
        assert rig.tick(START + k * MS)
        assert rig.run.index is None
    assert rig.tick(START + 5 * MS, TORQUE) and rig.run.index == 1
    held, moving = rig.advanced(TORQUE)
    assert bare(rig.states[-4:]) == [held, held, held, moving]


@pytest.mark.parametrize('force', FORCES)
def test_a_robot_that_was_driven_out_is_silent_until_its_reset(force):
    rig, stamp = Rig('wall'), START
    while rig.tick(stamp, FORCES[force]):
        stamp += MS
        assert stamp < START + 20_000 * MS
    assert rig.run.outside.startswith(DRIVEN_OUT) and rig.events == ['driven out']
    assert np.isfinite(rig.states).all()
    index = rig.run.index
    assert not rig.tick(stamp + MS, TORQUE) and rig.run.index == index
    assert rig.run.reset()
    assert rig.tick(stamp + 2 * MS) and not rig.run.outside
    assert bare(rig.states[-1:]) == rig.advanced()
    assert rig.events == ['driven out']


@pytest.mark.parametrize('force', FORCES)
def test_in_lockstep_a_robot_that_was_driven_out_takes_no_step(force):
    rig = Rig('lockstep')
    rig.begin()
    while rig.command(FORCES[force]):
        assert len(rig.states) < 20_000
    count = len(rig.states)
    rig.run.pause()
    assert not rig.run.resume() and rig.command() == 0 and not rig.poll()
    assert rig.run.index == count - 1 and rig.events == ['driven out']
    rig.run.reset()
    assert rig.poll() and bare(rig.states[-1:]) == rig.advanced()


@pytest.mark.parametrize('mode', ['wall', 'lockstep'])
def test_after_the_last_state_of_the_motion_nothing_happens(mode):
    rig = Rig(mode, duration=0.005)
    if mode == 'wall':
        states = sum(rig.tick(START + k * MS, TORQUE) for k in range(10))
        assert states == 5  # from state 1 on: the first command was there
    else:
        rig.begin()
        assert rig.command(times=10) == 5 and not rig.poll()
    assert rig.run.finished and rig.run.index == 5
    assert bare(rig.states[-1:]) == rig.advanced(*[TORQUE] * 5)[-1:]


def test_a_motion_without_an_end_goes_on():
    rig = Rig('lockstep', duration=0.0)
    rig.begin()
    assert rig.command(times=20) == 20 and not rig.run.finished
