"""A result that Python shows as the command line prints it."""

from __future__ import annotations

from parallel_robot_model.common import tables
from parallel_robot_model.common.tables import Part


class ShownResult:
    """A result of lines and tables, for a console, for notebooks and for the command line.

    One that has ``warnings``, one line each, shows them below.
    """

    def parts(self) -> list[Part]:
        """Its lines and tables."""
        raise NotImplementedError

    def lines(self) -> list[str]:
        """The same as lines of text."""
        return tables.text(self.parts()).split('\n')

    def _told(self) -> list[Part]:
        warnings = getattr(self, 'warnings', ())
        return [*self.parts(), *(f'warning: {text}' for text in warnings)]

    def __repr__(self) -> str:
        """What came of it, and warnings."""
        return tables.text(self._told())

    def _repr_markdown_(self) -> str:
        """The same for a notebook."""
        return tables.markdown(self._told())
