"""Text of a bag cannot leave its line."""

import io
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from parallel_robot_bags import progress
from parallel_robot_bags.printable_output import LONGEST_LINE, printable_output
from parallel_robot_base.printable import printable


@given(st.text() | st.lists(st.text()) | st.floats())
def test_what_is_shown_is_one_line_that_can_be_encoded(value):
    shown = printable(value, 20)
    assert shown.isprintable() and len(shown) <= 20
    shown.encode()


@pytest.mark.parametrize(
    ('value', 'shown'), [(0.9, '0.9'), ([1, 'é'], "[1, 'é']"), ('a\nb', 'a�b')]
)
def test_plain_values_stay(value, shown):
    assert printable(value) == shown


def test_what_commands_print_has_no_escape_sequences(capsys):
    with printable_output():
        print('a\x1b[2J\rb\n\ttwo lines')
        print('é' * (LONGEST_LINE + 1), file=sys.stderr)
    out, err = capsys.readouterr()
    assert out == 'a\ufffd[2J\ufffdb\n\ufffdtwo lines\n'
    assert err == 'é' * (LONGEST_LINE - 1) + '…\n'


def test_progress_still_draws_on_the_terminal(monkeypatch):
    terminal = io.StringIO()
    terminal.isatty = lambda: True
    monkeypatch.setattr(sys, 'stderr', terminal)
    monkeypatch.setattr(progress, 'QUIET', 0.0)
    with printable_output():
        assert list(progress.tracked('ab', 2, 'letters')) == ['a', 'b']
    assert terminal.getvalue().startswith(progress.CLEAR)
