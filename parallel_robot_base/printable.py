"""Foreign text made safe to show: one line, no control characters."""

from __future__ import annotations

from typing import Any

LONGEST = 200  # characters


def printable(value: Any, longest: int = LONGEST) -> str:
    """Safe text of a value from a foreign source.

    Args:
        value: Any value.
        longest: Characters after which the text is cut off with an ellipsis.
    """
    text = str(value)[: longest + 1]
    text = ''.join(c if c.isprintable() else '\N{REPLACEMENT CHARACTER}' for c in text)
    return text if len(text) <= longest else text[: longest - 1] + '…'
