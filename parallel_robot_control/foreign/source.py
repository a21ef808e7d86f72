"""A foreign law as the Python source that stands for it: in bags, on a terminal, for its name."""

from __future__ import annotations

import hashlib
from pathlib import Path

from parallel_robot_control.foreign import names
from parallel_robot_control.foreign.process import KINDS
from parallel_robot_model.common.errors import InputError

LARGEST = 200_000_000  # bytes
TEXT = '''"""A foreign law: the file {name}, which is not in here."""

from parallel_robot.law import ForeignLaw

foreign = ForeignLaw(
    {path!r},
    {digest!r},
    {names!r},
)
Gains, initial_memory, update = foreign.Gains, foreign.initial_memory, foreign.update
'''


def is_foreign(path: str | Path) -> bool:
    """Whether a file is a foreign law, by its name."""
    return Path(path).suffix in KINDS


def source_of(path: Path) -> bytes:
    """The source of the law of a file; none of the file is run.

    Raises:
        InputError: it cannot be read or is too large, or what stands beside it is wrong.
    """
    try:
        if not path.is_file() or path.stat().st_size > LARGEST:
            raise InputError(f'{path} is no file of up to {LARGEST} bytes')
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise InputError(f'{path} cannot be read: {error.strerror}') from None
    known = names.beside(path)
    text = TEXT.format(name=ascii(path.name), path=str(path), digest=digest, names=known)
    return text.encode()
