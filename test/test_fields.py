"""Parameters are converted or refused one by one, with a line that names the key."""

import math
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from parallel_robot_model.common.errors import InputError, UnknownNameError
from parallel_robot_model.configuration.fields import Field, build, defaults, parameters


class Sample(NamedTuple):
    """One field of every kind."""

    speed: Annotated[float, Field('m/s', 'a number', 0.0, 2.0)] = 1.0
    count: Annotated[int, Field('', 'a whole number', 1)] = 3
    name: Annotated[str, Field('', 'a text')] = 'a'
    loud: Annotated[bool, Field('', 'a switch')] = True
    point: Annotated[tuple[float, float], Field('m', 'a pair', high=9.0)] = (1.0, 2.0)
    names: Annotated[tuple[str, ...], Field('', 'some texts')] = ('a', 'b')
    mode: Annotated[Literal['fast', 'slow'], Field('', 'a choice')] = 'fast'
    lambda_: Annotated[float, Field('1/s', 'a Python keyword')] = 0.5
    delay: Annotated[float | Literal['none', 'auto'], Field('s', 'a number or a word', 0.0)] = 0.0


GOOD = {p.key: value for p, value in zip(parameters(Sample), Sample(), strict=True)}


def test_plain_values_from_yaml_become_the_group():
    values = {**GOOD, 'point': [1, 2.0], 'names': ['a', 'b']}
    assert build(Sample, values) == Sample()


def test_an_underscore_against_a_keyword_is_not_in_the_key():
    assert build(Sample, {**GOOD, 'lambda': 7.0}).lambda_ == 7.0


@given(st.integers(0, 2))
def test_integers_become_floats_where_floats_are_wanted(value):
    speed = build(Sample, {**GOOD, 'speed': value}).speed
    assert type(speed) is float and speed == value


@given(st.floats(0.0, 2.0))
def test_floats_in_range_pass_unchanged(value):
    assert build(Sample, {**GOOD, 'speed': value}).speed == value


def type_of(value):
    return tuple(map(type, value)) if isinstance(value, tuple) else type(value)


@pytest.mark.parametrize(
    ('key', 'value', 'expected'),
    [
        ('speed', np.float64(0.5), 0.5),
        ('speed', np.float32(0.5), 0.5),
        ('speed', np.longdouble(0.5), 0.5),
        ('speed', np.int8(1), 1.0),
        ('speed', np.array(0.5), 0.5),
        ('count', np.int64(7), 7),
        ('count', np.uint8(7), 7),
        ('name', np.str_('b'), 'b'),
        ('loud', np.bool_(False), False),
        ('mode', np.str_('slow'), 'slow'),
        ('point', np.array([1, 2]), (1.0, 2.0)),
        ('point', np.array([1.0, 2.0], np.longdouble), (1.0, 2.0)),
        ('point', [np.float64(1.0), np.int64(2)], (1.0, 2.0)),
        ('names', np.array(['c', 'd']), ('c', 'd')),
        ('names', [Path('c'), 'd'], ('c', 'd')),
    ],
)
def test_what_numpy_gives_is_as_good_as_what_python_has(key, value, expected):
    found = getattr(build(Sample, {**GOOD, key: value}), key)
    assert found == expected and type_of(found) == type_of(expected)


def test_defaults_of_numpy_are_plain():
    class Gains(NamedTuple):
        K: Annotated[float, Field('', 'a gain')] = np.float64(2.0)
        k: Annotated[tuple[float, ...], Field('', 'some')] = np.arange(2.0)

    found = defaults(Gains, 'mine.')
    assert found == {'mine.K': 2.0, 'mine.k': [0.0, 1.0]} and type(found['mine.K']) is float


