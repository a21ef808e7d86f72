"""The socket of the page, and the loop that serves it until the user ends it."""

from __future__ import annotations

import asyncio
import socket
import sys
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from functools import partial
from typing import Any

from aiohttp import web

from parallel_robot.live.connections import BATCH, KEPT, QUEUE
from parallel_robot.live.guard import OPEN, is_loopback
from parallel_robot.live.protocol import LOG, Protocol, tell
from parallel_robot.live.server import LiveServer
from parallel_robot.live.source import Source
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.processes.ending_signals import ending_signals

LAST = 1.0  # s, for browsers to take what was sent before the server ends


@contextmanager
def listening(host: str, port: int | None, usual: int) -> Iterator[Callable[[Source, bool], None]]:
    """Take a port, before anything is started that would have to be ended without one.

    Args:
        host: Name or address.
        port: Number; 0 for any; None for the usual one, or any if that is taken.
        usual: Number of the usual one.

    Yields:
        What serves a source, if need be read-only, until a signal ends it.

    Raises:
        InputError: the port or the address cannot be had.
    """
    try:
        taken = _bind(host, usual if port is None else port)
    except OSError as error:
        if port is not None or error.errno is None or isinstance(error, socket.gaierror):
            raise InputError(_reason(host, port, error)) from None
        try:
            taken = _bind(host, 0)
        except OSError as second:
            raise InputError(_reason(host, port, second)) from None
    with taken:
        yield lambda source, read_only: asyncio.run(_serve(taken, host, source, read_only))


def _reason(host: str, port: int | None, error: OSError) -> str:
    where = host if port is None else f'{host} port {port}'
    return f'cannot listen on {where}: {error.strerror or error}'


def _bind(host: str, port: int) -> socket.socket:
    family, kind, protocol, _, address = socket.getaddrinfo(
        host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
    )[0]
    made = socket.socket(family, kind, protocol)
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind(address)
        made.listen()
    except OSError:
        made.close()
        raise
    return made


@asynccontextmanager
async def accepting(listening: socket.socket, server: LiveServer) -> AsyncIterator[None]:
    """Answer who connects to a socket within the context."""
    runner = web.AppRunner(server.application(), access_log=None, shutdown_timeout=LAST)
    await runner.setup()
    manager, loop = runner.server, asyncio.get_running_loop()
    assert manager is not None  # after the set-up
    loop.set_exception_handler(tell)
    words: dict[str, Any] = {'logger': LOG, 'access_log': None, 'keepalive_timeout': KEPT}
    words['auto_decompress'] = False  # no page compresses
    make = partial(Protocol, manager, loop=loop, **words)
    taking = server.connections.taking(make)
    taken = await loop.create_server(taking, sock=listening, backlog=BATCH)
    listening.listen(QUEUE)
    try:
        yield
    finally:
        taken.close()
        await runner.cleanup()


async def _serve(listening: socket.socket, host: str, source: Source, read_only: bool) -> None:
    server = LiveServer(source, host, read_only)
    async with accepting(listening, server):
        name = f'[{host}]' if ':' in host else host
        token = '' if read_only else f'#{server.guard.token}'
        print(f'page    http://{name}:{listening.getsockname()[1]}/{token}', flush=True)
        if not is_loopback(listening.getsockname()[0]):
            print(OPEN, file=sys.stderr)
        ended = asyncio.Event()
        loop = asyncio.get_running_loop()
        for number in ending_signals():
            loop.add_signal_handler(number, ended.set)
        await ended.wait()
