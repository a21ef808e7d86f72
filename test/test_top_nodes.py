"""The command `top` beside real nodes."""

import pytest
from ros_fixtures import SLOW_LOOP

from parallel_robot_analysis.command_line import main
from parallel_robot_analysis.processes import MODULES
from parallel_robot_analysis.top.robots import Robots
from parallel_robot_analysis.top.ros_graph import RosGraph

pytest_plugins = ['ros_fixtures']
pytestmark = pytest.mark.xdist_group('processes')


def test_a_running_loop_is_shown_and_obeys(launch, peer, capsys):
    words = [word for parameter in SLOW_LOOP for word in ('-p', parameter)]
    for name in ('trajectory', 'plant', 'controller'):
        launch(MODULES[name], '--ros-args', '-r', '__ns:=/left', *words)
    robots, answers = Robots(), []

    def asked(ask, *what):
        """What the controller answers."""
        answers.clear()
        ask(*what, lambda *answer: answers.append(answer))
        peer.until(lambda: graph.answers() or answers)
        return answers[0]

    with RosGraph(robots) as graph:
        assert asked(graph.emergency_stop) == (False, 'there is no controller')
        graph.watch('/left')

        def until(condition):
            peer.until(lambda: graph.look() or condition(robots['/left']))

        nodes = ('trajectory', 'plant', 'controller')
        until(
            lambda robot: (
                robot.error and all(robot.value(node, 'rate [Hz]') > '1' for node in nodes)
            )
        )
        robot = robots['/left']
        for node in nodes:
            assert float(robot.value(node, 'rate [Hz]')) >= 0.0
            assert float(robot.value(node, 'processor [%]')) > 0.0
        assert robot.law == 'computed_torque' and {'smc', 's_fotsmc'} < set(robot.laws)
        assert robot.error.largest < 0.1
        done, reason = asked(graph.switch_law, 'nonsense')
        assert not done and reason.startswith("refused: unknown law 'nonsense'")
        assert asked(graph.switch_law, 'pid') == (True, '')
        until(lambda robot: robot.law == 'pid')
        assert asked(graph.emergency_stop)[0]
        until(lambda robot: robot.fault == 'emergency stop')
    assert main(['top']) == 0
    out, _ = capsys.readouterr()
    assert out.startswith(' parallel_robot top  /left') and 'fault: emergency stop' in out
