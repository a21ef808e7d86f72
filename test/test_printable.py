"""Text of a bag cannot leave its line."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from parallel_robot_model.common.errors import distinct_texts, printable


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


@pytest.mark.parametrize(
    ('value', 'limit', 'texts'),
    [
        (10.0000004, 10.0, ('10.0000004', '10')),
        (12.3456, 10.0, ('12.3', '10')),
        (0.0999999, 0.1, ('0.0999999', '0.1')),
        (1.0, 1.00049, ('1', '1.00049')),
        (0.09222262, 0.09222261, ('0.092223', '0.0922226')),
        (0.09224, 0.0922226, ('0.09224', '0.0922226')),
        (10.0, 10.0, ('10', '10')),
        (float('inf'), 10.0, ('inf', '10')),
    ],
)
def test_a_value_and_its_limit_can_be_told_apart(value, limit, texts):
    assert distinct_texts(value, limit) == texts
