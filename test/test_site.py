"""The documentation as a site builds without a warning; its first results come out."""

import re
import shlex
from pathlib import Path

import pytest

from parallel_robot.cli.command_line import COMMANDS, main

pytestmark = pytest.mark.endurance
ROOT = Path(__file__).parents[1]
FIRST = (ROOT / 'docs' / 'first_results.md').read_text()


@pytest.fixture(scope='module')
def site(tmp_path_factory):
    """Build the site, strictly."""
    build = pytest.importorskip('mkdocs.commands.build').build
    load = pytest.importorskip('mkdocs.config').load_config
    place = tmp_path_factory.mktemp('site')
    build(load(str(ROOT / 'mkdocs.yml'), site_dir=str(place), strict=True))
    return place


def test_the_site_asks_no_other_host_for_anything(site):
    for page in site.glob('*.html'):
        loaded = re.findall(
            r'<(?:script|img|iframe|link)\b[^>]*(?:src|href)="([^"]+)"', page.read_text()
        )
        assert loaded
        assert [source for source in loaded if re.match('(https?:)?//', source)] == [], page.name


def test_every_command_and_every_docstring_is_there(site):
    commands, python = (site / f'{name}.html' for name in ('commands', 'reference'))
    assert set(COMMANDS) <= set(re.findall(r'<h2 id="([\w-]+)"', commands.read_text()))
    for name in ('simulate', 'metrics', 'ControlOutput', 'JointMotion'):
        assert re.search(rf'id="[\w.]+\.{name}"', python.read_text()), name


def test_the_first_results_come_out(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'docs').symlink_to(ROOT / 'docs')
    blocks = re.findall(r'```bash\n(.*?)```', FIRST, re.DOTALL)
    commands = [shlex.split(line) for line in ''.join(blocks).splitlines()]
    words = [line[1:] for line in commands if line[0] == '.venv/bin/parallel_robot']
    alone = [
        line for line in words if line[0] not in ('run', 'rerun')
    ]  # those are tested with ROS
    assert len(alone) > 6
    for line in alone:
        assert main(line) == 0, line
    text = capsys.readouterr().out
    assert 'end-effector error, rms 2.98' in text
    assert (tmp_path / 'runs/first_report/report.html').is_file()
