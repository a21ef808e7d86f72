"""What a controller keeps from one state to the next, as a compiled object for each law.

Its arrays are shared with Python, which reads and changes them between two calls; what
depends on the law (gains, memory) is in the compiled object alone.
"""

from __future__ import annotations

import copy
from typing import Any, NamedTuple

from numba import types
from numba.experimental import structref

from parallel_robot_control.answer_kernel import answer
from parallel_robot_control.assembly import Control
from parallel_robot_control.cycle import ControlSetup, cycle_of
from parallel_robot_control.estimator import Estimator
from parallel_robot_control.prepared_law import PreparedLaw
from parallel_robot_control.safety import Limits
from parallel_robot_control.shared_arrays import Shared
from parallel_robot_model.compiler import entry_point, kernel


class Timing(NamedTuple):
    """Times [ns], and whether the plant waits for each command."""

    period: int
    reference_timeout: int
    state_timeout: int
    state_age: int
    lockstep: bool


@structref.register
class CommonType(types.StructRef):  # type: ignore[misc]
    """Numba's type of a Common."""


class Common(structref.StructRefProxy):  # type: ignore[misc]
    """What does not depend on the law: references, times, the fields of Shared."""


@structref.register
class CoreType(types.StructRef):  # type: ignore[misc]
    """Numba's type of a Core: one for each law."""


class Core(structref.StructRefProxy):  # type: ignore[misc]
    """A law with everything that its cycle needs."""


structref.define_boxing(CommonType, Common)
structref.define_constructor(Common, CommonType, ('references', 'timing', *Shared._fields))
structref.define_boxing(CoreType, Core)
structref.define_constructor(Core, CoreType, ('cycle', 'setup', 'memory', 'common', 'pose'))


@kernel
def _common(references: Any, timing: Timing, arrays: Shared) -> Any:
    return Common(
        references,
        timing,
        arrays.pose,
        arrays.vectors,
        arrays.telemetry,
        arrays.numbers,
        arrays.command,
        arrays.torques,
        arrays.log,
        arrays.ages,
    )


def common(references: Any, timing: Timing, arrays: Shared) -> Any:
    """Make the object that the cores of all laws share.

    Args:
        references: ReferenceBuffer.compiled.
        timing: See Timing.
        arrays: See Shared.
    """
    return _common(references, timing, arrays)


@kernel
def _core(cycle: Any, setup: ControlSetup, memory: Any, common: Any, pose: Any) -> Any:
    return Core(cycle, setup, memory, common, pose)


@kernel
def _memory(core: Any) -> Any:
    return core.memory


class LawCore:
    """The compiled core with one law; the cores of all laws share the rest.

    Attributes:
        law: The law.
    """

    def __init__(self, control: Control, common: Any, wire: Any) -> None:
        """Make the core, with the initial memory of its law, and compile the kernels that use it.

        Args:
            control: Law, robot, limits.
            common: See :func:`common`.
            wire: Layout of the state messages, see Wire.
        """
        self.law = control.law
        self._setup, self._common = control.setup, common
        self._pose = control.state.pose  # any: for the size of a pose
        self._cycle = cycle_of(control.setup, control.state, control.law.memory)
        self._make = entry_point(_core, *self._parts(control.law.memory))
        self._core = self._make(*self._parts(control.law.memory))
        self._answer = entry_point(answer, self._core, wire, b'', 0, 0)
        self._memory = entry_point(_memory, self._core)

    def again(self, law: PreparedLaw) -> LawCore:
        """Another core of the same law, with its initial memory.

        Args:
            law: The law, with gains of the same types.
        """
        other = copy.copy(self)
        other.law, other._setup = law, self._setup._replace(gains=law.constants)
        other.memory = law.memory
        return other

    def answer(self, wire: Any, data: bytes, now: int, monotonic: int) -> int:
        """See :func:`answer`."""
        code: int = self._answer(self._core, wire, data, now, monotonic)
        return code

    @property
    def limits(self) -> Limits:
        """Limits that the kernels apply."""
        limits: Limits = self._setup.limits.value
        return limits

    @property
    def estimator(self) -> Estimator:
        """Where the motion of the joints is known from."""
        estimator: Estimator = self._setup.estimator.value
        return estimator

    @property
    def memory(self) -> Any:
        """Memory of the law."""
        return self._memory(self._core)

    @memory.setter
    def memory(self, memory: Any) -> None:
        self._core = self._make(*self._parts(memory))

    def _parts(self, memory: Any) -> tuple[Any, ...]:
        return self._cycle, self._setup, memory, self._common, self._pose
