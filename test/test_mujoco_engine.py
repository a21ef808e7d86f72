"""MuJoCo in the place of the equations of motion: in the plant alone, and in a graph of nodes."""

import numpy as np
import pytest
from bags import content

from parallel_robot.bags.run import recording
from parallel_robot.cli.command_line import main
from parallel_robot_control.configuration import resolve
from parallel_robot_sim.configuration import configure_plant
from parallel_robot_sim.mujoco_simulator import simulator_of

pytest_plugins = ['ros_fixtures']

FINE = {'plant.integrator': 'rk4', 'plant.substeps': 10}
TORQUE = {'paper_circle': 1.0, 'serial_2r_circle': 1.0, 'axes_step': 0.05}  # N m


@pytest.mark.parametrize('scenario', TORQUE)
@pytest.mark.parametrize('period', [0.0005, 0.002])
def test_both_engines_move_the_robot_alike(scenario, period):
    values = resolve(scenario) | FINE | {'period': period}
    n = len(values['joints'])
    # With dry friction both stick and slip, at instants that depend on the steps.
    values |= {
        'friction.coulomb': [0.0] * n,
        'disturbance.amplitude': [0.1] * n,
        'actuator.delay': 2 * period,
        'actuator.lag': [0.003] * n,
    }
    ours, theirs = (
        simulator_of(configure_plant(values | {'plant.engine': engine}))
        for engine in ('analytic', 'mujoco')
    )
    assert type(ours) is not type(theirs)
    begin = ours.pose.copy()
    for k in range(round(0.5 / period)):
        torque = TORQUE[scenario] * np.sin(8 * np.pi * period * k * np.arange(1, n + 1))
        ours.advance(torque)
        theirs.advance(torque)
        assert theirs.message(k)[4:12] == ours.message(k)[4:12]
    assert np.abs(ours.pose - begin).max() > 1e-3
    assert np.abs(ours.pose - theirs.pose).max() < 1e-9
    mine, other = ours.measurement(), theirs.measurement()
    assert np.allclose(mine.velocity, other.velocity, atol=1e-8)
    assert np.array_equal(ours.state.torque, theirs.state.torque)


def test_a_graph_of_nodes_moves_it_as_the_simulation_does(launch, domain, tmp_path):
    changes = [f'{key}={value}' for key, value in FINE.items()]
    changes += ['friction.coulomb=[0,0,0]']
    words = ['paper_circle', '--duration', '0.5', *(w for c in changes for w in ('--set', c))]
    process = launch(
        *('parallel_robot.cli.command_line', 'run', *words, '--time-mode', 'lockstep'),
        *('--set', 'plant.engine=mujoco', '--out', 'bag'),
    )
    assert process.wait() == 0, process.stderr
    assert main(['simulate', *words, '--out', str(tmp_path / 'simulated')]) == 0
    theirs, ours = (recording.read(tmp_path / name).log for name in ('bag', 'simulated'))
    assert np.array_equal(theirs.time, ours.time)
    assert np.abs(theirs.position - ours.position).max() < 1e-8
    assert theirs.config['plant.engine'] == 'mujoco'
    states = content(tmp_path / 'bag' / 'bag_0.mcap')['joint_states']
    assert states != content(tmp_path / 'simulated' / 'simulated_0.mcap')['joint_states']


@pytest.mark.parametrize('words', [('simulate', 'paper_circle'), ('compare', 'paper_circle')])
def test_a_compiled_loop_refuses_it(words, tmp_path, capsys):
    words = [*words, '--set', 'plant.engine=mujoco', '--duration', '1']
    words += ['--out', str(tmp_path / 'bag')] if words[0] == 'simulate' else []
    assert main(words) == 2
    err = capsys.readouterr().err
    assert 'plant.engine must be analytic in a compiled loop' in err and err.count('\n') == 1
    assert not any(tmp_path.iterdir())


def test_an_unknown_engine_is_refused(capsys):
    assert main(['show', 'paper_circle', '--set', 'plant.engine=bullet']) == 2
    line = "unknown value of plant.engine 'bullet' (known: analytic, mujoco)"
    assert line in capsys.readouterr().err
