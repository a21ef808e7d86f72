"""Node that plays a bag."""

from __future__ import annotations

import argparse
import math
import sys
import threading
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from parallel_robot.bags.indexed_reader import BagReader, RecordedTopic
from parallel_robot.bags.player import Player, PlayerOptions
from parallel_robot_model.common.errors import InputError, ParallelRobotError, UnknownNameError
from parallel_robot_model.configuration import fields
from parallel_robot_model.messages import layouts, topics
from parallel_robot_model.nodes.connections import message_class
from parallel_robot_model.nodes.life_cycle import run_node
from parallel_robot_model.nodes.parameters import describe
from parallel_robot_model.nodes.suite_node import SuiteNode

WINDOW = 400  # messages of a topic that may be unanswered when playing fast
ASK_EVERY = 100  # messages between two looks for the answer
ANSWER = 0.01  # s, usually enough for the answer
FINAL_WAIT = 4.0  # s, for the receivers at the end; Fast DDS asks them every 3 s
CLOCK_RATE = 100.0  # Hz, of a bare --clock
CLOCK = '/clock'
SETTABLE = {  # parameters that can change while a bag is played
    'position': fields.Field('s', 'moment to go on from, since the start of the bag', 0.0),
    'rate': next(p.field for p in fields.parameters(PlayerOptions) if p.key == 'rate'),
}


class PlayerNode(SuiteNode):
    """Publishes what a bag holds, byte by byte, from a thread of its own."""

    makes_states = True
    example = 'runs/exact --rate 0.5 --ros-args -r __ns:=/left'

    def __init__(self, **options_by_name: Any) -> None:
        """Open the bag and begin.

        Args:
            options_by_name: See PlayerOptions.
        """
        options = fields.build(PlayerOptions, options_by_name, '--')
        super().__init__('player')
        self._bag = BagReader(Path(options.bag))
        self._fast = options.fast
        self._clock_message = layouts.clock()
        self._clock_publisher = (
            self.create_publisher(Clock, CLOCK, topics.DEPTH) if options.clock else None
        )
        self._publishers_of: dict[str, Publisher] = {}
        self._windows: dict[str, int] = {}
        for topic in self._chosen(options):
            self._offer(topic)
        self._unanswered: Counter[str] = Counter()
        self._player = Player(self._bag, self._publishers_of, options, self._send, self._tick)
        for name, answer in (
            ('pause', self._answer_pause),
            ('resume', self._answer_resume),
            ('step', self._answer_step),
        ):
            self.create_service(Trigger, f'~/{name}', answer)
        for key, value in (('position', options.start), ('rate', options.rate)):
            self.declare_parameter(key, value, describe(SETTABLE[key], value, read_only=False))
        self._playing = threading.Thread(target=self._play, name='player', daemon=True)
        count = sum(self._bag.counts[name] for name in self._publishers_of)
        self.get_logger().info(f'playing {options.bag}: {count} messages')

    def diagnose(self) -> dict[str, Any]:
        """Position and state of the playback."""
        return {
            'position [s]': f'{self._player.position:.3f}',
            'paused': self._player.paused,
            'messages sent': self._player.sent,
        }

    def begin(self) -> None:
        """Start playing."""
        self._playing.start()

    def close(self) -> None:
        """Stop playing."""
        self._player.stop()
        if self._playing.is_alive():
            self._playing.join()
        self._bag.close()

    def _chosen(self, options: PlayerOptions) -> list[RecordedTopic]:
        known = self._bag.topics
        names = ['/' + name.lstrip('/') for name in options.topics] or list(known)
        for name in names:
            if name not in known:
                raise UnknownNameError('topic', name, known)
        return [known[name] for name in names if self._clock_publisher is None or name != CLOCK]

    def _offer(self, topic: RecordedTopic) -> None:
        try:
            kind = message_class(topic.type)
        except InputError as error:
            self.get_logger().warning(f'{topic.name} is left out: {error}')
            return
        self._windows[topic.name] = topic.latched or WINDOW
        qos = QoSProfile(depth=topic.latched or (WINDOW if self._fast else topics.DEPTH))
        if topic.latched or self._fast:  # Fast DDS asks for answers at once if its history is full
            qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
        self._publishers_of[topic.name] = self.create_publisher(kind, topic.name, qos)

    def _play(self) -> None:
        try:
            self._player.run()
            for publisher in self._publishers_of.values():
                self._answered_by_all(publisher, FINAL_WAIT)
        except ParallelRobotError as error:
            self.fail(error)
        self.finish()

    def _send(self, name: str, data: bytes) -> None:
        publisher = self._publishers_of[name]
        publisher.publish(data)
        if self._fast:
            self._unanswered[name] += 1
            full = self._unanswered[name] >= self._windows[name]
            ask = full or self._unanswered[name] % ASK_EVERY == 0
            if ask and self._answered_by_all(publisher, math.inf if full else ANSWER):
                self._unanswered[name] = 0

    def _answered_by_all(self, publisher: Publisher, seconds: float) -> bool:
        """Wait for a time until the reliable receivers have all that was sent."""
        while seconds > 0.0 and not self._player.stopped:
            if publisher.wait_for_all_acked(Duration(seconds=ANSWER)):
                return True
            seconds -= ANSWER
        return False

    def _tick(self, stamp: int) -> None:
        if self._clock_publisher is not None:
            self._clock_publisher.publish(self._clock_message.encode(stamp))

    def _answer_pause(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._player.pause()
        return self._answered(response)

    def _answer_resume(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._player.resume()
        return self._answered(response)

    def _answer_step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return self._answered(response, self._player.step())

    def _answered(self, response: Trigger.Response, success: bool = True) -> Trigger.Response:
        how = 'paused' if self._player.paused else 'playing'
        response.success = success
        response.message = f'{how} at {self._player.position:.3f} s'
        return response

    def is_settable(self, key: str) -> bool:
        """Whether a parameter can change while the node runs: position and rate."""
        return super().is_settable(key) or key in SETTABLE

    def prepare_change(self, changes: dict[str, Any]) -> tuple[dict[str, Any], Callable[[], None]]:
        """Seek and set the rate; all other parameters are fixed."""
        if not changes.keys() <= SETTABLE.keys():
            return super().prepare_change(changes)
        values = {
            key: fields.check(key, float, SETTABLE[key], value) for key, value in changes.items()
        }
        if 'rate' in values and self._fast:
            raise InputError('a player with --fast keeps no time; it has no rate')
        if 'position' in values:
            self._player.check(values['position'])

        def apply() -> None:
            if 'rate' in values:
                self._player.set_rate(values['rate'])
            if 'position' in values:
                self._player.seek(values['position'])

        return values, apply


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the player's command line."""
    parser.add_argument('bag', metavar='BAG', help='directory of the bag, or its MCAP file')
    for parameter in fields.parameters(PlayerOptions):
        key, field = parameter.key, parameter.field
        if key == 'bag':
            continue
        text = field.description + (f' [{field.unit}]' if field.unit else '')
        more: dict[str, Any] = {'action': 'store_true'}
        if parameter.type is float:
            more = {'type': float, 'metavar': 'X'}
        elif parameter.type is not bool:
            more = {'nargs': '+', 'metavar': 'TOPIC'}
        if key == 'clock':
            more |= {'nargs': '?', 'const': CLOCK_RATE}
        default = PlayerOptions._field_defaults[key]
        parser.add_argument(f'--{key}', default=default, help=text, **more)


def main() -> int:
    """Run the node."""
    return run_node(PlayerNode, add_arguments)


if __name__ == '__main__':
    sys.exit(main())
