"""README and docs promise only what exists."""

import itertools
import os
import re
import shlex
from pathlib import Path

import pytest
from PIL import Image

from parallel_robot.cli.command_line import build_parser
from parallel_robot.cli.shared import given
from parallel_robot.studies.least_errors import is_study
from parallel_robot_model.configuration import config, yaml_file
from parallel_robot_model.messages import topics

ROOT = Path(__file__).parents[1]
README = (ROOT / 'README.md').read_text()
PAGES = {path: path.read_text() for path in [ROOT / 'README.md', *(ROOT / 'docs').glob('*.md')]}
COMMANDS = sorted(
    {
        line.split('#')[0].strip()
        for text in PAGES.values()
        for block in re.findall(r'```bash\n(.*?)```', text, re.DOTALL)
        for line in block.replace('\\\n', ' ').splitlines()
    }
)
WRITES = (
    r'(?:--out|--foxglove|--json|--figure|--plot|recorder.out:=|cp -r \S+|>)'  # before a new name
)
LINKS = [
    (path, target)
    for path, text in PAGES.items()
    for target in re.findall(r'\]\((?!http)([^)#]+)', text)
]


@pytest.mark.parametrize('command', [c for c in COMMANDS if c.startswith('make')])
def test_make_targets_exist(command):
    target = command.split()[1]
    assert re.search(rf'^{target}:', (ROOT / 'Makefile').read_text(), re.MULTILINE)


def test_the_demo_is_one_run_which_tells_its_metrics_itself():
    makefile = (ROOT / 'Makefile').read_text()
    recipe = re.search(r'^demo:.*\n((?:\t.*\n)+)', makefile, re.MULTILINE).group(1)
    assert re.findall(r'bin/parallel_robot (\w+)', recipe.replace('$(BIN)', 'bin')) == ['run']


@pytest.mark.parametrize('command', [c for c in COMMANDS if 'bin/parallel_robot' in c])
def test_commands_of_the_command_line_parse_and_their_keys_resolve(command, monkeypatch):
    monkeypatch.chdir(ROOT)
    arguments = build_parser().parse_args(shlex.split(command.partition(' > ')[0])[1:])
    files = {str(file) for file in getattr(arguments, 'param_file', [])}
    if getattr(arguments, 'scenario', None) is None or not all(map(os.path.exists, files)):
        pages = '\n'.join(text for text in PAGES.values() if command in text)
        assert all(pages.count(file) > 1 for file in files)  # one of before, or one shown there
        return
    if getattr(arguments, 'row', None) is None and not is_study(arguments.scenario):
        config.resolve(arguments.scenario, given(arguments))


@pytest.mark.parametrize(
    'command', [c for c in COMMANDS if c.startswith('ros2 run parallel_robot ')]
)
def test_executables_exist_and_their_parameters_resolve(command, monkeypatch):
    monkeypatch.chdir(ROOT)
    words = shlex.split(command)
    if words[3] == 'parallel_robot':
        build_parser().parse_args(words[4:])
        return
    assert (ROOT / 'scripts' / words[3]).is_file()
    pairs = itertools.pairwise(words)
    words = [word.replace(':=', '=') for option, word in pairs if ':=' in word and option != '-r']
    changes = yaml_file.parse_assignments(words)
    config.resolve(changes.pop('scenario', 'paper_circle'), changes)


@pytest.mark.parametrize(('page', 'target'), LINKS)
def test_links_lead_somewhere(page, target):
    assert (page.parent / target).exists()


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_what_a_command_reads_was_made_before(page):
    made = set()
    for block in re.findall(r'```bash\n(.*?)```', PAGES[page], re.DOTALL):
        for line in block.splitlines():
            command = line.split(' #')[0]
            written = re.findall(rf'{WRITES} ?(runs/\w+)', command)
            read = set(re.findall(r'runs/\w+', command)) - set(written)
            assert read <= made, line
            made |= set(written)


def test_whoever_follows_two_pages_is_not_refused():
    """No two pages write to one place, unless by the same command, which goes on then."""
    made = {}
    for page, text in PAGES.items():
        for block in re.findall(r'```bash\n(.*?)```', text, re.DOTALL):
            for line in block.replace('\\\n', ' ').splitlines():
                command = ' '.join(line.split('#')[0].split())
                for place in re.findall(rf'{WRITES} ?(runs/[\w./]+)', command):
                    first = made.setdefault(place, (page, command))
                    continued = 'sweep' in command and first[1] == command
                    assert first[0] == page or continued, (place, page.name, first)


def test_the_readme_is_short_and_shows_the_robot_before_any_table():
    lines = README.splitlines()
    assert len(lines) <= 115
    first = ' '.join(lines[2:4])
    assert all(word in first for word in ('fairly', 'bit for bit', 'a real robot'))
    picture, table = README.index('](docs/images/'), README.index('\n|')
    assert picture < table
    (name,) = re.findall(r'!\[.*\]\((docs/.*\.gif)\)', README)
    assert (ROOT / name).stat().st_size < 600_000
    with Image.open(ROOT / name) as moving:
        assert moving.n_frames > 50


def test_every_page_is_reached_from_the_readme():
    assert {path.name for path in PAGES} - set(re.findall(r'[\w.]+\.md', README)) == {'README.md'}


def test_every_topic_is_in_the_table():
    table = (ROOT / 'docs' / 'nodes.md').read_text().replace('`, `/', '`, `controller/')
    for topic in (*topics.RECORDED, topics.MARKERS, topics.CLOCK):
        assert f'`{topic.name}`' in table
