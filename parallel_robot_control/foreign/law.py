"""A foreign law as a law of the suite: what its file is, and the process that answers for it."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from parallel_robot_control.foreign import fmu_law, process
from parallel_robot_control.foreign.channel import Channel, Gains, Memory, update
from parallel_robot_control.foreign.fmu_law import gains_class
from parallel_robot_control.foreign.process import KINDS
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import JointUnits

PERIODS = 1e-6  # by which two periods may differ, as a share

_channels: dict[tuple[Any, ...], Channel] = {}
_sessions = itertools.count(1)


class ForeignLaw:
    """A C function or an FMU as a law, see docs/c_law.md and docs/fmu.md."""

    def __init__(
        self, path: str, sha256: str, names: Mapping[str, Any] = MappingProxyType({})
    ) -> None:
        """Name it; nothing of it runs before it is needed.

        Args:
            path: Its file.
            sha256: What the file must be.
            names: What an FMU calls what, see :mod:`parallel_robot_control.foreign.fmu_law`.
        """
        self.path, self.sha256, self.names = path, sha256, names  # its file
        # the class of its gains
        self.Gains = gains_class(names.get('gains', {}), f'foreign_{_digest(sha256, names)}')
        self.update = update
        self._channel: Channel | None = None

    def initial_memory(self, joints: int) -> Memory:
        """Memory before the first question; the process runs.

        Raises:
            InputError: the file is gone or another one, or cannot be used for so many joints.
        """
        key = (self.path, self.sha256, repr(self.names), joints)
        if key not in _channels:
            if joints > process.MOST:
                raise InputError(f'{self.path}: at most {process.MOST} joints, not {joints}')
            self._check()
            _channels[key] = Channel(self.path, self.names, joints)
        self._channel = _channels[key]
        self.start()
        return Memory(int(self._channel.space), next(_sessions), 0)

    def choose(self, memory: Memory, gains: Any) -> None:
        """Have gains for one who asks; those that its own parameters are go to its process."""
        own = gains[len(Gains._fields) :]
        if own and self._channel:
            self._channel.choose(memory.session, own)

    def _check(self) -> None:
        """Refuse another file than the one that was named."""
        try:
            digest = hashlib.sha256(Path(self.path).read_bytes()).hexdigest()
        except OSError as error:
            raise InputError(f'{self.path} cannot be read: {error.strerror}') from None
        if digest != self.sha256:
            raise InputError(f'{self.path} is not the file that is meant: its sha256 is {digest}')

    def check_loop(self, period: float, units: JointUnits) -> None:
        """Refuse a period or joints that are not the law's; it has an initial memory.

        Raises:
            InputError: the law is for another period, or for slides where hinges are.
        """
        if self._channel is None:
            return
        for joint, slide, text in self._channel.kinds:
            if slide != any(units.slides[joint : joint + 1]):
                kind = 'hinge' if slide else 'slide'
                raise InputError(f'{self.path}: {text}, but joint {joint + 1} is a {kind}')
        own = self._channel.period
        if not own:
            return
        steps = round(period / own) if self._channel.multiples else 1
        if not steps or abs(steps * own - period) > PERIODS * period:
            whole = 'a part of ' if self._channel.multiples else ''
            raise InputError(
                f'{self.path} steps by {own:.9g} s, which must be {whole}the period, '
                f'{period:.9g} s',
                'period',
            )

    @property
    def ESTIMATOR(self) -> str:
        """The kind of estimator that it needs, once it has an initial memory."""
        return 'aged' if self._channel and self._channel.aged else 'none'

    @property
    def ready(self) -> bool:
        """Whether its process is there."""
        return self._channel is None or self._channel.runs

    def start(self) -> None:
        """Have a process for a new run, whatever became of the one before.

        Raises:
            InputError: the file is gone or another one, or cannot be loaded any more.
        """
        if self._channel and not self._channel.runs:
            self._check()
            self._channel.ready()

    def failure(self, gains: Any) -> str:
        """Why the last update gave no torque; empty if that is not known."""
        return self._channel.failure(gains.limit) if self._channel else ''


def _digest(sha256: str, names: Mapping[str, Any]) -> str:
    """Identity of the law."""
    return hashlib.sha256(f'{sha256}{names!r}'.encode()).hexdigest()[:16]


# A foreign law as the Python source that stands for it: in bags, on a terminal, for its name.

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
    known = fmu_law.names_beside(path)
    text = TEXT.format(name=ascii(path.name), path=str(path), digest=digest, names=known)
    return text.encode()
