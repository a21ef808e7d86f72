"""Draws the packages of docs/architecture.md from their imports, as a Mermaid diagram."""

import sys
from pathlib import Path

import grimp

ROOT = Path(__file__).parents[1]
BEGIN, END = '```mermaid\n', '```\n'


def edges() -> dict[str, set[str]]:
    """What each package imports, without what it also reaches through another one."""
    packages = sorted(path.parent.name for path in ROOT.glob('*/__init__.py'))
    graph = grimp.build_graph(*packages)
    imports: dict[str, set[str]] = {package: set() for package in packages}
    for module in graph.modules:
        package = module.partition('.')[0]
        found = {
            other.partition('.')[0] for other in graph.find_modules_directly_imported_by(module)
        }
        imports[package] |= found - {package}
    reached: dict[str, set[str]] = {}
    for package in sorted(packages, key=lambda name: len(imports[name])):
        reached[package] = set()
        pending = set(imports[package])
        while pending:
            one = pending.pop()
            pending |= imports[one] - reached[package]
            reached[package] |= imports[one]
    return {package: imports[package] - reached[package] for package in packages}


def diagram() -> str:
    """The lines between the fences."""
    lines = [f'    {one} --> {other}' for one, others in edges().items() for other in others]
    drawn = '\n'.join(['graph TD', *sorted(lines)]) + '\n'
    return drawn.replace('parallel_robot_', '')


def text(page: str) -> str:
    """A page with its diagram drawn anew."""
    before, _, rest = page.partition(BEGIN)
    return before + BEGIN + diagram() + END + rest.partition(END)[2]


if __name__ == '__main__':
    path = Path(sys.argv[1])
    path.write_text(text(path.read_text()))
