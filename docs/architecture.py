"""Draws the packages of docs/architecture.md, and the rooms of two, from their imports."""

import ast
import graphlib
import html
import sys
from pathlib import Path

import grimp

ROOT = Path(__file__).parents[1]
ROOMS, INSIDE = ('parallel_robot', 'parallel_robot_model'), '*/__init__.py'
LEFT, WIDE, HIGH, ROW, SIZE = 110, 280, 26, 42, 990  # px
STYLE = """<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7"
markerHeight="7" orient="auto"><path class="tip" d="M0 0L8 4L0 8z"/></marker></defs>
<style>
rect{fill:#eceff1;stroke:#607d8b}
path{fill:none;stroke:#78909c;stroke-width:1.4;marker-end:url(#tip)}
.tip{fill:#78909c;stroke:none;marker-end:none}
text{font:13px sans-serif;fill:#607d8b}
.name{font-weight:600;fill:#263238;text-anchor:middle}
</style>"""


def edges() -> dict[str, set[str]]:
    """What each package imports, without what it also reaches through another one."""
    roots = sorted(path.parent.name for path in ROOT.glob('*/__init__.py'))
    rooms = (
        path.parent.relative_to(ROOT) for root in ROOMS for path in (ROOT / root).glob(INSIDE)
    )
    packages = sorted([*{*roots} - {*ROOMS}, *('.'.join(room.parts) for room in rooms)])
    graph = grimp.build_graph(*roots)
    imports: dict[str, set[str]] = {package: set() for package in packages}
    for module in graph.modules:
        others = graph.find_modules_directly_imported_by(module)
        package, *found = (package_of(name, packages) for name in (module, *others))
        if package:
            imports[package] |= {*found} - {package, ''}
    reached: dict[str, set[str]] = {}
    for package in sorted(packages, key=lambda name: len(imports[name])):
        reached[package] = set()
        pending = set(imports[package])
        while pending:
            one = pending.pop()
            pending |= imports[one] - reached[package]
            reached[package] |= imports[one]
    return {package: imports[package] - reached[package] for package in packages}


def package_of(module: str, packages: list[str]) -> str:
    """The package that has a module; empty for one beside the rooms."""
    found = (name for name in packages if f'{module}.'.startswith(f'{name}.'))
    return next(found, '')


def purpose(package: str) -> str:
    """The first sentence of its docstring, for SVG."""
    tree = ast.parse((ROOT / package.replace('.', '/') / '__init__.py').read_text())
    first = (ast.get_docstring(tree) or '').split('\n')[0].split('. ')[0].rstrip('.')
    return html.escape(first.replace('`', ''))


def picture() -> str:
    """The packages as SVG: one under the other, those that import above what they import."""
    imports = edges()
    below = {package: sorted(others) for package, others in imports.items()}
    house = [*graphlib.TopologicalSorter(below).static_order()][::-1]
    top = {package: 10 + ROW * k for k, package in enumerate(house)}
    parts = []
    for package in house:
        y = top[package]
        parts += [
            f'<rect x="{LEFT}" y="{y}" width="{WIDE}" height="{HIGH}" rx="4"/>',
            f'<text class="name" x="{LEFT + WIDE / 2:g}" y="{y + 18}">{package}</text>',
            f'<text x="{LEFT + WIDE + 14}" y="{y + 18}">{purpose(package)}</text>',
        ]
        for other in below[package]:
            rows, x, end = (top[other] - y) // ROW, LEFT + WIDE / 2, top[other]
            path = f'M{x:g} {y + HIGH}V{end - 2}'
            if rows > 1:  # around those between
                start, end, bend = y + 18, end + 9, LEFT - min(20 * rows, LEFT)
                path = f'M{LEFT} {start}C{bend} {start} {bend} {end} {LEFT - 2} {end}'
            parts.append(f'<path d="{path}"/>')
    size = f'width="{SIZE}" height="{10 + ROW * len(house)}"'
    begin = f'<svg xmlns="http://www.w3.org/2000/svg" {size}>'
    return '\n'.join([begin, STYLE, *parts, '</svg>', ''])


if __name__ == '__main__':
    Path(sys.argv[1]).write_text(picture())
