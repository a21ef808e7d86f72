"""References as others plan them: a whole motion in a message, or without rates.

MoveIt and the joint trajectory controller of ros2_controllers send a motion as a few points, which
the controller joins: by lines where they have positions alone, else by cubic splines. The
controller's own state says what it wants at each moment.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from parallel_robot.bags.limits import DESCRIPTION, is_name
from parallel_robot.bags.messages.message_types import Messages, Samples, deserialize
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.messages import layouts
from parallel_robot_model.messages.topics import REFERENCE

STEP = 10**6  # ns between two samples of a motion
LONGEST = 1_000_000  # samples of a motion; a longer one has longer steps
STATE = 'control_msgs/msg/JointTrajectoryControllerState'
BUILT_IN = {
    'builtin_interfaces/msg/Time': 'int32 sec\nuint32 nanosec',
    'builtin_interfaces/msg/Duration': 'int32 sec\nuint32 nanosec',
}
WANTED = ('reference', 'desired')  # fields of it, since Humble and before


class Held(Samples):
    """A sample without rates, which counts as it is until the next."""

    __slots__ = ()


class Planned(Samples):
    """Samples of one motion, which ends where the next one begins.

    Without numbers, it is none: a trajectory without points stops the one before.
    """

    __slots__ = ()


def samples(messages: Messages) -> list[Samples]:
    """Samples of trajectories of any number of points.

    Raises:
        ValueError: one of them is none.
    """
    found: list[Samples] = []
    for log_time, row in zip(messages.log_times.tolist(), messages.payloads, strict=True):
        if len(row) > DESCRIPTION:
            raise ValueError(f'a message of more than {DESCRIPTION} bytes')
        try:
            trajectory = deserialize(row.tobytes(), REFERENCE.type)
        except Exception as error:  # in broken bytes, anything can go wrong
            raise ValueError(f'no trajectory: {error}') from None
        found.append(_motion(log_time, trajectory))
    return found


def cut(parts: Sequence[Samples]) -> tuple[list[Samples], int]:
    """Motions up to the beginning of the next one; and how many samples have no rates."""
    motions = sorted(
        (part for part in parts if isinstance(part, Planned)), key=lambda part: int(part.stamps[0])
    )
    found = [part for part in parts if part.numbers and not isinstance(part, Planned)]
    for k, part in enumerate(motions):
        if not part.numbers:
            continue
        end = int(motions[k + 1].stamps[0]) if k + 1 < len(motions) else None
        rows = slice(None) if end is None else part.stamps < end
        numbers = {name: values[rows] for name, values in part.numbers.items()}
        if end is None or part.stamps[0] < end:
            found.append(Planned(part.joints, part.log_times[rows], part.stamps[rows], numbers))
    return found, sum(isinstance(part, Held) for part in parts)


def _motion(log_time: int, trajectory: Any) -> Samples:
    """Samples of one trajectory."""
    joints = tuple(trajectory.joint_names)
    points, stamp = trajectory.points, trajectory.header.stamp
    start = stamp.sec * NANOSECONDS + stamp.nanosec or log_time  # zero: at once
    if not points:
        return Planned((), np.array([log_time]), np.array([start]), {})
    if not joints or not all(map(is_name, joints)):
        raise ValueError('a trajectory without names of joints')
    times = np.array(
        [p.time_from_start.sec * NANOSECONDS + p.time_from_start.nanosec for p in points]
    )
    position, rate = (_rows(points, name, len(joints)) for name in ('positions', 'velocities'))
    if position is None:
        raise ValueError('a trajectory without positions')
    if len(points) == 1:
        numbers = {'position': position, 'velocity': np.zeros_like(position)}
        acceleration = _rows(points, 'accelerations', len(joints))
        numbers['velocity'] = numbers['velocity'] if rate is None else rate
        numbers['acceleration'] = 0.0 * position if acceleration is None else acceleration
        stamps = start + times
        kind = Held if rate is None else Samples
        return kind(joints, np.array([log_time]), stamps, numbers)
    if (np.diff(times) <= 0).any() or times[0] < 0:
        raise ValueError('a trajectory whose times do not increase')
    step = max(STEP, int(times[-1] - times[0]) // LONGEST)
    rows = np.arange(times[0], times[-1] + 1, step)
    seconds, wanted = times / NANOSECONDS, rows / NANOSECONDS
    if rate is None:  # by lines
        slopes = np.diff(position, axis=0) / np.diff(seconds)[:, np.newaxis]
        piece = np.clip(np.searchsorted(times, rows, side='right') - 1, 0, len(slopes) - 1)
        way = (wanted - seconds[piece])[:, np.newaxis]
        numbers = {'position': position[piece] + way * slopes[piece], 'velocity': slopes[piece]}
        numbers['acceleration'] = np.zeros_like(numbers['position'])
    else:
        from scipy.interpolate import CubicHermiteSpline  # slow to import

        spline = CubicHermiteSpline(seconds, position, rate)
        names = ('position', 'velocity', 'acceleration')
        numbers = {name: spline(wanted, k) for k, name in enumerate(names)}
    return Planned(joints, np.full(len(rows), log_time), start + rows, numbers)


def _rows(points: Iterable[Any], name: str, size: int) -> np.ndarray | None:
    """A field of all points, shape (N, n); None where one lacks it."""
    found = [np.asarray(getattr(point, name), float) for point in points]
    return np.array(found) if all(each.shape == (size,) for each in found) else None


def translator(definition: str) -> Callable[[Messages], list[Messages]]:
    """Function that makes references of the states of a joint trajectory controller.

    Args:
        definition: That of the type, as the bag has it.

    Raises:
        BagError: it has none that is understood.
    """
    from rosbags.typesys import get_types_from_msg  # slow to import
    from rosbags.typesys.store import Typestore

    store = Typestore()
    for name, text in BUILT_IN.items():  # which definitions may leave out
        store.register(get_types_from_msg(text, name))
    try:
        store.register(get_types_from_msg(definition, STATE))
    except Exception as error:
        raise BagError(f'no definition of {STATE} that is understood: {error}') from None

    def translate(messages: Messages) -> list[Messages]:
        found = []
        for log_time, row in zip(messages.log_times, messages.payloads, strict=True):
            try:
                state: Any = store.deserialize_cdr(row.tobytes(), STATE)
                point = next(getattr(state, name) for name in WANTED if hasattr(state, name))
                joints, size = tuple(state.joint_names), len(state.joint_names)
                stamp = state.header.stamp.sec * NANOSECONDS + state.header.stamp.nanosec
            except Exception as error:  # in broken bytes, anything can go wrong
                raise BagError(f'no {STATE}: {error}') from None
            position, rate = (_rows([point], name, size) for name in ('positions', 'velocities'))
            if position is None or not joints or not all(map(is_name, joints)):
                continue  # before its first goal
            rate = np.zeros_like(position) if rate is None else rate
            record = layouts.joint_trajectory(joints).records(
                1, np.array([stamp]), position=position, velocity=rate
            )
            raw = np.frombuffer(record.tobytes(), np.uint8)
            found.append(Messages(np.array([log_time]), raw[np.newaxis]))
        return found

    return translate
