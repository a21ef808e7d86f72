"""The simulated plant, the plant node, and the closed loop without ROS.

>>> from parallel_robot_sim import simulate
>>> run = simulate('paper_circle', law='smc', duration=1)

What is offered here is imported when it is used first: the compiler takes a second.
"""

from typing import TYPE_CHECKING, Any

import parallel_robot_model  # noqa: F401, before Numba

__all__ = ['Run', 'simulate']

if TYPE_CHECKING:
    from parallel_robot_sim.scenario_run import Run, simulate
else:

    def __getattr__(name: str) -> Any:
        if name not in __all__:
            raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
        from parallel_robot_sim import scenario_run

        return getattr(scenario_run, name)

    def __dir__() -> list[str]:
        return sorted([*globals(), *__all__])