@pytest.mark.parametrize(
    ('key', 'value', 'words'),
    [
        ('speed', math.nan, 'speed must be finite'),
        ('speed', math.inf, 'speed must be finite'),
        ('speed', -math.inf, 'speed must be finite'),
        ('speed', -0.001, 'speed must be from 0 to 2 m/s, not -0.001'),
        ('speed', math.nextafter(2.0, 3.0), 'speed must be from 0 to 2 m/s'),
        ('speed', '1.0', "speed must be a number, not '1.0'"),
        ('speed', True, 'speed must be a number, not True'),
        ('speed', None, 'speed must be a number, not None'),
        ('speed', [1.0], 'speed must be a number'),
        ('count', 1.0, 'count must be a whole number, not 1.0'),
        ('count', True, 'count must be a whole number, not True'),
        ('count', 0, 'count must be at least 1, not 0'),
        ('name', 1, 'name must be text, not 1'),
        ('loud', 1, 'loud must be true or false, not 1'),
        ('loud', 'yes', "loud must be true or false, not 'yes'"),
        ('point', [1.0], 'point must be a list of 2 numbers, not 1'),
        ('point', [1.0, 2.0, 3.0], 'point must be a list of 2 numbers, not 3'),
        ('point', 'ab', "point must be a list of 2 numbers, not 'ab'"),
        ('point', 1.0, 'point must be a list of 2 numbers, not 1.0'),
        ('point', [1.0, math.nan], r'point\[1\] must be finite'),
        ('point', [9.5, 1.0], r'point\[0\] must be at most 9 m'),
        ('point', [1.0, True], r'point\[1\] must be a number, not True'),
        ('names', 'abc', "names must be a list of texts, not 'abc'"),
        ('names', ['a', 1], r'names\[1\] must be text, not 1'),
        ('speed', np.float64('nan'), 'speed must be finite'),
        ('speed', np.bool_(True), 'speed must be a number, not True'),
        ('speed', np.ones(1), r'speed must be a number, not \[1.0\]'),
        ('speed', np.complex128(1), r'speed must be a number, not \(1\+0j\)'),
        ('count', np.float64(1.0), 'count must be a whole number, not 1.0'),
        ('loud', np.int64(1), 'loud must be true or false, not 1'),
        ('point', np.ones(3), 'point must be a list of 2 numbers, not 3'),
        ('delay', 'never', "delay must be a number or one of none, auto, not 'never'"),
        ('delay', True, 'delay must be a number or one of none, auto, not True'),
        ('delay', -1, 'delay must be at least 0 s, not -1'),
        ('point', np.ones((2, 2)), r'point\[0\] must be a number, not \[1.0, 1.0\]'),
    ],
)
def test_wrong_values_are_refused_by_name(key, value, words):
    with pytest.raises(InputError, match=words):
        build(Sample, {**GOOD, key: value})


@pytest.mark.parametrize(('value', 'meant'), [('auto', 'auto'), (2, 2.0), (0.5, 0.5)])
def test_a_word_can_stand_in_place_of_a_number(value, meant):
    assert build(Sample, {**GOOD, 'delay': value}).delay == meant


@pytest.mark.parametrize('key', ['speed', 'count'])
def test_an_integer_beyond_all_floats_is_refused(key):
    with pytest.raises(InputError, match=key):
        build(Sample, {**GOOD, key: 10**400})


def test_the_prefix_stands_in_the_message():
    with pytest.raises(InputError, match=r'sample\.speed must be finite'):
        build(Sample, {**GOOD, 'speed': math.nan}, 'sample.')


def test_an_unknown_choice_names_the_nearest():
    with pytest.raises(UnknownNameError, match="did you mean 'fast'") as caught:
        build(Sample, {**GOOD, 'mode': 'fats'})
    assert caught.value.choices == ['fast', 'slow']


def test_an_unknown_key_names_the_nearest():
    with pytest.raises(UnknownNameError, match=r"'s\.sped'; did you mean 's\.speed'"):
        build(Sample, {**GOOD, 'sped': 1.0}, 's.')


@pytest.mark.parametrize('key', GOOD)
def test_a_missing_key_is_named(key):
    values = {k: v for k, v in GOOD.items() if k != key}
    with pytest.raises(InputError, match=f'{key} is missing'):
        build(Sample, values)


def test_a_group_without_units_is_a_programming_error():
    class Bare(NamedTuple):
        x: float

    with pytest.raises(TypeError, match=r'Bare\.x'):
        parameters(Bare)
