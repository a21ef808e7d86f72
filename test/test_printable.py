"""Text of a bag cannot leave its line."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

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
