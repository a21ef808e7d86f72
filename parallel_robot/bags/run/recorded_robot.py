"""The robot of a bag: one that is not of the suite is known by its file."""

from __future__ import annotations

import atexit
import shutil
import tempfile
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from parallel_robot.bags.bag_reader import AS_RECORDED, BagView
from parallel_robot.bags.history import History
from parallel_robot.bags.limits import MEMORY
from parallel_robot.bags.run import recording
from parallel_robot.bags.run.recording import Recording
from parallel_robot.bags.trust import custom_files
from parallel_robot_model.common.errors import BagError, WholeNeededError
from parallel_robot_model.configuration import config
from parallel_robot_model.messages.topics import Topic
from parallel_robot_model.robots.registry import is_known, load_robots

Result = TypeVar('Result')

KEY = 'custom_robots'
SECONDS = 30.0  # of a window: some megabytes a second, and states before and after it
UNKNOWN = (
    'the robot {0} is not known here: no pose, and errors are those seen; --trust runs its file '
    'in the bag, --set custom_robots=[FILE] one of yours (in Python trust=True, '
    "custom_robots=['FILE'])"
)


class RobotCode(NamedTuple):
    """What may run to know the robot of a bag."""

    trust: bool = False  # whether its file in the bag may
    files: tuple[str, ...] = ()  # files of the user's, which come first


NONE = RobotCode()


def code_of(trust: bool, view: BagView) -> RobotCode:
    """What may run, by what is said of a bag.

    Raises:
        InputError: the files of robots are no list.
    """
    return RobotCode(trust, tuple(config.absolute_modules(KEY, view.values.get(KEY, []))))


def read(
    bag: str | Path,
    memory: int = MEMORY,
    code: RobotCode = NONE,
    topics: Collection[Topic] = (),
    view: BagView = AS_RECORDED,
    motion_only: bool = False,
) -> Recording:
    """Read a bag of a run, with a configuration that knows its robot, where its code may run.

    Neither laws nor trajectories of the bag run.

    Args:
        bag: Directory of the bag, or its MCAP file.
        memory: What may be held of it [bytes].
        code: What may run.
        topics: What else is wanted, see :func:`recording.read`.
        view: What the bag does not say itself, and which part is wanted.
        motion_only: Whether references and commands may be missing, see :func:`recording.read`.

    Raises:
        BagError: not a bag of a run, it takes too much, or its robot is in neither bag nor files.
        InputError: a file is not a robot.
    """
    found = recording.read(bag, topics, memory, motion_only, view)
    values = _known(Path(bag), found, code)
    return found._replace(log=found.log._replace(config=values))


def chunks(
    bag: str | Path,
    seconds: float = SECONDS,
    memory: int = MEMORY,
    code: RobotCode = NONE,
    topics: Collection[Topic] = (),
    view: BagView = AS_RECORDED,
    motion_only: bool = False,
) -> Iterator[Recording]:
    """Read a bag of a run in windows, see :func:`recording.chunks`; the rest as :func:`read`.

    Raises:
        BagError: as :func:`recording.chunks`.
        WholeNeededError: likewise; or there is no state in the part that is wanted.
        InputError: a file is not a robot.
    """
    values: dict[str, Any] = {}
    for found in recording.chunks(bag, seconds, topics, memory, motion_only, view):
        values = values or _known(Path(bag), found, code)
        yield found._replace(log=found.log._replace(config=values))
    if not values:
        raise WholeNeededError(f'{bag} has no states in its windows')


def evaluated(
    evaluate: Callable[[Iterator[Recording]], Result],
    bag: str | Path,
    memory: int = MEMORY,
    code: RobotCode = NONE,
    topics: Collection[Topic] = (),
    view: BagView = AS_RECORDED,
    motion_only: bool = False,
) -> Result:
    """Evaluate a bag in windows, or at once where all of it is needed at once.

    Args:
        evaluate: What to make of its windows; raises WholeNeededError where they are not enough.
        bag: Directory of the bag, or its MCAP file.
        memory: What may be held of it at once [bytes].
        code: What may run.
        topics: What else is wanted.
        view: What the bag does not say itself, and which part is wanted.
        motion_only: Whether references and commands may be missing.

    Raises:
        BagError: as :func:`read`.
        InputError: a file is not a robot.
    """
    try:
        return evaluate(chunks(bag, SECONDS, memory, code, topics, view, motion_only))
    except WholeNeededError:
        return evaluate(iter([read(bag, memory, code, topics, view, motion_only)]))


def _known(bag: Path, found: Recording, code: RobotCode) -> dict[str, Any]:
    """The configuration of a bag with its robot, see :func:`read`."""
    log, past, _ = found
    values = log.config | {KEY: config.absolute_modules(KEY, list(code.files))}
    name = values['robot_model']
    if not is_known(values):
        values[KEY] = values[KEY] + _of_bag(bag, past, log.config, code)
        if not is_known(values) and code.trust:
            raise BagError(f'{bag} does not hold the robot {name}; --set {KEY}=[FILE] gives it')
        if not is_known(values) and code.files:
            raise BagError(f'{bag} is of the robot {name}, but {KEY} has no file {name}.py')
    return {**load_robots(values).robots.get(name, {}), **values}


def unknown(values: Mapping[str, Any]) -> str:
    """What a robot that is not known lacks, and what helps; empty where it is known."""
    return '' if is_known(values) else UNKNOWN.format(values['robot_model'])


def _of_bag(bag: Path, past: History, values: Mapping[str, Any], code: RobotCode) -> list[str]:
    """The file of the robot of a bag, there until this process ends; none if it may not run."""
    directory = tempfile.mkdtemp()
    atexit.register(shutil.rmtree, directory, ignore_errors=True)
    own = {KEY: past.sources.get(KEY, {})}
    try:
        return custom_files(bag, own, values, Path(directory), code.trust)[KEY]
    except BagError:
        if code.trust:
            raise
        return []
