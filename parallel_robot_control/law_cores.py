"""The compiled cores of a controller's laws, made at its start."""

from __future__ import annotations

from typing import Any

from parallel_robot_control.assembly import assemble, memory_of
from parallel_robot_control.configuration import ControlConfiguration
from parallel_robot_control.law_core import LawCore
from parallel_robot_control.prepared_laws.prepared_law import renewed


class LawCores:
    """Makes cores."""

    def __init__(self, configuration: ControlConfiguration, common: Any, wire: Any) -> None:
        """Compile all laws, so that they are ready for a switch.

        Args:
            configuration: Configuration of the controller.
            common: What the cores of all laws share, see :func:`law_core.common`.
            wire: Layout of the joint states, as the kernels take it.

        Raises:
            InputError: a law cannot be used.
        """
        self._common, self._wire = common, wire
        self._memory = memory_of(configuration)
        self._first: LawCore | None = None
        self._made: dict[str, LawCore] = {}  # the newest core of each law
        for law in configuration.laws:
            self.make(configuration, law)

    def make(self, configuration: ControlConfiguration, law: str = '') -> LawCore:
        """A new core of a law.

        Once a law was made, this takes a fraction of a millisecond: nothing but its gains is
        looked at again.

        Args:
            configuration: As at the start, but for law and gains.
            law: Name of the law; empty for the active one.

        Raises:
            InputError: the law cannot be used.
        """
        name = law or configuration.loop.law
        made = self._made.get(name)
        known = made and renewed(made.law, configuration.laws[name], configuration.gains[name])
        if made and known:
            core = made.renewed(known)
        else:
            control = assemble(configuration, name, self._memory)
            if self._first is None:
                self._first = LawCore(control, self._common, self._wire)
            core = self._first.again(control.law, control.setup)
        self._made[name] = core
        return core
