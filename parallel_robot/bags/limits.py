"""How much memory and time reading a bag may take, whatever the bag claims."""

from __future__ import annotations

from pathlib import Path

from parallel_robot_model.common.errors import BagError

MEMORY = 2 << 30  # bytes that a command may take for what is in bags
TRUSTED = 1 << 50  # the same, for a bag that this process has just had written
COPIES = 4  # copies of what is read that evaluation holds in memory
RATIO = 200  # bytes that one byte of a file may unpack to, where that is more than the memory
RECORDS = 250_000  # records of a small file; a larger one has at most one in RECORD bytes
RECORD = 16  # bytes; the index of a message alone has as many
DESCRIPTIONS = 20_000  # schemas, channels, attachments and metadata records of a file
DESCRIPTION = 1 << 20  # bytes of one of them
ATTACHMENT = 1 << 28  # bytes of an attachment
CHUNK_INDEX = 1 << 6  # bytes that the index of a chunk takes
CHUNK = 1 << 28  # bytes that a chunk unpacks to
MESSAGE = 1 << 16  # bytes of a message that is decoded; that of a hundred joints has five thousand
KINDS = 100  # kinds of messages that a topic may have: joints and their order
LENGTHS = 1000  # different lengths of the messages of a channel, among a few megabytes of them
CHANNELS = 1000  # channels that are read of a file
STATUSES = 10_000  # statuses of the controller, which it sends when something changes
SOURCE = 1 << 20  # bytes of the source of a law or robot
SOURCES = 100  # custom laws and robots
YAML = 4 << 20  # bytes of metadata.yaml
NAME = 200  # characters of the name of a joint, a law, a scenario or a node


def is_name(text: str) -> bool:
    """Whether a text of a bag can be the name of a joint, a law, a scenario or a node."""
    return text.isprintable() and len(text) <= NAME


class Allowance:
    """Budget for reading a file; each part is deducted before it is allocated.

    What a file unpacks to, and how many records that are, is bounded by the memory or the size of
    the file, whichever allows more.
    """

    def __init__(self, path: Path | str, size: int, memory: int = MEMORY) -> None:
        """Prepare.

        Args:
            path: The file or the bag, or what it is in words, for error messages.
            size: Its size on disk [bytes].
            memory: What may be held of it [bytes].
        """
        self._path = path
        self._memory = memory
        self._held = 0
        self._unpacked = max(memory, RATIO * size)
        self._records = max(RECORDS, size // RECORD)
        self._descriptions = DESCRIPTIONS

    @property
    def records(self) -> int:
        """How many records may still be walked."""
        return self._records

    def unpack(self, size: int) -> None:
        """Deduct bytes that will be unpacked.

        Raises:
            BagError: they are too many.
        """
        self._unpacked -= size
        if self._unpacked < 0:
            raise BagError(
                f'{self._path} unpacks to more than {RATIO} times its size and more than '
                f'{gigabytes(self._memory)}'
            )

    def walk(self, records: int) -> None:
        """Deduct records that will be walked.

        Raises:
            BagError: they are more than a file of this size holds.
        """
        self._records -= records
        if self._records < 0:
            raise BagError(f'{self._path} holds far more records than a file of its size would')

    def describe(self, records: int = 1) -> None:
        """Deduct schemas, channels, attachments and metadata records.

        Raises:
            BagError: they are too many.
        """
        self._descriptions -= records
        if self._descriptions < 0:
            raise BagError(
                f'{self._path} holds more than {DESCRIPTIONS} schemas, channels, attachments '
                'and metadata records'
            )

    def hold(self, size: int) -> None:
        """Deduct bytes that will be kept.

        Raises:
            BagError: they are more than the memory allows.
        """
        self._held += size
        if COPIES * self._held > self._memory:
            raise BagError(f'{self._path} takes more than {gigabytes(self._memory)} of memory')


def gigabytes(size: int) -> str:
    """A number of bytes in words."""
    return f'{size / (1 << 30):.3g} GB'
