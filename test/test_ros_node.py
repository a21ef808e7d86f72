"""What all nodes share: the first line of a log."""

import subprocess
import sys

import pytest

LOOKS = """
import inspect, sys
import rclpy.logging
from parallel_robot_interface import ros_node

if sys.argv[1] == 'prepared':
    ros_node.prepare_to_log()
looks, look = [], inspect.getabsfile
inspect.getabsfile = lambda *given: looks.append(given) or look(*given)
rclpy.logging.get_logger('node').info('a line')
print(len(looks))
"""


@pytest.mark.parametrize(('before', 'least', 'most'), [('prepared', 0, 20), ('not', 100, 9999)])
def test_the_first_line_of_a_log_looks_at_no_module(before, least, most):
    """At 1 kHz there is no time for a thousand of them; the second case shows that they count."""
    words = [sys.executable, '-c', LOOKS, before]
    told = subprocess.run(words, capture_output=True, text=True, check=True)
    assert 'a line' in told.stderr
    assert least <= int(told.stdout) <= most
