"""Output without the control characters of untrusted texts."""

from __future__ import annotations

import codecs
import contextlib
import io
import re
import sys
from collections.abc import Iterator
from typing import Any, TextIO

from parallel_robot_model.common.errors import printable

MAX_LINE_LENGTH = 2000  # characters of what a terminal gets
ASCII = re.compile(r'[ -~\n]*')
SPELLED, REPLACED = 'parallel_robot.spelled', {'µ': 'u'}  # a handler of codecs, what it spells


def without_mathematics(text: str) -> str:
    """The text as matplotlib draws it literally, dollar signs included."""
    return text.replace('$', r'\$')


class PrintableStream:
    """A stream that removes control characters from lines; everything else is delegated.

    Attributes:
        stream: Where the lines go.
    """

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        """Write lines."""
        if len(text) > MAX_LINE_LENGTH or ASCII.fullmatch(text) is None:
            text = '\n'.join(printable(line, MAX_LINE_LENGTH) for line in text.split('\n'))
        self.stream.write(text)
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


def spell(stream: TextIO) -> None:
    """Make a stream write what its encoding lacks in other letters, um for µm, or as ``?``."""
    if isinstance(stream, io.TextIOWrapper):
        stream.reconfigure(errors=SPELLED)


def _spelled(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    lacking = error.object[error.start : error.end]
    return ''.join(REPLACED.get(letter, '?') for letter in lacking), error.end


codecs.register_error(SPELLED, _spelled)


def as_it_is(stream: TextIO) -> TextIO:
    """The stream behind a PrintableStream, for escape sequences of our own."""
    return stream.stream if isinstance(stream, PrintableStream) else stream


@contextlib.contextmanager
def printable_output() -> Iterator[None]:
    """Keep escape sequences in untrusted names and texts off the terminal."""
    out, err = PrintableStream(sys.stdout), PrintableStream(sys.stderr)
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        yield
