"""The command ``run``: the nodes in processes of their own, with a common start, recorded."""

from __future__ import annotations

import argparse
import contextlib
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from parallel_robot.analysis import timing
from parallel_robot.bags import history, output
from parallel_robot.bags.experiment import OF_RUN, command_line
from parallel_robot.bags.output import Progress
from parallel_robot.bags.run.recorded_robot import RobotCode
from parallel_robot.cli import shared
from parallel_robot.cli.commands import simulate
from parallel_robot.cli.shared import TEXT, add_format_argument, show, tell, warn
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import (
    DRIVEN_OUT,
    BagError,
    InputError,
    RunError,
    StoppedError,
)
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.configuration import hazards, yaml_file
from parallel_robot_model.configuration.config_files import absolute_scenario
from parallel_robot_model.configuration.loop import WAIT, LoopParameters
from parallel_robot_model.configuration.plain_data import with_location
from parallel_robot_model.messages.topics import add_namespace_argument, full, subscribers
from parallel_robot_model.processes import cache_directory, realtime
from parallel_robot_model.processes.child_process import command, die_with_parent
from parallel_robot_model.processes.node_processes import MODULES, NodeProcesses, domain_lock, end
from parallel_robot_model.processes.termination_signals import termination_signals
from parallel_robot_sim.configuration import Configuration, assemble, configure
from parallel_robot_sim.simulation import ENDLESS, plant_warnings
from trajectory_gen.preflight import motion_warnings

if TYPE_CHECKING:
    from parallel_robot.cli.ros_session import Session

