"""How many connections are held, and for how long: fewer than files that may be open.

A connection in which no request is being answered is let go when newer ones need its place, the
one that was used longest ago first. So connections that send nothing keep nobody off.
"""

from __future__ import annotations

import asyncio
import resource
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

MOST = 256  # connections in which no request is being answered
SHARE = 4  # at most one in so many of the files that may be open
HEADERS = 5.0  # s, within which the first request must have come
KEPT = 75.0  # s, for the next request
BATCH = 32  # connections that are taken before the requests of earlier ones are read
QUEUE = 4096  # connections that wait in the kernel


class Connections:
    """The connections of a server."""

    def __init__(self) -> None:
        self._most = min(MOST, resource.getrlimit(resource.RLIMIT_NOFILE)[0] // SHARE)
        self._idle: dict[Any, float] = {}  # when its time is over, longest unused first

    def taking(self, make: Callable[[], Any]) -> Callable[[], Any]:
        """A factory of protocols that lets go of others where there are too many."""

        def taken() -> Any:
            protocol = make()
            self._rest(protocol, HEADERS)
            return protocol

        return taken

    @contextmanager
    def busy(self, protocol: Any) -> Iterator[None]:
        """Keep a connection while a request is answered in it."""
        held = self._idle.pop(protocol, None) is not None
        try:
            yield
        finally:
            if held and protocol.transport is not None:
                self._rest(protocol, KEPT)

    async def watch(self) -> None:
        """Let go of those whose time is over."""
        while True:
            await asyncio.sleep(1.0)
            now = time.monotonic()
            for protocol in [protocol for protocol, due in self._idle.items() if due < now]:
                self._let_go(protocol)

    def _rest(self, protocol: Any, patience: float) -> None:
        while len(self._idle) >= self._most:
            self._let_go(next(iter(self._idle)))
        self._idle[protocol] = time.monotonic() + patience

    def _let_go(self, protocol: Any) -> None:
        del self._idle[protocol]
        if protocol.transport is None:  # gone, or not there yet
            protocol.force_close()
        else:
            protocol.transport.abort()
