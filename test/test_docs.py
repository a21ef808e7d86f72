"""What the documentation shows exists, runs and does not drift."""

import importlib.util
import re
from pathlib import Path

import pytest
from assembly import simulated

from parallel_robot_control.configuration import resolve
from parallel_robot_control.laws import LAWS
from parallel_robot_control.safety import faults, limiting
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.fields import parameters
from parallel_robot_model.messages import layouts
from parallel_robot_model.nodes import joint_reader
from parallel_robot_model.nodes import parameters as services
from parallel_robot_model.robots import planar_3rrr

DOCS = Path(__file__).parents[1] / 'docs'


def script(name):
    """A script of the documentation as a module."""
    spec = importlib.util.spec_from_file_location(f'{name}_page', DOCS / f'{name}.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_page_of_parameters_is_the_one_that_the_code_writes():
    assert (DOCS / 'parameters.md').read_text() == script('parameters').text(), 'run make docs'


def test_the_packages_are_drawn_from_their_imports():
    drawn = (DOCS / 'images' / 'packages.svg').read_text()
    assert drawn == script('architecture').picture(), 'run make docs'


def test_every_key_has_its_row():
    text = (DOCS / 'parameters.md').read_text()
    before, _, gains = text.partition('## Laws\n')
    gains, _, after = gains.partition('\n## ')
    named = re.findall(r'^- (`.+?): ', before + after, re.MULTILINE)
    rows = re.findall(r'`([^`]+)`', ' '.join(named))
    for gain, laws in re.findall(r'^- `(\w+)`: (.+)$', gains, re.MULTILINE):
        rows += [f'{law}.{gain}' for law in re.findall(r'`(\w+)`', laws) if law in LAWS]
    keys = [k for k in config.resolve('paper_circle') if not k.startswith('true_robot.')]
    for prefix, group in script('parameters').DESCRIBED:  # of machines from a description
        keys += [f'{prefix}.{parameter.key}' for parameter in parameters(group)]
    assert sorted(rows) == sorted(keys)


@pytest.mark.parametrize('path', sorted(DOCS.glob('*.md')), ids=lambda path: path.name)
def test_links_lead_somewhere(path):
    for target in re.findall(r'\]\((?!http)([^)#]+)[^)]*\)', path.read_text()):
        assert (path.parent / target).exists(), target


def test_every_law_is_documented():
    text = (DOCS / 'laws.md').read_text()
    assert all(f'`{law}`' in text for law in LAWS)


def test_every_limit_is_in_the_table_of_safety():
    text = (DOCS / 'safety.md').read_text()
    table = text[text.index('| cause |') :]
    for parameter in parameters(limiting.SafetyParameters):
        where = text if parameter.key in ('action', 'damping', 'stiffness') else table
        assert parameter.key.replace('damping', 'damping').replace('stiffness', 'spring') in where
    assert len(table.splitlines()) >= len(faults.of(planar_3rrr))


def test_the_limits_of_the_wire_are_those_of_the_code():
    text = (DOCS / 'security.md').read_text()
    for limit in (
        f'{services.MAX_NAMES} names, {services.MAX_PREFIXES} prefixes',
        f'{services.MAX_NAME_LENGTH} characters of a name',
        f'{services.MAX_VALUE_LENGTH} characters or',
        f'looked at up to {joint_reader.MAX_MESSAGE_BYTES >> 10} KiB',
        f'layouts of {layouts.KINDS} kinds',
    ):
        assert limit in text


@pytest.mark.parametrize(
    ('name', 'lines', 'rival'),
    [('example_law', 30, 'computed_torque'), ('example_law_with_memory', 40, 'computed_torque')],
)
def test_an_example_law_is_short_and_tracks(name, lines, rival):
    file = DOCS / f'{name}.py'
    assert len(file.read_text().splitlines()) <= lines
    changed = {'custom_laws': [str(file)], 'duration': 4.0}

    def error(law):
        done = simulated(resolve('paper_circle', changed | {'law': law}))
        assert not done.run.fault.any() and not done.experiment.control.law.warnings
        return abs(done.reference.position - done.run.position)[2000:].max()

    assert error(name) < error(rival)
