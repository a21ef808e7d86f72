"""What a bag certifies of the messages of a topic."""

import json

import pytest

from parallel_robot.bags.files.bag_files import Certificate, lost


def test_programs_read_numbers_and_people_a_sentence():
    assert json.loads(Certificate(7, 3).dump()) == {'written': 7, 'lost': 3}
    assert json.loads(Certificate(7, None).dump()) == {'written': 7, 'lost': None}
    assert str(Certificate(7, 3)) == 'written 7, lost 3'
    assert str(Certificate(7, None)) == 'written 7, lost unknown'


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        (Certificate(100, 12).dump(), 12),
        (Certificate(100, 0).dump(), 0),
        (Certificate(100, None).dump(), 0),
        *((text, 0) for text in ('', '[]', '{"lost": -3}', '{"lost": "many"}', '{"lost": [1]}',
                                 '{"lost": true}', 'written 100, lost 12', 'x' * 100)),
    ],
)  # fmt: skip
def test_losses_are_read(text, expected):
    assert lost(text) == expected and type(lost(text)) is int
