"""Texts in bags become plain values or one error, whatever their structure."""

import json

import pytest
import yaml
from hypothesis import example, given
from hypothesis import strategies as st

from parallel_robot_model.configuration import config, plain_data

DEFAULTS = config.resolve('paper_circle')
NUMBERS = st.integers(-(2**63), 2**63) | st.floats(allow_nan=False, allow_infinity=False)
SCALARS = st.none() | st.booleans() | NUMBERS | st.text(max_size=20)
PLAIN = st.recursive(
    SCALARS, lambda part: st.lists(part, max_size=4) | st.dictionaries(st.text(max_size=9), part)
)
NOT_PLAIN = st.sampled_from(
    ['!!python/object/apply:os.system [x]', '!!binary aGk=', '2001-01-01', '!!set {a}', '.nan',
     '.inf', '&a [*a]', '1' * 5000, '{<<: {a: 1}}', '{!!merge x: {a: 1}}', '? [a]\n: b']
)  # fmt: skip
LARGEST = {
    'brackets': '[' * 100_000, 'braces': '{"a":' * 100_000, 'dashes': '- ' * 100_000,
    'long': '1' * (plain_data.MAX_LENGTH + 1), 'many': '- 1\n' * (plain_data.PARTS + 1),
    'laughs': 'a0: &a0 [x, x]\n' + '\n'.join(
        f'a{k}: &a{k} [{", ".join([f"*a{k - 1}"] * 9)}]' for k in range(1, 10)),
}  # fmt: skip


@given(st.dictionaries(st.text(max_size=9), PLAIN))
def test_what_is_written_comes_back(values):
    assert plain_data.load(plain_data.dump(values)) == values


@example({'scenario': {'<<': None}})  # quoted, it is a key like any other
@given(st.dictionaries(st.sampled_from([*DEFAULTS]), PLAIN))
def test_the_yaml_of_older_bags_comes_back(values):
    assert plain_data.load(yaml.safe_dump({**DEFAULTS, **values})) == {**DEFAULTS, **values}


@given(st.text(alphabet='[]{}:,-?&*!|>\'"%@`# \n\tax1', max_size=60))
def test_any_text_is_a_value_or_an_error(text):
    try:
        found = plain_data.load(text)
    except ValueError:
        return
    json.dumps(found, allow_nan=False)


@given(NOT_PLAIN, st.sampled_from(['{}', '- {}', 'a: {}', '[1, {}]']))
def test_what_is_not_plain_is_refused(text, around):
    with pytest.raises(ValueError, match=r'.'):
        plain_data.load(around.format(text.replace('\n', ' ')))


@pytest.mark.parametrize('name', LARGEST)
def test_what_is_too_deep_or_too_long_is_refused(name):
    with pytest.raises(ValueError, match=r'too|longer'):
        plain_data.load(LARGEST[name])


@pytest.mark.parametrize(
    ('text', 'number'),
    [('0', 0), ('12', 12), (str(2**63 - 1), 2**63 - 1), (str(2**63), None), ('-1', None),
     ('²', None), ('\u0661', None), ('9' * 5000, None), ('', None), ('-', None), (' 1', None),
     ('1_0', None), ('1.0', None), ('nan', None), ('--1', None)],
)  # fmt: skip
def test_whole_numbers(text, number):
    assert plain_data.whole_number(text) == number
