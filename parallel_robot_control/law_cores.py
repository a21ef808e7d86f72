"""The compiled cores of a controller's laws: made at its start, or loaded in the background."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np

from parallel_robot_control import cycle_memory
from parallel_robot_control.assembly import assemble
from parallel_robot_control.configuration import ControlConfiguration
from parallel_robot_control.law_core import LawCore
from parallel_robot_control.laws import LAWS
from parallel_robot_control.prepared_law import renewed
from parallel_robot_model.compiler import vector
from parallel_robot_model.processes import cache_directory


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
        self._memory = cycle_memory.made_for(vector(np.zeros(configuration.joints)))
        self._lock = threading.Lock()
        self._made: dict[str, LawCore] = {}  # the newest core of each law
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
        """A new core of a law, with its initial memory.

        Once a law was made, this takes a fraction of a millisecond: nothing but its gains is
        looked at again.

        Args:
            configuration: As at the start, but for law and gains.
            law: Name of the law; empty for the active one.

        Raises:
            InputError: the law cannot be used.
        """
        name = law or configuration.loop.law
        with self._lock:
            made = self._made.get(name)
            known = made and renewed(made.law, configuration.laws[name], configuration.gains[name])
            if made and known:
                core = made.again(known)
            else:
                control = assemble(configuration, name, self._memory)
                core = LawCore(control, self._common, self._wire)
            self._made[name] = core
        return core

    def load(self) -> bool:
        """Load a law that is not loaded yet; for a background thread.

        Returns:
            Whether there are more.
        """
        if self._left:
            self.make(self._configuration, self._left.pop())
        return bool(self._left)
