"""A motion that is changed during a run: what its bag says, and what commands make of it."""

import numpy as np
import pytest
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter

from parallel_robot.analysis.replay import bag_rerun
from parallel_robot.bags.run import recording
from parallel_robot.cli.command_line import main
from parallel_robot_model.messages import topics

pytest_plugins = ['ros_fixtures']

CHANGES = (
    {'circle.radius': 0.02, 'circle.center': [0.495, 0.37]},
    {'trajectory.shape': 'ellipse', 'trajectory.transition': 1.0},
)


@pytest.fixture
def bag(launch, domain, peer, tmp_path):
    """A bag of a run during which the motion was changed twice, and once not."""
    words = ['--duration', '8', '--time-mode', 'lockstep', '--out', 'bag']
    process = launch('parallel_robot.cli.command_line', 'run', 'paper_circle', *words)
    references = peer.listen(topics.REFERENCE)
    peer.until(lambda: references or not process.running)

    def set_(**changes):
        wanted = [Parameter(key, value=value).to_parameter_msg() for key, value in changes.items()]
        request = SetParametersAtomically.Request(parameters=wanted)
        name = 'trajectory/set_parameters_atomically'
        return peer.call(SetParametersAtomically, name, request, process).result

    assert set_(**CHANGES[0]).successful
    refused = set_(**{'circle.radius': 0.4, 'circle.rate': 1.0})
    assert not refused.successful and refused.reason.startswith('motion refused at t = ')
    assert set_(**CHANGES[1]).successful
    assert process.wait() == 0, process.stderr
    return tmp_path / 'bag'


def test_the_bag_tells_each_change_and_what_cannot_be_repeated(bag, capsys):
    log, past, _ = recording.read(bag)
    found = [change for change in past.changes if change.node == '/trajectory']
    granted = [change for change in found if 'granted.motion' in change.values]
    told = [change.values for change in granted]
    assert [values['granted.motion'].split()[0] for values in told] == ['circle', 'ellipse']
    assert told[1]['granted.motion'].endswith(', in 1 s')
    assert tuple(c.values for c in found if 'granted.motion' not in c.values) == CHANGES
    assert log.config['circle.radius'] == 0.03  # as at the start
    assert 'the motion was changed 2 times' in bag_rerun.doubts(log.config, past)[-1]
    stamp = int(told[0]['granted.motion'].split(' stamp ')[1].split()[0])
    assert (np.abs(np.diff(log.reference_acceleration, axis=0)) < 0.1).all()
    assert 0 < stamp - log.start_stamp < 8 * 10**9
    capsys.readouterr()
    assert main(['replay', str(bag)]) == 0
    assert 'identical: 8001 commands' in capsys.readouterr().out
    assert main(['analyze', str(bag)]) == 0
    times = ', '.join(f'{(change.stamp - log.start_stamp) * 1e-9:.3f}' for change in granted)
    assert f'the motion was changed at t = {times} s' in capsys.readouterr().out
