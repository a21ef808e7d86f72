"""The warm parent of processes: it has imported the suite and loaded the kernels of the nodes.

This costs each process two seconds of processor time. The parent, a fork server, has never started
rclpy: what a node is besides, its process still becomes by itself.
"""

import gc
import importlib
import inspect
import os
import sys
from pathlib import Path

from rclpy.type_support import check_for_type_support

from parallel_robot.cli import command_line  # noqa: F401  imported for the processes
from parallel_robot_control.configuration import configure
from parallel_robot_control.controller import Controller
from parallel_robot_model.configuration import config
from parallel_robot_model.messages import topics
from parallel_robot_model.nodes.connections import message_class
from parallel_robot_model.processes import child_process
from parallel_robot_model.processes.node_processes import MODULES
from parallel_robot_sim.configuration import configure_plant
from parallel_robot_sim.plant_run import Simulator
from trajectory_gen import preflight
from trajectory_gen.configuration import motions_of, trajectory_of

ROOT = Path(__file__).parents[1]

for one in (*MODULES.values(), 'parallel_robot.bags.player_node'):
    importlib.import_module(one)
_values = config.resolve('paper_circle')
Controller(configure(_values))
Simulator(configure_plant(_values)).warm()
preflight.check(trajectory_of(_values), _values['period'])
motions_of(_values).load_kernels()
for topic in topics.RECORDED:
    check_for_type_support(message_class(topic.type))
inspect.stack()  # looks at all modules once: the first line of a node's log does so, too
gc.collect()
gc.freeze()  # a node looks through what it has made itself


def run(module, words, folder, environment, files):
    """Be a module of the suite that was started with these words; in a forked process."""
    os.chdir(folder)
    for number, path in enumerate(files, start=1):  # output and errors
        descriptor = os.open(path, os.O_WRONLY | os.O_APPEND)
        os.dup2(descriptor, number)
        os.close(descriptor)
    child_process.can_fork = lambda: True  # though rclpy is imported
    sys.exit(_become(module, words, environment))


def _become(module, words, environment):
    """Run a module as if the interpreter had been started for it; returns its exit code."""
    os.environ.clear()
    os.environ.update(environment)
    own = {str(ROOT), str(ROOT / 'test'), str(ROOT / 'benchmarks')}
    first = environment['PYTHONPATH'].split(os.pathsep)
    sys.path[:] = [*first, *(entry for entry in sys.path if entry not in own)]
    sys.argv = [module, *words]
    return importlib.import_module(module).main()
