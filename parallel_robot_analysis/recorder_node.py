"""Node that records the suite's topics to a bag."""

from __future__ import annotations

import functools
import sys
import time
from pathlib import Path
from typing import Annotated, NamedTuple

from parallel_robot_analysis import bag_writer
from parallel_robot_analysis.recorder import Recorder
from parallel_robot_interface import config, topics
from parallel_robot_interface.fields import Field
from parallel_robot_interface.loop import WAIT
from parallel_robot_interface.ros_node import SuiteNode, run_node

CHECK = 0.05  # s, between two looks whether the motion is over


class RecorderParameters(NamedTuple):
    """Where the bag goes."""

    out: Annotated[str, Field('', "directory of the bag, must not exist; '': by date and time")]


class RecorderNode(SuiteNode):
    """Records from its start, or the common one, to the end of the motion or of the node."""

    def __init__(self) -> None:
        """Subscribe to everything; without a common start, begin at once."""
        super().__init__('recorder', {'recorder': RecorderParameters})
        out = config.group(self.values, RecorderParameters, 'recorder').out
        directory = Path(out or time.strftime('recording_%Y%m%d_%H%M%S'))
        bag_writer.check(directory)
        self._recorder = Recorder(directory, self.loop, self.values, self.fail)
        for topic in topics.RECORDED:
            self.subscribe(topic, functools.partial(self._recorder.take, topic))
        self.create_timer(CHECK, self._check)
        self._waiting = True
        if self.loop.start_stamp != WAIT:
            self._recorder.open(self.loop.start_stamp)
            self.get_logger().info(f'recording to {directory}')

    def missing(self) -> str:
        """What the recorder still waits for: topics that nobody publishes yet."""
        silent = [topic.name for topic in topics.RECORDED if not self.count_publishers(topic.name)]
        return f'no publisher of {", ".join(silent)}' if silent else ''

    def set_start(self, stamp: int) -> None:
        """Record from `stamp` [ns] on."""
        self._recorder.open(stamp)

    def close(self) -> None:
        """Complete the bag and report; an end before that of the motion is a failure."""
        ends = self.loop.samples is not None and self.loop.start_stamp == WAIT
        if ends and self.exit_code is None and not self._recorder.complete():
            self.get_logger().fatal('stopped before the end of the motion')
            self.finish(1)
        for line in self._recorder.close():
            self.get_logger().info(line)

    def _check(self) -> None:
        if self._waiting and not self.missing():
            self._waiting = False
            self.get_logger().info('ready: every topic has a publisher')
        if self._recorder.complete():
            self.finish()


def main() -> int:
    """Run the node."""
    return run_node(RecorderNode)


if __name__ == '__main__':
    sys.exit(main())
