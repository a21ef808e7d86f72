"""Names and values of a bag as text that is safe to show: one line, no control characters."""

from __future__ import annotations

from typing import Any

LONGEST = 200  # characters


def printable(value: Any, longest: int = LONGEST) -> str:
    """Text of a value that somebody else wrote.

    Args:
        value: Anything.
        longest: Characters after which the text is cut off with an ellipsis.
    """
    text = str(value)
    text = ''.join(c if c.isprintable() else '\N{REPLACEMENT CHARACTER}' for c in text)
    return text if len(text) <= longest else text[: longest - 1] + '…'


def without_mathematics(text: str) -> str:
    """The text as matplotlib draws it literally, dollar signs included."""
    return text.replace('$', r'\$')
