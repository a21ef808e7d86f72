"""Motions one after another, as they are performed."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from trajectory_gen.trajectory import Reference, Trajectory

KEPT = 100  # motions; of older ones the first is sampled instead


class Part(NamedTuple):
    """A motion that is performed.

    Attributes:
        begin: Index of the sample at which it begins, which still belongs to the one before.
        name: Its shape, or what else it is.
        trajectory: The motion, whose time counts from there.
    """

    begin: int
    name: str
    trajectory: Trajectory


class Course:
    """Which motion the samples belong to. It does not change; `then` makes another one.

    Attributes:
        parts: The motions, in order; the first begins with the first sample.
        period: Time between samples [s].
    """

    def __init__(self, trajectory: Trajectory, period: float) -> None:
        """Begin with a motion."""
        self.parts: tuple[Part, ...] = (Part(0, trajectory.parameters.shape, trajectory),)
        self.period = period

    def sample(self, indices: Any) -> Reference:
        """Evaluate the motions at increasing indices of samples, shape (N,)."""
        indices = np.atleast_1d(indices)
        begins = [part.begin for part in self.parts[1:]]
        which = np.searchsorted(begins, indices)  # a sample at a beginning is of the one before
        parts = []
        for k, part in enumerate(self.parts):
            own = indices[which == k]
            if own.size:
                parts.append(part.trajectory.sample((own - part.begin) * self.period))
        return (
            parts[0]
            if len(parts) == 1
            else Reference(*map(np.concatenate, zip(*parts, strict=True)))
        )

    def until(self, index: int) -> Course:
        """The motions that begin before a sample."""
        return self._with(tuple(part for part in self.parts[1:] if part.begin < index))

    def then(self, part: Part) -> Course:
        """This course until a motion begins, and that motion."""
        return self._with((*self.until(part.begin).parts[1:], part))

    def _with(self, later: tuple[Part, ...]) -> Course:
        """A course with the same first motion, and others after it."""
        first = self.parts[0]
        made = Course(first.trajectory, self.period)
        made.parts = (first, *later[-KEPT:])
        return made
