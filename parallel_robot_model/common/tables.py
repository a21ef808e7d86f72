"""Tables, and lines of text between them, as plain text, Markdown or LaTeX.

Cells are texts that are written as they are: a number has the same digits in every format.
"""

from __future__ import annotations

import csv
import functools
import io
import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple, ParamSpec, TypeVar

from parallel_robot_model.common.errors import printable

GAP = '  '  # between two columns of text, and before a table below a line
MARKDOWN = str.maketrans(
    {character: f'\\{character}' for character in '\\`*_|'}
    | {'&': '&amp;', '<': '&lt;', '~': '&#126;', '$': '&#36;'}
)
LATEX = str.maketrans(
    {character: f'\\{character}' for character in '_%&#${}'}
    | {'\\': r'\textbackslash{}', '~': r'\textasciitilde{}', '^': r'\textasciicircum{}'}
    | {character: f'${character}$' for character in '<>|'}
    | {'µ': r'$\mu$', '°': r'$^\circ$', '²': '$^2$', '…': r'\ldots{}', '±': r'$\pm$'}
    | {'\N{REPLACEMENT CHARACTER}': '?'}
)


class Table(NamedTuple):
    """A table of texts."""

    head: Sequence[str]  # headings of the columns; a line break in one shows in text alone
    # the rows; the last cell of one that is shorter reaches over the columns left
    rows: Sequence[Sequence[str]]
    align: str = 'lr'  # 'l' or 'r' for each column; the last one is that of all others
    bare: bool = False  # whether it has no head in text
    widest: int = 80  # characters of a column of text; what is wider sticks out

    @property
    def sides(self) -> str:
        """'l' or 'r', one for each column."""
        return self.align[: len(self.head)].ljust(len(self.head), self.align[-1])


Part = Table | str  # a table, or a line


def text(parts: Iterable[Part]) -> str:
    """Lines and tables for a terminal; a table below a line is indented."""
    lines: list[str] = []
    for part in parts:
        if isinstance(part, str):
            lines.append(part)
        else:
            lines += [f'{GAP if lines else ""}{line}' for line in _aligned(part)]
    return '\n'.join(lines)


def markdown(parts: Iterable[Part]) -> str:
    """Lines as paragraphs, tables as those of GitHub."""
    return '\n\n'.join(
        re.sub(r'^(?=[-+=>#])', r'\\', _markdown(part))
        if isinstance(part, str)
        else _markdown_table(part)
        for part in parts
    )


def latex(parts: Iterable[Part]) -> str:
    """Lines as comments, tables as ``tabular``, which needs no package."""
    return '\n'.join(
        f'% {_one_line(part)}' if isinstance(part, str) else _latex_table(part) for part in parts
    )


FORMATS: dict[str, Callable[[Iterable[Part]], str]] = {
    'text': text,
    'markdown': markdown,
    'latex': latex,
}


