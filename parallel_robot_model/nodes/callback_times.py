"""How long the callbacks of a node hold its loop."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from typing import Any

from parallel_robot_model.nodes.background import Background


class CallbackTimes:
    """The longest callback since the last look, with its name."""

    def __init__(self, background: Background) -> None:
        """Begin to measure; what the `background` does holds nothing."""
        self._background = background
        self._longest, self._name = 0, ''

    def timed(self, name: str, callback: Callable[..., Any]) -> Callable[..., Any]:
        """A callback whose time counts under a name."""

        @functools.wraps(callback)
        def timed(*arguments: Any) -> Any:
            begun = time.perf_counter_ns()
            try:
                return callback(*arguments)
            finally:
                taken = time.perf_counter_ns() - begun
                if taken > self._longest and not self._background.is_current():
                    self._longest, self._name = taken, name

        return timed

    def take(self) -> dict[str, str]:
        """Entry of the diagnostics; none if there was no callback since the last call."""
        longest, name = self._longest, self._name
        self._longest = 0
        return {'longest callback [ms]': f'{1e-6 * longest:.3f} {name}'} if longest else {}
