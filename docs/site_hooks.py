"""Hooks of MkDocs: pages from outside docs/, pages generated from the code, links to sources."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

from parallel_robot import PLACES
from parallel_robot.cli.command_line import COMMANDS, module_of
from parallel_robot_model.common.options import Parser

ROOT = Path(__file__).parents[1]
OUTSIDE = {'README.md': 'index.md', 'CONTRIBUTING.md': '', 'CHANGELOG.md': ''}  # to its new name
CONTRACTS = {  # the public modules, and what each is for
    'parallel_robot_control.contract': 'What a control law must have',
    'parallel_robot_model.robots.contract': 'What a robot must have',
    'parallel_robot_model.compiler': 'What kernels are written with',
}
COLUMNS = '100'  # of the help of a command


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that are not in docs/."""
    for name, as_page in OUTSIDE.items():
        as_of_docs = re.sub(r'\]\((?!http|#|docs/)', '](../', (ROOT / name).read_text())
        text = as_of_docs.replace('](docs/', '](')
        files.append(File.generated(config, as_page or name, content=text))
    files.append(File.generated(config, 'commands.md', content=commands()))
    files.append(File.generated(config, 'reference.md', content=reference()))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Turn links to files that are not on the site into links to the sources, or into paths."""

    def replaced(link: re.Match[str]) -> str:
        text, target = link.groups()
        path = os.path.normpath(Path('docs', target.partition('#')[0]))
        if path in OUTSIDE:
            return f'[{text}]({OUTSIDE[path] or path})'
        if config.repo_url:
            return f'[{text}]({config.repo_url.rstrip("/")}/blob/main/{path})'
        return text if path in text else f'{text} (`{path}`)'

    return re.sub(r'\[([^\]]+)\]\((\.\./[^)]+)\)', replaced, markdown)


def commands() -> str:
    """The help of every command."""
    os.environ['COLUMNS'] = COLUMNS
    parts = ['# Commands\n\nWhat `parallel_robot COMMAND --help` says.']
    for name, purpose in COMMANDS.items():
        parser = Parser(prog=f'parallel_robot {name}', description=purpose)
        module_of(name).add_arguments(parser)
        parts.append(f'## {name}\n\n```text\n{parser.format_help().rstrip()}\n```')
    return '\n\n'.join(parts) + '\n'


def reference() -> str:
    """The docstrings of all that ``import parallel_robot`` offers, and of the contracts."""
    parts = [
        '# Python\n\nWritten from the docstrings. [From Python](python.md) shows how it is used.'
    ]
    parts += [f'## {name}\n\n::: {PLACES[name]}.{name}' for name in sorted(PLACES)]
    parts += [f'## {title}\n\n::: {module}' for module, title in CONTRACTS.items()]
    return '\n\n'.join(parts) + '\n'