def comma_separated(head: Sequence[Any], rows: Iterable[Sequence[Any]]) -> str:
    """Rows below their head as comma-separated values."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator='\n')
    writer.writerow(head)
    writer.writerows(rows)
    return stream.getvalue()


def _one_line(cell: str) -> str:
    """A text without line breaks and what cannot be printed."""
    return printable(' '.join(cell.split()), len(cell))


def _aligned(table: Table) -> list[str]:
    """A table as lines with columns of one width."""
    heads = [head.split('\n') for head in table.head]
    height = max(map(len, heads))
    above = [[*head, *[''] * (height - len(head))] for head in heads]
    top = [] if table.bare else [list(line) for line in zip(*above, strict=True)]
    rows = [*top, *([_one_line(cell) for cell in row] for row in table.rows)]
    whole = [row for row in rows if len(row) == len(heads)]
    widths = [
        min(table.widest, max((len(row[k]) for row in whole), default=0))
        for k in range(len(heads))
    ]
    lines = []
    for row in rows:
        cells = [
            cell.rjust(width) if side == 'r' else cell.ljust(width)
            for cell, width, side in zip(row, widths, table.sides, strict=False)
        ]
        if len(row) < len(heads):
            cells[-1] = row[-1]
        lines.append(GAP.join(cells).rstrip())
    return lines


def _markdown(cell: str) -> str:
    """A text that Markdown shows as it is."""
    return re.sub(r'\](?=[(\[:])', r'\\]', _one_line(cell).translate(MARKDOWN))


def _markdown_table(table: Table) -> str:
    count = len(table.head)
    rows = [[_markdown(cell) for cell in row] for row in (table.head, *table.rows)]
    rows = [[*row, *[''] * (count - len(row))] for row in rows]
    widths = [max(3, *(len(row[k]) for row in rows)) for k in range(count)]
    rule = [
        '-' * (width - 1) + ':' if side == 'r' else ':' + '-' * (width - 1)
        for width, side in zip(widths, table.sides, strict=True)
    ]
    lines = [
        [
            cell.rjust(width) if side == 'r' else cell.ljust(width)
            for cell, width, side in zip(row, widths, table.sides, strict=True)
        ]
        for row in (rows[0], rule, *rows[1:])
    ]
    return '\n'.join(f'| {" | ".join(line)} |' for line in lines)


def _latex(cell: str) -> str:
    """A text that LaTeX shows as it is, numbers with a minus sign."""
    found = _one_line(cell).translate(LATEX).replace('+-', r'$\pm$')
    found = re.sub(r'(?<![\w-])-(?=\.?\d)', '$-$', found)
    found = re.sub(r'-(?=-)', '-{}', found)  # else they are a dash
    return re.sub(r'^[\[*]', r'{\g<0>}', found)  # else it belongs to the end of the row before


def _latex_table(table: Table) -> str:
    count = len(table.head)
    lines = []
    for row in (table.head, *table.rows):
        cells = [_latex(cell) for cell in row]
        if len(cells) < count:
            cells[-1] = rf'\multicolumn{{{count - len(cells) + 1}}}{{l}}{{{cells[-1]}}}'
        lines.append(f'{" & ".join(cells)} \\\\')
    head, *rows = lines
    body = [r'\hline', head, r'\hline', *rows, r'\hline']
    return '\n'.join([rf'\begin{{tabular}}{{{table.sides}}}', *body, r'\end{tabular}'])


# Functions of results that Python and the command line share.

P = ParamSpec('P')
R = TypeVar('R')
S = TypeVar('S')


def returning(
    convert: Callable[[R], S], need: Callable[[], object] = lambda: None
) -> Callable[[Callable[P, R]], Callable[P, S]]:
    """Let a function return what `convert` makes of its result, after `need` has been called.

    The command line calls the function itself, ``raw``.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, S]:
        @functools.wraps(function)
        def converted(*words: P.args, **values: P.kwargs) -> S:
            need()
            return convert(function(*words, **values))

        converted.raw = function  # type: ignore[attr-defined]
        return converted

    return decorate


# A result that Python shows as the command line prints it.


class ShownResult:
    """A result of lines and tables, for a console, for notebooks and for the command line.

    One that has ``warnings``, one line each, shows them below.
    """

    @property
    def failed(self) -> bool:
        """Whether it is not as it should be: exit code 1."""
        return False

    def parts(self) -> list[Part]:
        """Its lines and tables."""
        raise NotImplementedError

    def as_data(self) -> Any:
        """The same as plain data."""
        raise NotImplementedError

    def file_lines(self) -> list[str]:
        """Lines on the files that were written."""
        return []

    def lines(self) -> list[str]:
        """The same as lines of text."""
        return text(self.parts()).split('\n')

    def _told(self) -> list[Part]:
        warnings = getattr(self, 'warnings', ())
        return [*self.parts(), *(f'warning: {text}' for text in warnings)]

    def __repr__(self) -> str:
        """What came of it, and warnings."""
        return text(self._told())

    def _repr_markdown_(self) -> str:
        """The same for a notebook."""
        return markdown(self._told())
