"""The command `top` beside real nodes."""

import time

from ros_fixtures import PATIENCE, SLOW_LOOP, until

from parallel_robot.cli.command_line import main
from parallel_robot.cli.commands import top
from parallel_robot.watch import ros_graph
from parallel_robot.watch.robots import Robots
from parallel_robot.watch.ros_graph import RosGraph
from parallel_robot_model.processes.node_processes import MODULES

pytest_plugins = ['ros_fixtures']

JOINTS = ['joint1', 'joint2', 'joint3']  # of the controller; the plant tells more


def test_a_running_loop_is_shown_and_obeys(launch, peer, capsys, monkeypatch):
    monkeypatch.setattr(ros_graph, 'ANSWER_TIMEOUT', PATIENCE)
    monkeypatch.setattr(top, 'PATIENCE', PATIENCE)
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

        def shows(condition):
            peer.until(lambda: graph.look() or condition(robots['/left']))

        def moves(robot):
            return all(
                float(robot.value(node, name) or 0.0) > 0.0
                for node in ('trajectory', 'plant', 'controller')
                for name in ('rate [Hz]', 'processor [%]')
            )

        shows(moves)
        shows(lambda robot: robot.error and robot.error.largest < 0.1)
        shows(lambda robot: [one.name for one in robot.joints(time.monotonic())] == JOINTS)
        shows(lambda robot: robot.law == 'computed_torque' and {'smc', 'pid'} < set(robot.laws))
        done, reason = asked(graph.switch_law, 'nonsense')
        assert not done and reason.startswith("refused: unknown law 'nonsense'")
        assert asked(graph.switch_law, 'pid') == (True, '')
        shows(lambda robot: [one.name for one in robot.joints(time.monotonic())] == JOINTS)
        shows(lambda robot: robot.law == 'pid')
        assert asked(graph.emergency_stop)[0]
        shows(lambda robot: robot.fault == 'emergency stop')

    def picture():
        assert main(['top']) == 0
        out, _ = capsys.readouterr()
        assert out.startswith(' parallel_robot top  /left')
        return 'fault: emergency stop' in out  # if it was heard within two seconds

    until(picture)
