"""What a controller keeps from one state to the next, as a compiled object.

Python reads and changes its state and its arrays between two calls; what a law keeps is in the
memory of the law. All laws have one type, so its kernels are compiled once for a robot.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from parallel_robot_control.answer_kernel import answer
from parallel_robot_control.assembly import assemble, memory_of
from parallel_robot_control.configuration import ControlConfiguration
from parallel_robot_control.cycle import cycle_of
from parallel_robot_control.prepared_law import PreparedLaw, with_gains
from parallel_robot_model.compiler import Boxed, FunctionValue, Struct, entry_point


class Core(NamedTuple):
    """A law with everything that its cycle needs, boxed; of one type for all laws."""

    cycle: FunctionValue
    setup: Boxed  # ControlSetup
    common: Struct  # see answer_kernel.Common


class LawCore(NamedTuple):
    """The compiled core with one law; the cores of all laws share the rest."""

    configuration: ControlConfiguration  # with this law
    law: PreparedLaw
    compiled: Boxed  # Core


class LawCores:
    """Makes the cores of a controller's laws, at its start and when they change."""

    def __init__(self, configuration: ControlConfiguration, common: Struct, wire: Boxed) -> None:
        """Compile all laws, so that they are ready for a switch.

        Args:
            configuration: Configuration of the controller.
            common: What the cores of all laws share, see Common.
            wire: Layout of the joint states, as the kernels take it.

        Raises:
            InputError: a law cannot be used.
        """
        self._common = common
        self._kind: Any = None  # of the compiled cores
        self.memory = memory_of(configuration)
        self._cores: dict[str, LawCore] = {}  # the newest core of each law
        for law in configuration.laws:
            core = self.make(configuration, law)
        self.answer = entry_point(answer, core.compiled, wire, b'', 0, 0)  # with any core

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
        core_before = self._cores.get(name)
        prepared = core_before and with_gains(
            core_before.law, configuration.laws[name], configuration.gains[name]
        )
        if core_before and prepared:
            before = core_before.compiled.setup
            setup = Boxed(before.value._replace(law=prepared.law), before._numba_type_)
        else:
            prepared, setup, _ = assemble(configuration, name, self.memory)
        if self._kind is None:
            self._cycle = cycle_of(setup)  # the kernels are those of all laws
        compiled = Boxed(Core(self._cycle, setup, self._common), self._kind)
        self._kind = compiled._numba_type_
        core = self._cores[name] = LawCore(configuration, prepared, compiled)
        return core


STATE_FIELDS = ('position', 'velocity', 'effort')
