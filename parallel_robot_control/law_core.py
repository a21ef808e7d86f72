"""What a controller keeps from one state to the next, as a compiled object.

Python reads and changes its state and its arrays between two calls; what a law keeps is in the
memory of the law. All laws have one type, so its kernels are compiled once for a robot.
"""

from __future__ import annotations

import copy
from typing import Any, NamedTuple

from parallel_robot_control.answer_kernel import answer
from parallel_robot_control.assembly import Control, assemble, memory_of
from parallel_robot_control.configuration import ControlConfiguration
from parallel_robot_control.cycle import cycle_of
from parallel_robot_control.prepared_law import PreparedLaw, renewed
from parallel_robot_model.compiler import Boxed, FirstClass, Struct, entry_point


class Core(NamedTuple):
    """A law with everything that its cycle needs, boxed; of one type for all laws."""

    cycle: FirstClass
    setup: Boxed  # ControlSetup
    common: Struct  # see answer_kernel.Common


class LawCore:
    """The compiled core with one law; the cores of all laws share the rest."""

    def __init__(
        self, configuration: ControlConfiguration, control: Control, common: Struct, wire: Boxed
    ) -> None:
        """Make the core, and compile the kernels that use it, which are those of all laws.

        Args:
            configuration: Configuration of the controller.
            control: Law, robot, limits.
            common: See Common.
            wire: Layout of the state messages, see Wire.
        """
        self.configuration = configuration  # with this law
        self.law, self.setup, self._common = control.law, control.setup, common
        self._cycle = cycle_of(control.setup)
        self._core = Boxed(Core(self._cycle, control.setup, common))
        self._answer = entry_point(answer, self._core, wire, b'', 0, 0)

    def again(
        self, configuration: ControlConfiguration, law: PreparedLaw, setup: Boxed
    ) -> LawCore:
        """Another core, with the same kernels."""
        other = copy.copy(self)
        other.configuration, other.law, other.setup = configuration, law, setup
        core = Core(self._cycle, setup, self._common)
        other._core = Boxed(core, self._core._numba_type_)
        return other

    def renewed(self, configuration: ControlConfiguration, law: PreparedLaw) -> LawCore:
        """The core of the same law with other gains."""
        setup = self.setup.value._replace(law=law.law)
        return self.again(configuration, law, Boxed(setup, self.setup._numba_type_))

    def answer(self, wire: Any, data: bytes, now: int, monotonic: int) -> int:
        """See :func:`answer`."""
        code: int = self._answer(self._core, wire, data, now, monotonic)
        return code


# The compiled cores of a controller's laws, made at its start.


class LawCores:
    """Makes cores."""

    def __init__(self, configuration: ControlConfiguration, common: Struct, wire: Boxed) -> None:
        """Compile all laws, so that they are ready for a switch.

        Args:
            configuration: Configuration of the controller.
            common: What the cores of all laws share, see Common.
            wire: Layout of the joint states, as the kernels take it.

        Raises:
            InputError: a law cannot be used.
        """
        self._common, self._wire = common, wire
        self.memory = memory_of(configuration)
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
            core = made.renewed(configuration, known)
        else:
            control = assemble(configuration, name, self.memory)
            if self._first is None:
                self._first = LawCore(configuration, control, self._common, self._wire)
            core = self._first.again(configuration, control.law, control.setup)
        self._made[name] = core
        return core


STATE_FIELDS = ('position', 'velocity', 'effort')
