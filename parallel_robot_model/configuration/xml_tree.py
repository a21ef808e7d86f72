"""XML of strangers: read with limits into elements that know their place, and written."""

from __future__ import annotations

import re
from typing import Any
from xml.etree.ElementTree import Element
from xml.parsers import expat
from xml.sax.saxutils import escape, quoteattr

from parallel_robot_model.common.errors import InputError, printable

COMMENT, DECLARATION = re.compile(b'<!--.*?-->', re.DOTALL), b'<?xml'
DEEPEST = 200  # elements in one another
MOST = 100_000  # elements in all
MERGED = 'merged'  # the mark of a text whose lines are not those of one file


class Node(Element):
    """An element of XML.

    Attributes:
        line: The line on which it begins.
        place: Its file, and the line if that is the one in the file.
    """

    line = 0
    place = ''


def parse(content: bytes | str, source: str) -> Node:
    """Read XML without entities.

    Args:
        content: Text, or bytes in the encoding that they declare.
        source: What the text is called in messages.

    Returns:
        The outermost element.

    Raises:
        InputError: it is no XML, declares a document type or entities, is too deep or too long.
    """
    content = _forgiven(content)
    parser = expat.ParserCreate()
    building = _Building(source, parser)
    parser.StartElementHandler = building.start
    parser.EndElementHandler = building.end
    parser.CharacterDataHandler = building.text
    parser.StartDoctypeDeclHandler = building.refuse_doctype
    parser.ProcessingInstructionHandler = building.instruction
    parser.buffer_text = True
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        raise InputError(f'{source}, line {error.lineno}: not valid XML: {reason}') from None
    except (LookupError, ValueError) as error:  # of the encoding
        raise InputError(f'{source}: not valid XML: {printable(error)}') from None
    assert building.root is not None  # expat refuses a text without elements
    return building.root


def write(root: Node, merged: bool = False) -> str:
    """A tree as XML whose elements begin on the lines where they were read.

    Args:
        root: The outermost element.
        merged: Whether the elements come from several files; then lines mean nothing.
    """
    parts: list[str] = [f'<?{MERGED}?>'] if merged else []
    _write(root, parts, 1)
    return ''.join(parts) + '\n'


def children(node: Element, tag: str = '') -> list[Node]:
    """The elements in an element, those of one kind if it is given."""
    return [child for child in node if isinstance(child, Node) and child.tag == (tag or child.tag)]


def describe(node: Node) -> str:
    """An element as a message calls it: by its kind and name."""
    name = node.get('name')
    return f'{node.tag} {printable(name)!r}' if name else f'<{printable(node.tag)}>'


def refused(node: Node, reason: str) -> InputError:
    """The error that says what is wrong with an element, and where it stands."""
    return InputError(f'{node.place}: {describe(node)} {reason}')


def _forgiven(content: bytes | str) -> bytes | str:
    """A text without what XML forbids and most readers of robots take: -- in comments, ..."""
    if isinstance(content, str):
        return content
    content = COMMENT.sub(lambda found: b'\n' * found[0].count(b'\n'), content)
    start = content.lstrip()
    if len(start) < len(content) and start.startswith(DECLARATION):  # ... and lines before <?xml
        content = content.replace(DECLARATION, b'<?late', 1)
    return content


class _Building:
    """A tree that grows with what the parser finds."""

    def __init__(self, source: str, parser: Any) -> None:
        self.root: Node | None = None
        self._source, self._parser, self._merged = source, parser, False
        self._open: list[Node] = []
        self._count = 0

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        node = Node(tag, attributes)
        node.line = self._parser.CurrentLineNumber
        node.place = self._source if self._merged else self._place()
        self._count += 1
        if len(self._open) == DEEPEST:
            raise InputError(f'{node.place}: more than {DEEPEST} elements in one another')
        if self._count > MOST:
            raise InputError(f'{node.place}: more than {MOST} elements')
        if self._open:
            self._open[-1].append(node)
        else:
            self.root = node
        self._open.append(node)

    def end(self, _: str) -> None:
        self._open.pop()

    def text(self, text: str) -> None:
        node = self._open[-1]
        node.text = (node.text or '') + text if text.strip() else node.text

    def refuse_doctype(self, *_: Any) -> None:
        raise InputError(f'{self._place()}: a robot needs no DOCTYPE and no entities')

    def instruction(self, target: str, _: str) -> None:
        self._merged = self._merged or target == MERGED

    def _place(self) -> str:
        return f'{self._source}, line {self._parser.CurrentLineNumber}'


def _write(node: Node, parts: list[str], line: int) -> int:
    """Append an element; return the line on which it ends."""
    if node.line > line:
        parts.append('\n' * (node.line - line))
        line = node.line
    parts.append(f'<{node.tag}')
    parts += (f' {name}={quoteattr(value)}' for name, value in node.items())
    text = (node.text or '').strip()
    if not text and not len(node):
        parts.append('/>')
        return line
    parts.append(f'>{escape(text)}')
    line += text.count('\n')
    for child in children(node):
        line = _write(child, parts, line)
    parts.append(f'</{node.tag}>')
    return line
