"""The warm parent of processes: it has imported the suite and loaded the kernels of the nodes.

This costs each process two seconds of processor time. The parent, a fork server, has never started
rclpy: what a node is besides, its process still becomes by itself.
"""

import ctypes
import importlib
import os
import signal
import subprocess
import sys
import traceback
from pathlib import Path

from parallel_robot_base import config
from parallel_robot_base.module_process import START
from parallel_robot_base.processes import MODULES
from parallel_robot_cli import command_line  # noqa: F401  imported for the processes
from parallel_robot_control.configuration import configure
from parallel_robot_control.controller import Controller
from parallel_robot_sim.configuration import configure_plant
from parallel_robot_sim.simulator import Simulator

ROOT = Path(__file__).parents[1]
NAMES = {module: name for name, module in MODULES.items()}
PR_SET_NAME = 15  # Linux prctl: name of this process, in /proc/PID/comm
DESCRIPTORS = 1024  # more than a process of the suite has open at once

for one in (*MODULES.values(), 'parallel_robot_bags.player_node'):
    importlib.import_module(one)
_values = config.resolve('paper_circle')
Controller(configure(_values))
Simulator(configure_plant(_values)).warm()


def run(module, words, folder, environment, files):
    """Be a module of the suite that was started with these words; in a forked process."""
    os.chdir(folder)
    for number, path in enumerate(files, start=1):  # output and errors
        descriptor = os.open(path, os.O_WRONLY | os.O_APPEND)
        os.dup2(descriptor, number)
        os.close(descriptor)
    subprocess.Popen = _Forking
    sys.exit(_become(module, words, environment))


def _become(module, words, environment):
    """Run a module as if the interpreter had been started for it; returns its exit code."""
    os.environ.clear()
    os.environ.update(environment)
    own = {str(ROOT), str(ROOT / 'test'), str(ROOT / 'benchmarks')}
    sys.path[:] = [str(ROOT), *(entry for entry in sys.path if entry not in own)]
    sys.argv = [module, *words]
    return importlib.import_module(module).main()


class _Forking(subprocess.Popen):
    """Starts nodes by forking this process, which is warm, too; all else as usual."""

    def _execute_child(
        self, args, executable, preexec_fn, close_fds, pass_fds, cwd, env, startupinfo,
        creationflags, shell, p2cread, p2cwrite, c2pread, c2pwrite, errread, errwrite, *others,
    ):  # fmt: skip
        words = list(args)
        module = words[words.index(START) + 2] if START in words else None
        if module not in NAMES:
            return super()._execute_child(
                args, executable, preexec_fn, close_fds, pass_fds, cwd, env, startupinfo,
                creationflags, shell, p2cread, p2cwrite, c2pread, c2pwrite, errread, errwrite,
                *others,
            )  # fmt: skip
        self.pid = os.fork()
        if not self.pid:
            words = words[words.index(module) + 1 :]
            _be_child(module, words, env, preexec_fn, (p2cread, c2pwrite, errwrite))
        self._child_created = True
        self._close_pipe_fds(p2cread, p2cwrite, c2pread, c2pwrite, errread, errwrite)


def _be_child(module, words, environment, preexec_fn, descriptors):
    """Do what `subprocess` does before it executes a program, then be the node."""
    code = 1
    try:
        os.setsid()
        preexec_fn()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        for number, descriptor in enumerate(descriptors):
            if descriptor != -1:
                os.dup2(descriptor, number)
        os.closerange(3, DESCRIPTORS)
        ctypes.CDLL(None).prctl(PR_SET_NAME, NAMES[module].encode())
        code = _become(module, words, environment)
    except SystemExit as end:
        code = end.code
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code or 0)
