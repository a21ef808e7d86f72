"""Threads of the linear algebra, which cost more than they give where matrices are small."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from threadpoolctl import threadpool_limits


@contextlib.contextmanager
def one_blas_thread() -> Iterator[None]:
    """Let one thread do the linear algebra of what follows, or of a function that this decorates.

    With more, results differ in their last digits, and threads wait for each other.
    """
    with threadpool_limits(1, 'blas'):
        yield
