"""Tables of Markdown and LaTeX read by something else than what wrote them."""

import re

from markdown_it import MarkdownIt

TOKENS = re.compile(
    r'\\(?P<escaped>[_%&#${}])|\\(?P<word>textbackslash|textasciitilde|textasciicircum|ldots)\{\}'
    r'|\$(?P<sign>\\mu|\\pm|\^\\circ|\^2|[-<>|])\$|(?P<group>\{[\[*]\})|(?P<nothing>\{\})'
    r'|(?P<plain>[^\\_%&#${}~^<>|])'
)
WORDS = {
    'textbackslash': '\\', 'textasciitilde': '~', 'textasciicircum': '^', 'ldots': '…',
    r'\mu': 'µ', r'\pm': '±', r'^\circ': '°', '^2': '²',
}  # fmt: skip
SPAN = re.compile(r'\\multicolumn\{(\d+)\}\{l\}\{(.*)\}')


def markdown_tables(text):
    """Tables of a text, each its sides and its rows of cells; by a reader of CommonMark."""
    found = []
    for token in MarkdownIt('gfm-like', {'linkify': False}).parse(text):
        if token.type == 'table_open':
            found.append([''])
        elif token.type == 'tr_open':
            found[-1].append([])
        elif token.type == 'th_open':
            found[-1][0] += token.attrs['style'].removeprefix('text-align:')[0]
        elif token.type == 'inline' and token.level == 4:
            kinds = {child.type for child in token.children}
            assert kinds <= {'text', 'text_special'}, kinds
            found[-1][-1].append(''.join(child.content for child in token.children))
    return found


def latex_tables(text):
    """Tables of a text, each its sides and its rows of cells; nothing but what is escaped."""
    found, inside = [], False
    for line in text.splitlines():
        begin = re.fullmatch(r'\\begin\{tabular\}\{([lr]+)\}', line)
        if begin:
            found.append([begin[1]])
            inside = True
        elif line == r'\end{tabular}':
            inside = False
        elif not inside:
            assert line.startswith('% '), line
        elif line != r'\hline':
            assert line.endswith(r' \\'), line
            cells = re.split(r'(?<!\\) & ', line[:-3])
            span = SPAN.fullmatch(cells[-1])
            width = len(cells) + (int(span[1]) - 1 if span else 0)
            assert width == len(found[-1][0]), line
            cells[-1] = span[2] if span else cells[-1]
            found[-1].append([_plain(cell) for cell in cells])
    assert not inside
    return found


def _plain(cell):
    """What LaTeX shows of a cell; refuses what has a meaning to it."""
    text, place = '', 0
    while place < len(cell):
        token = TOKENS.match(cell, place)
        assert token, cell[place:]
        group = token['group']
        text += (
            token['escaped']
            or token['plain']
            or (group and group[1])
            or WORDS.get(token['word'] or token['sign'], token['sign'] or '')
        )
        place = token.end()
    return text
