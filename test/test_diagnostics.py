"""The diagnostics of a node: level, text and values of its message."""

from types import SimpleNamespace

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.time import Time

from parallel_robot_model.nodes import background
from parallel_robot_model.nodes.background import Usage, diagnostics_message

NODE = SimpleNamespace(
    get_name=lambda: 'plant',
    get_fully_qualified_name=lambda: '/left/plant',
    get_clock=lambda: SimpleNamespace(now=lambda: Time(seconds=7)),
)


@pytest.mark.parametrize(
    ('warnings', 'alarm', 'level', 'text'),
    [
        ((), '', DiagnosticStatus.OK, 'ok'),
        (('a', 'b'), '', DiagnosticStatus.WARN, 'a, b'),
        (('a', 'b'), 'it burns', DiagnosticStatus.ERROR, 'it burns'),
    ],
)
def test_the_level_is_that_of_the_worst(warnings, alarm, level, text):
    message = diagnostics_message(NODE, {'x': 1.5, 'a': 2, 'b': 3}, warnings, alarm)
    (status,) = message.status
    assert (status.level, status.message) == (level, text)
    assert (status.name, status.hardware_id) == ('plant: loop', '/left/plant')
    assert [(item.key, item.value) for item in status.values] == [
        ('x', '1.5'), ('a', '2'), ('b', '3')
    ]  # fmt: skip
    assert message.header.stamp.sec == 7


def test_rate_and_processor_are_those_since_the_last_call(monkeypatch):
    now = SimpleNamespace(monotonic=10.0, process_time=1.0)
    clock = SimpleNamespace(monotonic=lambda: now.monotonic, process_time=lambda: now.process_time)
    monkeypatch.setattr(background, 'time', clock)
    usage = Usage()
    now.monotonic, now.process_time = 12.0, 1.5
    assert usage.measure(2000) == {'rate [Hz]': '1000.0', 'processor [%]': '25.0'}
    now.monotonic = 13.0
    assert usage.measure(2100) == {'rate [Hz]': '100.0', 'processor [%]': '0.0'}
    now.monotonic = 14.0
    assert usage.measure(None) == {'processor [%]': '0.0'}
