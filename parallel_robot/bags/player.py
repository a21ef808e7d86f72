"""The player without ROS: sends the messages of a bag, each at its time."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Collection
from operator import attrgetter
from typing import Annotated, NamedTuple

from parallel_robot.bags.indexed_reader import BagReader
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.messages.topics import JOINT_STATES

STATES = f'/{JOINT_STATES.name}'  # suffix of the topic that sets the rhythm of the loop


class PlayerOptions(NamedTuple):
    """How a bag is played."""

    bag: Annotated[str, Field('', 'directory of the bag, or its MCAP file')]
    rate: Annotated[float, Field('', 'times real time', 1e-3, 1e3)] = 1.0
    start: Annotated[float, Field('s', 'where to begin, since the first message', 0.0)] = 0.0
    duration: Annotated[float, Field('s', 'how much to play; 0: all', 0.0)] = 0.0
    loop: Annotated[bool, Field('', 'begin again at the end')] = False
    clock: Annotated[
        float, Field('Hz', 'publish /clock so often in the time of the bag; 0: not', 0.0, 1e4)
    ] = 0.0
    topics: Annotated[tuple[str, ...], Field('', 'play only these topics')] = ()
    pause: Annotated[bool, Field('', 'begin paused')] = False
    fast: Annotated[bool, Field('', 'do not keep time, only wait for the receivers')] = False


class Player:
    """Plays a bag in the thread that calls :meth:`run`; other methods may be called from any.

    The time of the bag is its log time. It passes `rate` times as fast as real time, from an
    origin that every pause, step, seek and new rate sets again: delays are caught up, nothing
    drifts. Messages of one log time go out together; a sample of the loop ends where the
    next state begins, or without states with its log time.
    """

    def __init__(
        self,
        bag: BagReader,
        topics: Collection[str],
        options: PlayerOptions,
        send: Callable[[str, bytes], None],
        tick: Callable[[int], None],
    ) -> None:
        """Prepare.

        Args:
            bag: What to play.
            topics: Names, with leading slash, of what to send.
            options: How to play it.
            send: Called with topic and bytes of each message.
            tick: Called with the time of the bag [ns], `options.clock` times a second of it, and
                as often while paused.

        Raises:
            InputError: the start lies behind the end of the bag.
        """
        self.sent = 0  # messages sent
        self.paused = options.pause  # whether the time of the bag is stopped
        self._bag = bag
        self._topics = topics
        self._states = next((name for name in topics if name.endswith(STATES)), None)
        self._options = options
        self._rate = options.rate
        self._send = send
        self._tick = tick
        self._tick_period = round(NANOSECONDS / options.clock) if options.clock else 0
        self._next_tick = 0  # ns of the bag
        self._first = self._moment(options.start)
        self._last = bag.end
        if options.duration:
            self._last = min(self._last, self._first + round(options.duration * NANOSECONDS))
        self._changed = threading.Condition()
        self._stopped = False
        self._steps = 0  # still to begin
        self._stepping = False  # whether one is under way
        self._target: int | None = None  # ns of the bag, where to continue instead
        self._origin = (self._first, time.monotonic_ns())  # time of the bag, real time

    @property
    def position(self) -> float:
        """Time of the bag since its start [s]."""
        return (min(self._now(), self._bag.end) - self._bag.start) / NANOSECONDS

    @property
    def stopped(self) -> bool:
        """Whether :meth:`stop` was called."""
        return self._stopped

    def run(self) -> None:
        """Play to the end, or until :meth:`stop`.

        Raises:
            BagError: the file is broken.
        """
        going_on = True
        while going_on:
            with self._changed:
                target = self._first if self._target is None else self._target
                self._target = None
            going_on = self._play(target)

    def stop(self) -> None:
        """Make :meth:`run` return soon."""
        with self._changed:
            self._stopped = True
            self._changed.notify()

    def pause(self) -> None:
        """Stop the time of the bag."""
        with self._changed:
            self._origin = (self._now(), time.monotonic_ns())
            self.paused = True
            self._changed.notify()

    def resume(self) -> None:
        """Let time go on from where it stopped."""
        with self._changed:
            self._origin = (self._now(), time.monotonic_ns())
            self._steps, self._stepping = 0, False
            self.paused = False
            self._changed.notify()

    def step(self) -> bool:
        """Send the next sample; False unless paused."""
        with self._changed:
            self._steps += self.paused
            self._changed.notify()
            return self.paused

    def seek(self, seconds: float) -> None:
        """Continue from another moment [s since the start of the bag].

        Raises:
            InputError: the bag has no such moment.
        """
        moment = self._moment(seconds)
        with self._changed:
            self._target = moment
            self._steps = 0
            self._changed.notify()

    def check(self, seconds: float) -> None:
        """Refuse a moment [s since the start of the bag] that the bag does not have.

        Raises:
            InputError: it has no such moment.
        """
        self._moment(seconds)

    def set_rate(self, rate: float) -> None:
        """Set how many times faster than real time the bag plays, from now on."""
        with self._changed:
            self._origin = (self._now(), time.monotonic_ns())
            self._rate = rate
            self._changed.notify()

    def _moment(self, seconds: float) -> int:
        length = (self._bag.end - self._bag.start) / NANOSECONDS
        if not 0.0 <= seconds <= length:
            raise InputError(f'the bag is {length:g} s long; it has no moment {seconds:g} s')
        return self._bag.start + round(seconds * NANOSECONDS)

    def _now(self) -> int:
        moment, when = self._origin
        if self.paused or self._options.fast:
            return moment
        return moment + round((time.monotonic_ns() - when) * self._rate)

    def _play(self, target: int) -> bool:
        """Play from a moment [ns] on; return whether to continue elsewhere."""
        self._origin = (target, time.monotonic_ns())
        self._next_tick = target
        self._stepping = False
        if target > self._bag.start:
            for message in self._bag.latched(self._topics, target):
                self._send(message.topic, message.data)
        messages = self._bag.messages(self._topics, target, self._last)
        for moment, group in itertools.groupby(messages, attrgetter('log_time')):
            together = list(group)
            begins = self._states in (None, *(message.topic for message in together))
            if not self._reach(moment, begins):
                return not self._stopped
            for message in together:
                if self._stopped:
                    return False
                self._send(message.topic, message.data)
                self.sent += 1
        return self._options.loop and not self._stopped

    def _reach(self, moment: int, begins: bool) -> bool:
        """Let time pass until messages are due; return whether they are still to be sent.

        Args:
            moment: Their log time [ns].
            begins: Whether a sample begins with them.
        """
        while self._tick_period and self._next_tick <= moment:
            if not self._wait(self._next_tick, begins, message=False):
                return False
            self._tick(self._next_tick)
            self._next_tick += self._tick_period
        return self._wait(moment, begins, message=True)

    def _wait(self, moment: int, begins: bool, message: bool) -> bool:
        """Wait for a moment, or a step, which jumps to it; False when play ends or jumps away."""
        with self._changed:
            while not self._stopped and self._target is None:
                steps = self._steps or (self._stepping and not begins)
                if steps or (self._options.fast and not self.paused):
                    self._origin = (moment, time.monotonic_ns())
                    if self._steps and begins and message:
                        self._steps -= 1
                        self._stepping = True
                    return True
                if self.paused:
                    seconds = self._tick_period / NANOSECONDS or None
                    if not self._changed.wait(seconds):
                        self._tick(self._origin[0])
                    continue
                left = (moment - self._now()) / self._rate / NANOSECONDS
                if left <= 0.0:
                    return True
                self._changed.wait(left)
            return False
