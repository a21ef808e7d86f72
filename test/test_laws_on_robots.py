"""Every law controls every robot; and what the nodes compute is what the simulation does."""

import numpy as np
import pytest
from assembly import simulated

from parallel_robot_control import assembly as control
from parallel_robot_control.configuration import configure as configure_control
from parallel_robot_control.configuration import resolve
from parallel_robot_control.contract import JointReference
from parallel_robot_control.controller import Controller
from parallel_robot_control.laws import LAWS
from parallel_robot_model.messages import layouts
from parallel_robot_sim.closed_loop import run
from parallel_robot_sim.configuration import assemble, configure, configure_plant
from parallel_robot_sim.plant_run import Simulator

SCENARIOS = ('axes_step', 'serial_2r_circle')
MACHINES = (
    'delta_circle', 'delta_pick_and_place', 'delta_rl5_circle', 'delta_rl5_pick_and_place',
    'hexapod_circle', 'five_bar_circle', 'arm6_circle',
)  # fmt: skip
START, MS = 10**9, 10**6  # ns


@pytest.fixture(scope='module', params=SCENARIOS)
def configuration(request):
    return configure(resolve(request.param, {'duration': 4.0}))


@pytest.mark.parametrize('law', LAWS)
def test_every_law_brings_every_robot_to_its_motion(law, configuration):
    """With the gains of Table 2; the printed NFTSMC has its wide boundary layer here, too."""
    experiment = assemble(configuration)
    motion = experiment.trajectory.sample(np.arange(4001) * 1e-3)
    out = run(control.assemble(configuration, law), experiment.plant, motion, 1e-3)
    error = np.abs(motion.position - out.position)
    assert not out.fault.any() and out.steps == 4001
    assert error[0].max() > 5e-3  # it begins beside the motion
    assert error[2000:].max() < (0.05 if law == 'nftsmc' else 0.008)


@pytest.fixture(scope='module', params=MACHINES)
def begun(request):
    """A described machine with the first 0.3 s of its motion."""
    configuration = configure(resolve(request.param, {'duration': 0.3}))
    experiment = assemble(configuration)
    return configuration, experiment, experiment.trajectory.sample(np.arange(301) * 1e-3)


@pytest.mark.parametrize('law', LAWS)
def test_every_law_begins_the_motion_of_every_machine(law, begun):
    """With the gains of its file: no fault, and no joint goes away from the motion."""
    configuration, experiment, motion = begun
    out = run(control.assemble(configuration, law), experiment.plant, motion, 1e-3)
    error = np.abs(motion.position - out.position)
    assert not out.fault.any() and out.steps == 301
    assert error[200:].max() < 3.0 * error[:50].max()


@pytest.mark.parametrize(('damping', 'stopped'), [(0.1, False), (0.0285, True)])
def test_a_five_bar_that_brakes_as_its_motors_can_runs_half_as_fast_again(damping, stopped):
    """Its circle passes near a singularity: with 20 /s of damping 1.2 times is too fast."""
    values = resolve(
        'five_bar_circle',
        {
            'law': 'lqg_tracking', 'duration': 1.0, 'trajectory.speed_factor': 1.5,
            'safety.damping': damping,
        },
    )  # fmt: skip
    assert resolve('five_bar_circle')['safety.damping'] == 0.1
    assert simulated(values).run.fault.any() == stopped


@pytest.mark.parametrize('law', ['s_fotsmc', 'smc', 'computed_torque'])
def test_an_arm_at_rest_is_held_against_gravity(law):
    """The torque of two points and two rods, computed here from their weights."""
    values = resolve(
        'serial_2r_circle',
        {
            'law': law, 'duration': 3.0, 'trajectory.shape': 'hold', 'hold.pose': [0.35, 0.3],
            'plant.initial_pose': [0.35, 0.3], 'friction.coulomb': 0.0,
        },
    )  # fmt: skip
    out = simulated(values).run
    q1, q12 = out.position[-1].cumsum()[[0, 1]]
    arm = {key: values[f'robot.{key}'] for key in ('m1', 'm2', 'mp', 'l1', 'l2', 'lc1', 'lc2')}
    distal = 9.81 * np.cos(q12) * (arm['m2'] * arm['lc2'] + arm['mp'] * arm['l2'])
    proximal = arm['m1'] * arm['lc1'] + (arm['m2'] + arm['mp']) * arm['l1']
    weight = [9.81 * np.cos(q1) * proximal + distal, distal]
    assert np.abs(out.velocity[-1]).max() < 1e-3
    assert np.allclose(out.command[-1], weight, rtol=2e-3, atol=0.02)


@pytest.mark.parametrize('scenario', SCENARIOS)
def test_messages_of_controller_and_plant_close_the_same_loop(scenario):
    """Bytes in, bytes out, as the nodes do in lockstep: the torques of the compiled loop."""
    values = resolve(scenario, {'duration': 0.3, 'time_mode': 'lockstep'})
    whole = simulated(values)
    configured = configure_control(values)
    alone = {'s_fotsmc': configured.laws['s_fotsmc']}
    controller = Controller(configured.with_parts(laws=alone))
    plant = Simulator(configure_plant(values))
    joints = configured.loop.joints
    reader = layouts.float64_multi_array(len(joints))
    command = np.zeros(len(joints))
    for k in range(301):
        stamp = START + k * MS
        rows = (whole.reference.position, whole.reference.velocity, whole.reference.acceleration)
        controller.add_reference(stamp, JointReference(*(row[k] for row in rows)))
        assert controller.answer(plant.message(stamp)) > 0
        torque = reader.decode(controller.command)['data'][0]
        assert np.array_equal(torque, whole.run.command[k]), k
        assert plant.read(controller.command, command)
        plant.advance(command)
