"""YAML files of users become flat keys with plain values, or one line that says why not."""

import os

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from test_plain_data import LARGEST

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import plain_data, yaml_file

TEXTS = st.text(st.characters(codec='utf-8', exclude_categories=['C', 'Zl', 'Zp']), max_size=12)
NUMBERS = st.integers(-(2**63), 2**63) | st.floats(allow_nan=False, allow_infinity=False)
SCALARS = st.booleans() | NUMBERS | TEXTS | st.sampled_from(['1e6', 'off', '2026-01-01', '~'])


@pytest.fixture
def file(tmp_path):
    return tmp_path / 'some.yaml'


def refused(file):
    with pytest.raises(InputError) as caught:
        yaml_file.read(file)
    text = str(caught.value)
    assert str(file) in text and '\n' not in text and len(text) < len(str(file)) + 300
    return text


def test_groups_become_dotted_keys(file):
    file.write_text('\ufeffcircle:\n  radius: 0.1\n  deep: {er: [1, 2.5]}\nline.phi: 1\nout: ""\n')
    found = {'circle.radius': 0.1, 'circle.deep.er': [1, 2.5], 'line.phi': 1, 'out': ''}
    assert yaml_file.read(file) == found


@pytest.mark.parametrize(
    ('text', 'value'),
    [
        ('1e6', 1e6), ('-2E-3', -2e-3), ('.5e1', 5.0), ('3.e+2', 300.0), ("'1e6'", '1e6'),
        ('yes', True), ('off', False), ('e6', 'e6'), ('[1e-5, 1]', [1e-5, 1]), ('', None),
    ],
)  # fmt: skip
def test_numbers_are_those_that_people_mean(file, text, value):
    file.write_text(f'key: {text}\n')
    found = yaml_file.read(file)['key']
    assert found == value and type(found) is type(value)


@given(SCALARS | st.lists(SCALARS, max_size=4))
def test_a_value_is_read_as_it_was_written(tmp_path_factory, value):
    file = tmp_path_factory.getbasetemp() / 'written.yaml'
    text = yaml_file.text_of(value)
    assert '\n' not in text
    file.write_text(f'key: {text}  # comment\n')
    assert yaml_file.read(file) == {'key': value}


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('a: [', 'line 2: not valid YAML: '),
        ('a: 1\n b: 2\n', 'line 2: not valid YAML: '),
        ('', 'must hold keys and values'),
        ('- 1\n', 'must hold keys and values'),
        ('circle', 'must hold keys and values'),
        ('a: 1\n---\nb: 2\n', 'expected a single document'),
        ('a: 1\nb: 2\na: 3\n', 'line 3: a stands twice'),
        ('c:\n  r: 1\nc:\n  s: 2\n', 'line 3: c stands twice'),
        ('c.r: 1\nc:\n  r: 2\n', 'line 3: c.r stands twice'),
        ('on: 1\n', 'line 1: the key on is not a text for YAML; quote it'),
        ('c:\n  1: 2\n', 'line 2: the key 1 is not a text'),
        ('2026-01-01: 1\n', 'the key 2026-01-01 is not a text'),
        ('? [a]\n: 1\n', 'the key'),
        ('~: 1\n', 'the key ~ is not a text'),
        ('a: 2026-01-01\n', 'a cannot be 2026-01-01: YAML reads a date there'),
        ('a: [1, 2026-01-01]\n', 'a cannot be a list: YAML reads a date there'),
        ('a: [[1], [2]]\n', 'a cannot be a list: YAML reads a list there'),
        ('a: [{b: 1}]\n', 'a cannot be a list: YAML reads a dict there'),
        ('a: 2026-13-45\n', 'has what a configuration cannot'),
        ('a: !!binary aGk=\n', 'YAML reads a bytes there'),
        ('a: !!python/object/apply:os.system [x]\n', 'not valid YAML'),
        ('a: &x 1\n<<: {b: 1}\n', 'a merge key'),
        ('a: &x [*x]\n', ''),
        ('a: ' + '1' * 5000, 'has what a configuration cannot'),
        ('a: \x00', 'not valid YAML'),
        *((text, '') for text in LARGEST.values()),
    ],
    ids=lambda text: text[:20],
)
def test_what_is_wrong_is_said_in_one_line(file, text, reason):
    file.write_text(text)
    assert reason in refused(file)


@pytest.mark.parametrize(
    ('content', 'reason'),
    [
        (b'a: \xff\xfe', 'is not a text in UTF-8'),
        ('a: 1'.encode('utf-16'), 'is not a text in UTF-8'),
        (b'\x7fELF\x00\x01', 'not valid YAML'),
        (b'#' * (plain_data.MAX_LENGTH + 1), 'has more than 1048576 bytes'),
    ],
)
def test_what_is_no_text_is_refused(file, content, reason):
    file.write_bytes(content)
    assert reason in refused(file)


def test_what_is_no_file_is_refused(tmp_path, file):
    assert 'does not exist' in refused(file)
    assert 'is not a file' in refused(tmp_path)
    os.mkfifo(file)
    assert 'is not a file' in refused(file)  # and is not waited for
    assert 'cannot be read' in refused(tmp_path / ('x' * 300))
    file.with_name('loop').symlink_to('loop')
    refused(file.with_name('loop'))
    if os.getuid():
        secret = tmp_path / 'secret.yaml'
        secret.write_text('a: 1')
        secret.chmod(0)
        assert 'cannot be read: Permission denied' in refused(secret)


def test_the_resolver_of_others_is_as_it_was():
    assert yaml.safe_load('1e6') == '1e6'
