"""Results of estimations as files: keys of the configuration below a comment, and a picture."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import yaml

from parallel_robot.analysis.report import figures
from parallel_robot.bags import output
from parallel_robot_model.common.tables import ShownResult
from parallel_robot_model.configuration import config

# Options of how a bag is read, which a design has not.
OF_BAG = ('topic', 'namespace', 'joints', 'override', 'from', 'to')


class WrittenResult(ShownResult):
    """A result that is some keys of the configuration."""

    def groups(self) -> dict[str, dict[str, Any]]:
        """The keys and their values, by group."""
        raise NotImplementedError

    def header(self) -> list[str]:
        """How they were found, line by line: the comment of the file."""
        raise NotImplementedError

    @property
    def values(self) -> dict[str, Any]:
        """Keys of the configuration and their values."""
        return config.flat(self.groups())

    def write(self, out: Path | None, figure: Path | None = None) -> None:
        """Write YAML for ``--param-file``, and a picture: both or neither.

        Args:
            out: File of the YAML, which must not exist; None: none.
            figure: That of the picture, likewise.

        Raises:
            InputError: one exists or cannot be written there.
            RunError: the disk is full.
        """
        with contextlib.ExitStack() as written:
            if out:
                written.enter_context(output.written(out, self._content().encode()))
            if figure:
                self.save_figure(figure)

    def _content(self) -> str:
        comment = ''.join(f'# {line}\n' for line in self.header())
        return comment + yaml.safe_dump(  # lists in one line each
            self.groups(), sort_keys=False, default_flow_style=None, width=1000
        )

    def draw(self) -> Any:
        """A picture of it, as a figure of matplotlib."""
        raise NotImplementedError

    def save_figure(self, path: Path) -> None:
        """Write a picture into a file that must not exist.

        Raises:
            InputError: the suffix is of no picture format, or it cannot be written.
        """
        figures.save(self.draw(), path)


def check_files(out: Path | None, figure: Path | None, option: str = '--out') -> None:
    """Refuse files of results that exist or cannot be made; `option` names the first one.

    Raises:
        InputError: with the reason.
    """
    if out:
        output.check_new(out, option)
    if figure:
        figures.check_new(figure)