READY = 60.0  # s, for nodes that do nothing and yet are not ready
LEAD = 3 * NANOSECONDS // 2  # ns, from the common start being set to t = 0
STANDSTILL = 30.0  # s, without progress of the plant before the run is given up
LOOK = 0.1  # s, between two looks at the processes
# What acts on a run from outside: its processes, a session, seconds since t = 0 (wall time).
During = Callable[[NodeProcesses, 'Session', float], None]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    simulate.add_run_arguments(parser)
    parser.add_argument(
        '--time-mode',
        choices=['wall', 'lockstep'],
        help='wall (default): real time; lockstep: the plant waits for each command',
    )
    parser.add_argument(
        '--live', action='store_true', help='serve the page of `parallel_robot live` meanwhile'
    )
    add_namespace_argument(parser, 'of the nodes, so that several robots share a ROS domain')
    add_format_argument(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    changed = simulate.overrides(arguments)
    if arguments.time_mode is not None:
        changed = changed | {'time_mode': arguments.time_mode}
    for key in OF_RUN:
        if key in yaml_file.parse_assignments(arguments.assignments):
            raise InputError(f'{key} is set by run itself; it cannot be changed by --set')
        changed.pop(key, None)  # of a parameter file, which may be one for other runs
    namespace = full(arguments.namespace)
    if arguments.live:
        duration = resolve(arguments.scenario, changed)['duration']
        tell(arguments.format, f'the page ends with the run, after {duration:g} s')
        sys.stdout.flush()
    with live_page(namespace) if arguments.live else contextlib.nullcontext():
        form, shown = arguments.format, arguments.live
        return record(arguments.scenario, changed, arguments.out, namespace, form, shown)


@contextlib.contextmanager
def live_page(namespace: str) -> Iterator[None]:
    """Serve the page of a robot in a process of its own, which prints its address and ends here.

    Args:
        namespace: Full name of the namespace of the nodes; empty for none.
    """
    words = ('live', '--namespace', namespace or '/')
    page = subprocess.Popen(
        command('parallel_robot', *words),
        stdin=subprocess.DEVNULL,
        start_new_session=True,
        preexec_fn=die_with_parent,
    )
    try:
        yield
    finally:
        end([page], signal.SIGTERM)


def record(
    scenario: str,
    changed: dict[str, Any],
    out: Path,
    namespace: str = '',
    form: str | None = None,
    shown: bool = False,
) -> int:
    """Run a scenario with changes of its configuration into a bag.

    Args:
        scenario: Its name, or the path of its file.
        changed: Key to value.
        out: Directory of the bag.
        namespace: Full name of the namespace of the nodes; empty for none.
        form: Format of the results, see :mod:`shared`.
        shown: Whether a page shows it, which ends with it.

    Returns:
        An exit code: 0, or that of the signal that stopped the run.

    Raises:
        InputError: the configuration is wrong, or the bag cannot be written there.
        RunError: the run did not come to its end.
    """
    values = resolve(scenario, changed)
    configuration = configure(values)
    warn(motion_warnings(configuration.trajectory))
    ended = move(configuration, scenario, changed, out, namespace)
    try:
        made = shared.read_run(out, RobotCode(files=tuple(values['custom_robots'])))
    except BagError:
        if ended.signal:  # before the first state
            raise StoppedError(ended.signal) from None
        raise
    log, past, timed, _ = made
    remarks = [*history.remarks(past, log.start_stamp), *history.losses(past)]
    remarks += timing.remarks(timed, past)
    doubts = (*ended.doubts, *plant_warnings(configuration))
    warn((*doubts, *remarks))
    if ended.signal:
        tell(form, f'{StoppedError(ended.signal)} after {log.time[-1]:.1f} s')
    tell(form, *filter(None, [timing.verdict(timed)]))
    failure = made.failure
    if ended.driven_out:
        failure = f'{DRIVEN_OUT} at t = {log.time[-1]:.3f} s'
    if form in (None, TEXT):
        print(simulate.result(out, lambda: shared.run_lines(made), shown))
    else:
        show(form, *shared.run_tables(made))
    if ended.signal:
        return StoppedError(ended.signal).exit_code
    if failure:
        raise RunError(f'{log.law}: {failure}')
    return 0


def move(
    configuration: Configuration,
    scenario: str,
    changed: dict[str, Any],
    out: Path,
    namespace: str = '',
    during: During = lambda *_: None,
) -> End:
    """Let the nodes run a scenario into a bag.

    Args:
        configuration: The scenario with its changes.
        scenario: Its name, or the path of its file.
        changed: Key to value.
        out: Directory of the bag.
        namespace: Full name of the namespace of the nodes; empty for none.
        during: Called again and again while the robot moves.

    Raises:
        InputError: the configuration is wrong, or the bag cannot be written there.
        RunError: a node failed.
        StoppedError: a signal came before the motion began.
    """
    with with_location(configuration.values):
        if not configuration.loop.duration:
            raise InputError(ENDLESS, 'duration')
        experiment = assemble(configuration)
    output.check_directory(out)
    realtime.prepare_discovery()
    parameters = node_parameters(MODULES, scenario, changed, experiment.loop)
    parameters['recorder']['recorder.out'] = str(out)
    parameters['recorder']['recorder.command_line'] = command_line()
    ended = _supervise(parameters, experiment.loop, namespace, during)
    return ended._replace(doubts=(*experiment.control.law.warnings, *ended.doubts))


def node_parameters(
    names: Collection[str], scenario: str, changed: Mapping[str, Any], loop: LoopParameters
) -> dict[str, dict[str, Any]]:
    """Parameters of some nodes that run together, which wait for their common start.

    Args:
        names: Of the nodes.
        scenario: Its name, or the path of its file.
        changed: Key to value.
        loop: What the nodes share.
    """
    common = {**changed, 'scenario': absolute_scenario(scenario), 'start_stamp': WAIT}
    common['middleware'] = loop.middleware  # which a node must know before it reads a scenario
    if hazards.KEY in changed:
        common[hazards.KEY] = [*loop.hazards]  # as texts: parameters are no mappings
    parameters: dict[str, dict[str, Any]] = {name: {**common} for name in names}
    for name, count in subscribers(names, loop.lockstep).items():
        parameters[name]['subscribers'] = count
    return parameters


class End(NamedTuple):
    """How a motion ended."""

    driven_out: bool = False  # whether the robot was driven out of its workspace
    signal: int = 0  # number of the signal that ended it; 0: none
    # what the theory says against the gains of its law, and what the nodes doubted
    doubts: tuple[str, ...] = ()


def _supervise(
    parameters: dict[str, dict[str, Any]], loop: LoopParameters, namespace: str, during: During
) -> End:
    """Start the nodes, give them their common start, and wait for the end of the motion.

    Raises:
        RunError: a node failed.
        StoppedError: a signal came before the motion began.
    """
    caught: list[int] = []
    handlers = {
        number: signal.signal(number, lambda number, _: caught.append(number))
        for number in termination_signals()
    }
    try:
        with domain_lock(namespace), NodeProcesses(parameters, namespace) as processes:
            from parallel_robot.cli.ros_session import Session  # needs ROS, after the forks

            def watch() -> None:
                if caught:
                    raise StoppedError(caught[0])
                processes.check()

            with Session(MODULES, watch, namespace, loop.middleware) as session:
                begin = start(processes, session, loop, MODULES)

                def act() -> None:
                    during(processes, session, (time.time_ns() - begin) / NANOSECONDS)

                try:
                    with Progress(loop.duration, 's') as progress:
                        samples, duration = loop.last_index or 0, loop.duration
                        follow(processes, session, samples, duration, progress, act)
                except StoppedError as error:
                    return End(signal=error.signal, doubts=tuple(processes.warnings()))
                for name in session.silent(filter(processes.running, MODULES)):
                    warn([f'{name} does not answer any more'])
                return End(session.driven_out, doubts=tuple(processes.warnings()))
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


def start(
    processes: NodeProcesses, session: Session, loop: LoopParameters, names: Collection[str]
) -> int:
    """Wait until some nodes are ready, then give them their common start [ns].

    Raises:
        RunError: one of them does not become ready or does not start.
    """
    with Progress(len(names), 'nodes ready') as progress:
        session.wait_until_ready(
            READY, processes.work, waiting_display(processes, progress, len(names))
        )
    now = time.time_ns()
    stamp = loop.step_start if loop.lockstep else (now + LEAD) // loop.grid * loop.grid
    for name in ('recorder', 'trajectory', 'controller', 'plant'):
        if name in names:
            session.start(name, stamp)
    return stamp


def waiting_display(
    processes: NodeProcesses, progress: Progress, count: int
) -> Callable[[Collection[str]], None]:
    """Make a function that shows which nodes are not ready, and says once that some compile."""
    announced = False

    def show(waiting: Collection[str]) -> None:
        nonlocal announced
        compiling = [name for name in waiting if processes.compiling(name)]
        if compiling and not announced:
            announced = True
            print(f'parallel_robot run: the nodes are {cache_directory.NOTICE}', file=sys.stderr)
        what = (
            f'({", ".join(compiling)} compiling; {cache_directory.compiled()})'
            if compiling
            else ''
        )
        progress.show(count - len(waiting), what)

    return show


def follow(
    processes: NodeProcesses,
    session: Any,
    samples: int,
    duration: float,
    progress: Progress,
    act: Callable[[], None] = lambda: None,
) -> None:
    """Wait until the recorder has all of the motion, or the robot has left its workspace.

    Args:
        processes: The nodes.
        session: Talks to them.
        samples: Index of the last sample.
        duration: Of the motion [s].
        progress: Shows how far the motion is.
        act: Called again and again.

    Raises:
        RunError: the motion stands still.
    """
    seen, since = session.state, time.monotonic()
    while processes.running('recorder'):
        session.spin(LOOK)
        act()
        if session.driven_out:
            return
        if session.state != seen:
            seen, since = session.state, time.monotonic()
            progress.show(round(duration * min(1.0, seen / samples), 1))
        elif time.monotonic() - since > STANDSTILL:
            where = f'the motion stands still at state {seen} of {samples}'
            silent = session.silent(MODULES)
            said = [f'{name}: {text}' for name, text in session.alarms.items() if text]
            if silent:
                said = [f'no answer of {" and ".join(silent)}']
            raise RunError(': '.join([where, *said[:1]]))
    processes.check()
