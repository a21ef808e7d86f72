"""Tables as text, Markdown and LaTeX: read back by something else, they say the same."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from table_readers import latex_tables, markdown_tables

from parallel_robot_model.common import tables
from parallel_robot_model.common.tables import Table

HOSTILE = [
    'bag_of_2026', '100 % | sure', 'a & b', r'C:\new\|', '$x_1$ ^ ~y~ {z} #1', '*bold* `code`',
    '<b>', '[link](javascript:0)', '&lt;', '-1.50', '1e-05', '+- 0.2', '[-0.1, 0.2]', '--set',
    'two\nlines\tmore', 'a\x1b[31mred', '007', 'µm', '* star', '20200407_2', '', '**', 'x|',
]  # fmt: skip


def one_line(cell):
    """A cell as a table shows it."""
    return ''.join(c if c.isprintable() else '\ufffd' for c in ' '.join(cell.split()))


@pytest.mark.parametrize('form', ['markdown', 'latex'])
def test_hostile_cells_come_back(form):
    rows = [[cell, '1.50', cell] for cell in HOSTILE]
    found = Table(['name_%', 'value\n[µm]', 'a | b'], rows, 'lrl')
    read = {'markdown': markdown_tables, 'latex': latex_tables}[form]
    ((sides, head, *back),) = read(tables.FORMATS[form]([found]))
    assert sides == 'lrl' and head == ['name_%', 'value [µm]', 'a | b']
    wanted = [[one_line(cell), '1.50', one_line(cell)] for cell in HOSTILE]
    if form == 'latex':  # one sign for both
        wanted = [
            [cell.replace('+-', '±').replace('\ufffd', '?') for cell in row] for row in wanted
        ]
    assert back == wanted


@given(st.lists(st.lists(st.text(), min_size=2, max_size=2), max_size=3), st.text())
def test_whatever_the_cells_are_a_table_keeps_its_shape(rows, line):
    parts = [line, Table(['a', 'b'], rows), 'end']
    ((_, head, *back),) = markdown_tables(tables.markdown(parts))
    assert head == ['a', 'b'] and back == [[one_line(cell) for cell in row] for row in rows]
    assert len(tables.latex(parts).splitlines()) == len(rows) + 8
    assert tables.text(parts[1:]).count('\n') == len(rows) + 1


@pytest.mark.parametrize(
    'line', ['# head', '- item', '+ item', '> quote', '=', '---', '| a | b |']
)
def test_a_line_is_a_paragraph(line):
    from markdown_it import MarkdownIt

    parsed = MarkdownIt('gfm-like', {'linkify': False}).parse(tables.markdown([line, line]))
    assert [token.type for token in parsed] == ['paragraph_open', 'inline', 'paragraph_close'] * 2
    assert ''.join(child.content for child in parsed[1].children) == line


def test_a_row_of_latex_cannot_belong_to_the_end_of_the_row_before():
    found = tables.latex([Table(['a', 'b'], [['[0, 50]', '1'], ['*', '2']])])
    assert not re.search(r'(\\\\|\\hline)\s*[\[*]', found)
    assert '% 50 \\% {x}\n' not in found


def test_a_line_of_latex_is_a_comment():
    found = tables.latex(['50 % of\n\\input{x}', Table(['a'], [['b']])])
    assert found.splitlines()[:2] == ['% 50 % of \\input{x}', '\\begin{tabular}{l}']


def test_a_short_row_reaches_over_the_columns_left():
    found = [
        Table(['law', 'rms', 'max'], [['smc', '1.0', '2.0'], ['pid', 'no figures: too fast']])
    ]
    assert tables.text(found).splitlines() == [
        'law  rms  max',
        'smc  1.0  2.0',
        'pid  no figures: too fast',
    ]
    ((_, *rows),) = markdown_tables(tables.markdown(found))
    assert rows[-1] == ['pid', 'no figures: too fast', '']
    ((_, *rows),) = latex_tables(tables.latex(found))
    assert rows[-1] == ['pid', 'no figures: too fast']


def test_text_has_one_width_a_column_and_what_is_wide_sticks_out():
    left, wide = 9, 'w' * 10
    table = Table(['a\n[m]', 'b'], [[wide, '1'], ['x', '12']], 'lr', widest=left)
    found = tables.text(['title', table])
    assert found.splitlines() == [
        'title',
        f'  {"a":<{left}}   b',
        '  [m]',
        f'  {wide}   1',
        f'  {"x":<{left}}  12',
    ]
    assert tables.text([Table(['a'], [['1']], bare=True)]) == '1'
