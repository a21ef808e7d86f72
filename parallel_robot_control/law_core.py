"""What a controller keeps from one state to the next, as a compiled object.

Python reads and changes its state and its arrays between two calls; what a law keeps is in the
memory of the law. All laws have one type, so its kernels are compiled once for a robot.
"""

from __future__ import annotations

import copy
from typing import Any, NamedTuple

from numba import types
from numba.experimental import structref

from parallel_robot_control.answer_kernel import Shared, answer
from parallel_robot_control.assembly import Control, assemble, memory_of
from parallel_robot_control.configuration import ControlConfiguration
from parallel_robot_control.cycle import ControlSetup, CycleState, cycle_of
from parallel_robot_control.estimation.estimator import Estimator
from parallel_robot_control.messages import Status, Telemetry
from parallel_robot_control.prepared_law import PreparedLaw, renewed
from parallel_robot_control.safety.limiting import Limits
from parallel_robot_model.common.units import Array
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
    """What does not depend on the law: references, times, state, the fields of Shared."""


@structref.register
class CoreType(types.StructRef):  # type: ignore[misc]
    """Numba's type of a Core, for all laws."""


class Core(structref.StructRefProxy):  # type: ignore[misc]
    """A law with everything that its cycle needs."""


structref.define_boxing(CommonType, Common)
structref.define_constructor(
    Common, CommonType, ('references', 'timing', 'state', *Shared._fields)
)
structref.define_boxing(CoreType, Core)
structref.define_constructor(Core, CoreType, ('cycle', 'setup', 'common'))


@kernel
def _common(references: Any, timing: Timing, state: CycleState, arrays: Shared) -> Any:
    return Common(
        references,
        timing,
        state,
        arrays.measured,
        arrays.telemetry,
        arrays.numbers,
        arrays.command,
        arrays.torques,
        arrays.log,
        arrays.commanded,
        arrays.efforts,
        arrays.ages,
    )


def common(references: Any, timing: Timing, state: CycleState, arrays: Shared) -> Any:
    """Make the object that the cores of all laws share.

    Args:
        references: ReferenceBuffer.compiled.
        timing: See Timing.
        state: State before the first cycle.
        arrays: See Shared.
    """
    return _common(references, timing, state, arrays)


@kernel
def state_of(common: Any) -> CycleState:
    """State of the controller after the last cycle."""
    return common.state


@kernel
def fault_of(common: Any) -> tuple[int, bool]:
    """Number of its fault, and whether its pose is lost; without the rest of the state."""
    return common.state.fault, common.state.lost


@kernel
def set_state(common: Any, state: CycleState) -> None:
    """Replace it."""
    common.state = state


@kernel
def _core(cycle: Any, setup: ControlSetup, common: Any) -> Any:
    return Core(cycle, setup, common)


class LawCore:
    """The compiled core with one law; the cores of all laws share the rest."""

    def __init__(self, control: Control, common: Any, wire: Any) -> None:
        """Make the core, and compile the kernels that use it, which are those of all laws.

        Args:
            control: Law, robot, limits.
            common: See :func:`common`.
            wire: Layout of the state messages, see Wire.
        """
        self.law, self._setup, self._common = control.law, control.setup, common
        self._cycle = cycle_of(control.setup, control.state)
        self._make = entry_point(_core, *self._parts())
        self._core = self._make(*self._parts())
        self._answer = entry_point(answer, self._core, wire, b'', 0, 0)

    def again(self, law: PreparedLaw, setup: ControlSetup) -> LawCore:
        """Another core, with the same kernels."""
        other = copy.copy(self)
        other.law, other._setup = law, setup
        other._core = self._make(*other._parts())
        return other

    def renewed(self, law: PreparedLaw) -> LawCore:
        """The core of the same law with other gains."""
        return self.again(law, self._setup._replace(law=law.law))

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

    def _parts(self) -> tuple[Any, ...]:
        return self._cycle, self._setup, self._common


# The compiled cores of a controller's laws, made at its start.


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


# What goes into a controller and comes out of it.

STATE_FIELDS = ('position', 'velocity', 'effort')


class JointSample(NamedTuple):
    """Measured joints at one time: [rad], [rad/s], [N m], each shape (n,)."""

    position: Array
    velocity: Array
    effort: Array


class Answer(NamedTuple):
    """Answer to one state: the torque [N m], shape (n,), and its telemetry."""

    torque: Array
    telemetry: Telemetry
    status: Status


class Change(NamedTuple):
    """An accepted change of law or gains: the new configuration and the compiled law."""

    configuration: ControlConfiguration
    core: LawCore

    @property
    def law(self) -> PreparedLaw:
        """The law."""
        return self.core.law
