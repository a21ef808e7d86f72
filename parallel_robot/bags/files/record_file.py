"""A file that always ends with its last whole record, also when the disk becomes full."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path


class RecordFile:
    """A file for mcap's writer: each write reaches the operating system whole or not at all.

    Attributes:
        written_at: Time of the last write on the monotonic clock [s].
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open('xb', buffering=0)
        self._end = 0
        self.written_at = time.monotonic()

    @property
    def closed(self) -> bool:
        """Whether the file is closed."""
        return self._file.closed

    def write(self, data: bytes) -> int:
        """Append; at an error, take back what was written of `data` and close.

        Raises:
            OSError: the disk is full or gone.
        """
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
        except OSError:
            with self._file, contextlib.suppress(OSError):
                self._file.truncate(self._end)
            raise
        self._end += len(data)
        self.written_at = time.monotonic()
        return len(data)

    def tell(self) -> int:
        """Length of the file [bytes]."""
        return self._end

    def flush(self) -> None:
        """Do nothing: writes are not buffered."""

    def close(self) -> None:
        """Close the file."""
        self._file.close()
