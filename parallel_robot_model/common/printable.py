"""Values made fit to show: foreign text on one line, numbers that can be told apart."""

from __future__ import annotations

from typing import Any

MAX_LENGTH = 200  # characters


def printable(value: Any, longest: int = MAX_LENGTH) -> str:
    """Safe text of a value from a foreign source.

    Args:
        value: Any value.
        longest: Characters after which the text is cut off with an ellipsis.
    """
    text = clean(str(value)[: longest + 1])
    return text if len(text) <= longest else text[: longest - 1] + '…'


def clean(text: str) -> str:
    """A text without control characters, of any length."""
    return ''.join(c if c.isprintable() else '\N{REPLACEMENT CHARACTER}' for c in text)


def apart(value: float, limit: float, digits: int = 3) -> tuple[str, str]:
    """Two numbers with as many digits as it takes to see which is larger.

    Args:
        value: One number.
        limit: The other, shown with six digits where these are enough.
        digits: Least number of significant digits of the value.
    """
    if value != limit:
        for more in range(digits, 18):
            texts = f'{value:.{more}g}', f'{limit:.{max(more, 6)}g}'
            shown, bound = map(float, texts)
            if shown > bound if value > limit else shown < bound:
                return texts
    return f'{value:.{digits}g}', f'{limit:g}'
