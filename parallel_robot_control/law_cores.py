"""The compiled cores of a controller's laws: made at its start, or loaded in the background."""

from __future__ import annotations

import threading
from typing import Any

from parallel_robot_base import cache_directory
from parallel_robot_control.assembly import assemble
from parallel_robot_control.configuration import ControlConfiguration
from parallel_robot_control.law_core import LawCore
from parallel_robot_control.laws import LAWS


class LawCores:
    """Makes cores, one at a time: only one thread may compile."""

    def __init__(
        self, configuration: ControlConfiguration, common: Any, wire: Any, lazy: bool
    ) -> None:
        """Compile all laws, so that they are ready for a switch.

        Args:
            configuration: Configuration of the controller.
            common: What the cores of all laws share, see :func:`law_core.common`.
            wire: Layout of the joint states, as the kernels take it.
            lazy: Whether laws of the suite that are known to be compiled but are not active are
                loaded later by :meth:`load`.

        Raises:
            InputError: a law cannot be used.
        """
        self._configuration = configuration
        self._common, self._wire = common, wire
        self._lock = threading.Lock()
        mark = f'{cache_directory.COMPLETE}_{configuration.robot.name}'
        complete = cache_directory.marked(mark) is not None
        active = configuration.loop.law
        self._left = [law for law in LAWS if lazy and complete and law != active]
        for law in configuration.laws:
            if law not in (active, *self._left):
                self.make(configuration, law)
        if not self._left and not configuration.custom:
            cache_directory.mark(mark)

    def make(self, configuration: ControlConfiguration, law: str = '') -> LawCore:
        """The core of a law; empty for the active one.

        Raises:
            InputError: the law cannot be used.
        """
        with self._lock:
            return LawCore(assemble(configuration, law), self._common, self._wire)

    def load(self) -> bool:
        """Load a law that is not loaded yet; for a background thread.

        Returns:
            Whether there are more.
        """
        if self._left:
            self.make(self._configuration, self._left.pop())
        return bool(self._left)
