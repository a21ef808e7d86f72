"""An emergency stop outlives the controller that was told it: it is kept in a file."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from parallel_robot_model.common.errors import RunError
from parallel_robot_model.processes.user_directory import (
    STATE,
    is_own,
    open_own,
    state_directories,
)


class KeptStop:
    """The file that says that a controller is in emergency stop; its time says since when."""

    def __init__(self, node: str) -> None:
        """Name it after the ROS domain and a node by its full name."""
        domain = os.environ.get('ROS_DOMAIN_ID') or '0'
        self._name = f'stopped_{domain}{node.replace("/", ".")}'  # no name of ROS has dots

    def keep(self) -> str:
        """Keep a stop that was told just now; returns why that is not possible, or nothing."""
        try:
            with open_own(self._name, state_directories(), STATE) as file:
                os.utime(file.fileno())
        except (RunError, OSError) as error:
            return str(error)
        return ''

    def told_at(self) -> float | None:
        """When the stop was told, in seconds since 1970; None when there is none."""
        times = [status.st_mtime for _, status in self._found()]
        return max(times, default=None)

    def forget(self) -> str:
        """Keep the stop no longer; returns why that is not possible, or nothing."""
        reason = ''
        for path, _ in self._found():
            try:
                path.unlink(missing_ok=True)
            except OSError as error:
                reason = f'cannot remove {path}: {error.strerror}'
        return reason

    def _found(self) -> list[tuple[Path, os.stat_result]]:
        """The user's own files of this name; what else may lie there is not looked at."""
        files = []
        for root in state_directories():
            with contextlib.suppress(OSError):
                status = os.lstat(root / self._name)
                if is_own(status):
                    files.append((root / self._name, status))
        return files
