"""Who may ask for what: checks of a request before anything is done with it."""

from __future__ import annotations

import asyncio
import ipaddress
import logging
import resource
import secrets
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from aiohttp import web

from parallel_robot_model.common.errors import first_line, printable

OPEN = (
    'warning: who can reach this machine can look, and can read the traffic: it is not encrypted'
)
RATE, BURST = 10.0, 20.0  # requests a second, and at once, that may change something


class Guard:
    """Knows the token, and the names under which the server may be addressed."""

    def __init__(self, host: str, clock: Callable[[], float] = time.monotonic) -> None:
        """Make a new token.

        Args:
            host: Name or address that the server listens on.
            clock: Time [s].
        """
        self.token = secrets.token_urlsafe(24)
        self._names = {'localhost', host.lower()}
        self._clock = clock
        self._left, self._last = BURST, clock()

    def knows_host(self, host: str) -> bool:
        """Whether a Host header names this server.

        A page of another site whose name was made to point here (DNS rebinding) has that name in
        it. An address cannot be made to point elsewhere.
        """
        name = _name(host)
        return name in self._names or _is_address(name)

    def knows_origin(self, origin: str | None, host: str) -> bool:
        """Whether a request comes from this server's page, or from no page at all."""
        return origin is None or origin.lower() == f'http://{host.lower()}'

    def knows_token(self, authorization: str) -> bool:
        """Whether an Authorization header has the token."""
        given = authorization.encode(errors='surrogateescape')  # any bytes may have been sent
        return secrets.compare_digest(given, f'Bearer {self.token}'.encode())

    def has_time(self) -> bool:
        """Whether one more request may change something now."""
        now = self._clock()
        self._left = min(BURST, self._left + RATE * (now - self._last))
        self._last = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


def is_loopback(address: str) -> bool:
    """Whether an address, with or without a zone, is that of this machine alone."""
    return ipaddress.ip_address(address.partition('%')[0]).is_loopback


def _name(host: str) -> str:
    """Name or address in a Host header, without port and brackets."""
    if host.startswith('['):
        return host[1:].partition(']')[0].lower()
    return host.partition(':')[0].lower()


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


# How many connections are held, and for how long: fewer than files that may be open.
#
# A connection in which no request is being answered is let go when newer ones need its place, the
# one that was used longest ago first. So connections that send nothing keep nobody off.

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


# What is said of a request that is none: one line to whoever sent it, few to the user.

PAUSE = 10.0  # s, between two lines about errors


class _Seldom(logging.Filter):
    """Lets one record through now and then, as one line."""

    def __init__(self) -> None:
        super().__init__()
        self._due, self._silent = 0.0, 0

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether a record is to be told; it then says how many were not."""
        if time.monotonic() < self._due:
            self._silent += 1
            return False
        error = record.exc_info[1] if record.exc_info else None
        text = f'page: {record.getMessage()}' + (f': {first_line(error)}' if error else '')
        more = f' (and {self._silent} more)' if self._silent else ''
        record.msg, record.args, record.exc_info = printable(text) + more, (), None
        self._due, self._silent = time.monotonic() + PAUSE, 0
        return True


LOG = logging.getLogger('parallel_robot.live')
LOG.addFilter(_Seldom())


def tell(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Tell an error of the loop, e.g. of its sockets."""
    LOG.error(context['message'], exc_info=context.get('exception'))


class Protocol(web.RequestHandler):
    """The protocol of a connection."""

    __slots__ = ()

    def handle_error(
        self,
        request: web.BaseRequest,
        status: int = 500,
        exc: BaseException | None = None,
        message: str | None = None,
    ) -> web.StreamResponse:
        """The answer to what is no request, or could not be answered; ends the connection."""
        if status >= 500:
            LOG.error('a request failed', exc_info=exc)
        if request.writer.output_size > 0:
            raise ConnectionError('part of the answer was sent')
        what = 'this request could not be answered' if status >= 500 else 'not a request'
        answer = web.Response(status=status, text=what)
        answer.force_close()
        return answer
