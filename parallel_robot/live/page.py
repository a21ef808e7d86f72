"""The files of the page, held in memory; the drawing and the colours are those of the report."""

from __future__ import annotations

from importlib.resources import files as resources
from typing import NamedTuple

from parallel_robot.analysis.report.looks import STYLES

KINDS = {
    'html': 'text/html',
    'js': 'text/javascript',
    'css': 'text/css',
    'svg': 'image/svg+xml',
    '': 'text/plain',
}
PAGE, REPORT = 'parallel_robot.live', 'parallel_robot.analysis.report'
FILES = {
    '/': (PAGE, 'static/live.html'),
    '/live.css': (PAGE, 'static/live.css'),
    '/live.js': (PAGE, 'static/live.js'),
    '/stream.js': (PAGE, 'static/stream.js'),
    '/curves.js': (PAGE, 'static/curves.js'),
    '/controls.js': (PAGE, 'static/controls.js'),
    '/icon.svg': (PAGE, 'static/icon.svg'),
    '/uplot/uPlot.iife.min.js': (PAGE, 'static/uplot/uPlot.iife.min.js'),
    '/uplot/uPlot.min.css': (PAGE, 'static/uplot/uPlot.min.css'),
    '/uplot/LICENSE': (PAGE, 'static/uplot/LICENSE'),
    '/robot.js': (REPORT, 'templates/robot.js'),
    '/theme.css': (REPORT, 'templates/theme.css'),
}


class File(NamedTuple):
    """A file of the page."""

    content: bytes
    kind: str


def files() -> dict[str, File]:
    """All files by path."""
    found = {
        path: File(resources(package).joinpath(name).read_bytes(), _kind(name))
        for path, (package, name) in FILES.items()
    }
    themes = {':root': 'light', ":root[data-theme='dark']": 'dark'}
    rules = []
    for theme, shade in themes.items():
        colours = ' '.join(f'--{key}: {getattr(style, shade)};' for key, style in STYLES.items())
        rules.append(f'{theme} {{ {colours} }}')
    found['/colours.css'] = File('\n'.join(rules).encode(), 'text/css')
    return found


def _kind(name: str) -> str:
    return KINDS[name.rpartition('.')[2] if '.' in name else '']
