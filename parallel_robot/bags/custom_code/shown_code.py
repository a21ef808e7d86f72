"""Code from elsewhere as a terminal shows it: every character that Python compiles, and no other.

Each line has its number, so that no text of the code looks like one of the suite's. A long line
goes on in the next one. What a terminal would obey, hide or draw over its neighbours is spelled
as an escape, and how many these are is told, since the code may hold the same letters.
"""

from __future__ import annotations

import ast
import io
import re
import shutil
import tokenize
import unicodedata
import warnings
from collections.abc import Iterator

from parallel_robot_model.common.errors import BagError

NARROWEST = 40  # columns of a line
BLANK = '\u115f\u1160\u17b4\u17b5\u2800\U0001d159'  # printable by Unicode, yet nothing is drawn
WORD = re.compile(r'\w+')
ENDS = re.compile('\r\n|\r|\n')  # of lines, as Python reads them


def decoded(name: str, source: bytes) -> str:
    """The text of a source as Python reads it.

    Args:
        name: Of the file, for messages.
        source: Its bytes.

    Raises:
        BagError: it is not plain UTF-8, or no Python.
    """
    try:
        text = source.decode('utf-8-sig')
        lines = io.BytesIO(re.sub(rb'\r\n?', b'\n', source)).readline
        encoding = tokenize.detect_encoding(lines)[0]
        if encoding not in ('utf-8', 'utf-8-sig'):
            raise BagError(f'{name} declares the encoding {encoding}; code of a bag must be UTF-8')
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            same = ast.dump(ast.parse(source)) == ast.dump(ast.parse(text))
    except UnicodeDecodeError as error:
        raise BagError(f'{name} is not UTF-8: byte {error.start} begins no character') from None
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise BagError(f'{name} is no Python: {spelled(str(error), "utf-8")[0]}') from None
    if not same:
        raise BagError(f'{name} is read by Python as another text than its own')
    return text


def lines(text: str, encoding: str) -> Iterator[str]:
    """Lines for the terminal.

    Args:
        text: The code.
        encoding: Of the terminal.
    """
    width = max(shutil.get_terminal_size().columns - 8, NARROWEST)
    ends = [*ENDS.findall(text), '']
    escapes: list[str] = []
    for number, (line, end) in enumerate(zip(ENDS.split(text), ends, strict=True), 1):
        shown, count = spelled(line + (end if end == '\r' else ''), encoding)
        if count:
            escapes.append(str(number))
        pieces = [shown[i : i + width] for i in range(0, len(shown), width)]
        yield f'{number:5} | {pieces[0] if pieces else ""}'
        for piece in pieces[1:]:
            yield f'      + {piece}'
    if escapes:
        yield f'---- characters are spelled as escapes in the lines {", ".join(escapes)}'


def spelled(text: str, encoding: str) -> tuple[str, int]:
    """A text with escapes for what cannot be seen as it is, and how many these are."""
    if text.isascii() and text.isprintable():
        return text, 0
    strange = {
        place
        for word in WORD.finditer(text)
        if re.search('[A-Za-z]', word[0])
        for place in range(*word.span())
        if text[place].isalpha() and not unicodedata.name(text[place], '').startswith('LATIN ')
    }
    shown = [
        character
        if _is_plain(character, encoding) and place not in strange
        else _escape(character)
        for place, character in enumerate(text)
    ]
    return ''.join(shown), sum(map(len, shown)) - len(text)


def _is_plain(character: str, encoding: str) -> bool:
    """Whether a character is seen as what it is."""
    if character.isascii():
        return character.isprintable()
    try:
        character.encode(encoding)
    except UnicodeEncodeError:
        return False
    return (
        character.isprintable()
        and character not in BLANK
        and not unicodedata.category(character).startswith('M')
        and unicodedata.normalize('NFKC', character) == character
    )


def _escape(character: str) -> str:
    code = ord(character)
    known = {'\t': r'\t', '\r': r'\r', '\f': r'\f', '\0': r'\0'}.get(character)
    if known:
        return known
    return (
        f'\\x{code:02x}' if code < 256 else f'\\u{code:04x}' if code < 65536 else f'\\U{code:08x}'
    )
