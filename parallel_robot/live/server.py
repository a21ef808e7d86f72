"""The web server: the page, one stream of frames to each browser, and what a browser may ask."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import sys
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from functools import partial
from importlib.resources import files as resources
from typing import TYPE_CHECKING, Any, NamedTuple

from aiohttp import WSMsgType, web

from parallel_robot.analysis.pictures import STYLES
from parallel_robot.live.frames import HEADER
from parallel_robot.live.guard import (
    BATCH,
    KEPT,
    LOG,
    OPEN,
    QUEUE,
    Connections,
    Guard,
    is_loopback,
    tell,
)
from parallel_robot.live.guard import Protocol as HttpProtocol
from parallel_robot.live.source import RefusedError
from parallel_robot_model.common.errors import InputError, ParallelRobotError
from parallel_robot_model.processes.termination_signals import termination_signals

if TYPE_CHECKING:
    from parallel_robot.live.bag_source import BagSource
    from parallel_robot.live.graph_source import GraphSource

    Source = BagSource | GraphSource

# The files of the page, held in memory; the drawing and the colours are those of the report.

KINDS = {
    'html': 'text/html',
    'js': 'text/javascript',
    'css': 'text/css',
    'svg': 'image/svg+xml',
    '': 'text/plain',
}
PAGE, REPORT = 'parallel_robot.live', 'parallel_robot.analysis.report'
FILES = {
    '/': (PAGE, 'static/live.html'),
    '/live.css': (PAGE, 'static/live.css'),
    '/live.js': (PAGE, 'static/live.js'),
    '/stream.js': (PAGE, 'static/stream.js'),
    '/curves.js': (PAGE, 'static/curves.js'),
    '/controls.js': (PAGE, 'static/controls.js'),
    '/icon.svg': (PAGE, 'static/icon.svg'),
    '/uplot/uPlot.iife.min.js': (PAGE, 'static/uplot/uPlot.iife.min.js'),
    '/uplot/uPlot.min.css': (PAGE, 'static/uplot/uPlot.min.css'),
    '/uplot/LICENSE': (PAGE, 'static/uplot/LICENSE'),
    '/robot.js': (REPORT, 'templates/robot.js'),
    '/theme.css': (REPORT, 'templates/theme.css'),
}


class File(NamedTuple):
    """A file of the page."""

    content: bytes
    kind: str


def files() -> dict[str, File]:
    """All files by path."""
    found = {
        path: File(
            resources(package).joinpath(name).read_bytes(),
            KINDS[name.rpartition('.')[2] if '.' in name else ''],
        )
        for path, (package, name) in FILES.items()
    }
    themes = {':root': 'light', ":root[data-theme='dark']": 'dark'}
    rules = []
    for theme, shade in themes.items():
        colours = ' '.join(f'--{key}: {getattr(style, shade)};' for key, style in STYLES.items())
        rules.append(f'{theme} {{ {colours} }}')
    found['/colours.css'] = File('\n'.join(rules).encode(), 'text/css')
    return found


# What all browsers share: the newest frames and texts. Whoever is slow gets the newest alone.

BACKLOG = 450  # frames that a browser gets when it begins: 15 s


class Hub:
    """Keeps what is shown, and passes it on to any number of browsers."""

    def __init__(self) -> None:
        self._frames: deque[bytes] = deque(maxlen=BACKLOG)
        self._layout = -1
        self._newest: list[bytes] = []  # frames of the last look
        self._shown = 0  # looks with frames so far
        self._texts: dict[str, tuple[int, str]] = {}  # name to version and JSON
        self._news = asyncio.Event()

    def show(self, frames: list[bytes], texts: dict[str, Any]) -> None:
        """Take new frames, and what else is known; wake everybody up."""
        for name, value in texts.items():
            text = json.dumps({name: value}, separators=(',', ':'))
            version, before = self._texts.get(name, (0, ''))
            if text != before:
                self._texts[name] = (version + 1, text)
        for frame in frames:
            layout = HEADER.unpack_from(frame)[1]
            if layout != self._layout:
                self._layout = layout
                self._frames.clear()
            self._frames.append(frame)
        if frames:
            self._newest = frames
            self._shown += 1
        woken, self._news = self._news, asyncio.Event()
        woken.set()

    async def pass_on(self, socket: web.WebSocketResponse) -> None:
        """Send a browser what is new, for ever; looks that come while it does not read are lost.

        A browser that begins, or that has frames of another layout, gets those of the past, too.
        """
        versions: dict[str, int] = {}
        layout, seen = -1, 0
        while True:
            while unsent := [k for k, (new, _) in self._texts.items() if versions.get(k) != new]:
                versions[unsent[0]], text = self._texts[unsent[0]]
                await socket.send_str(text)
            if self._frames and seen != self._shown:
                frames = self._newest if layout == self._layout else self._frames
                layout, seen = self._layout, self._shown
                await socket.send_bytes(b''.join(frames))
            else:
                await self._news.wait()
                continue
            if seen == self._shown:
                await self._news.wait()


RATE = 30.0  # Hz, of the frames
LONGEST = 4096  # bytes of what a browser may send
BROWSERS = 64  # at once
ALIVE = 20.0  # s, after which a browser that does not answer is let go
STOP = 'emergency_stop'
HEADERS = {
    'Content-Security-Policy': "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    'X-Content-Type-Options': 'nosniff',
    'Referrer-Policy': 'no-referrer',
    'Cache-Control': 'no-store',
    'Cross-Origin-Resource-Policy': 'same-origin',
    'Cross-Origin-Opener-Policy': 'same-origin',
}
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class LiveServer:
    """Serves one source."""

    def __init__(self, source: Source, host: str, read_only: bool = False) -> None:
        """Prepare.

        Args:
            source: What is shown.
            host: Name or address that the server listens on.
            read_only: Whether nothing can be changed by the page.
        """
        # guard: who may ask for what; connections: what is held open
        self.guard, self.connections = Guard(host), Connections()
        self._source, self._read_only = source, read_only
        self._hub = Hub()
        self._files = files()
        self._browsers = 0
        self._stopping: asyncio.Task[str] | None = None

    def application(self) -> web.Application:
        """The application of aiohttp."""
        application = web.Application(middlewares=[self._check], client_max_size=LONGEST)
        application.router.add_get('/frames', self._stream)
        application.router.add_post('/do/{action}', self._do)
        application.router.add_get('/{path:.*}', self._file)
        application.cleanup_ctx.append(self._looking)
        return application

    async def _looking(self, _: web.Application) -> AsyncIterator[None]:
        """Look at the source and the connections while the server runs."""
        tasks = [asyncio.create_task(work) for work in (self._look(), self.connections.watch())]
        yield
        for task in tasks:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task

    async def _look(self) -> None:
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            frames = self._source.look()  # before the texts, which say what is in them
            self._hub.show(frames, {**self._source.texts(), 'page': {'readOnly': self._read_only}})
            due = max(due + 1.0 / RATE, loop.time())
            await asyncio.sleep(due - loop.time())

    @web.middleware
    async def _check(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Refuse what comes from another site; add the headers of the page."""
        try:
            hosts, origins = (request.headers.getall(key, []) for key in ('Host', 'Origin'))
            if len(hosts) != 1 or not self.guard.knows_host(hosts[0]):
                raise web.HTTPForbidden(text='not the name of this server')
            if len(origins) > 1 or not self.guard.knows_origin(next(iter(origins), None), *hosts):
                raise web.HTTPForbidden(text='not from the page of this server')
            with self.connections.busy(request.protocol):
                response = await handler(request)
        except web.HTTPException as refused:
            refused.headers.update(HEADERS)
            raise
        if not response.prepared:
            response.headers.update(HEADERS)
        return response

    async def _file(self, request: web.Request) -> web.Response:
        found = self._files.get(request.path)
        if found is None:
            raise web.HTTPNotFound(text='no such page')
        return web.Response(body=found.content, content_type=found.kind, charset='utf-8')

    async def _stream(self, request: web.Request) -> web.StreamResponse:
        """Send frames until the browser goes; whatever it says ends the stream."""
        if self._browsers >= BROWSERS:
            raise web.HTTPServiceUnavailable(text=f'{BROWSERS} browsers look already')
        socket = web.WebSocketResponse(heartbeat=ALIVE, max_msg_size=LONGEST, compress=False)
        self._browsers += 1
        try:
            await socket.prepare(request)
            sending = asyncio.create_task(self._hub.pass_on(socket))
            try:
                message = await socket.receive()
                if message.type in (WSMsgType.TEXT, WSMsgType.BINARY):
                    await socket.close(code=1008)
            finally:
                sending.cancel()
                with contextlib.suppress(asyncio.CancelledError, ConnectionError, RuntimeError):
                    await sending
        finally:
            self._browsers -= 1
        return socket

    async def _do(self, request: web.Request) -> web.Response:
        """Do what a browser asks for, if it has the token."""
        action = request.match_info['action']
        if self._read_only:
            raise web.HTTPForbidden(text='this page only shows: --read-only')
        if not self.guard.knows_token(request.headers.get('Authorization', '')):
            raise web.HTTPForbidden(text='open the address that the command printed')
        if request.content_type != 'application/json':
            raise web.HTTPUnsupportedMediaType(text='JSON is taken')
        try:
            value = json.loads(await request.read())
            json.dumps(value, ensure_ascii=False).encode()  # texts that are none: half a pair
        except (ValueError, RecursionError, web.RequestPayloadError):
            raise web.HTTPBadRequest(text='not JSON') from None
        try:
            if action == STOP:
                answer = await self._stop()
            elif not self.guard.has_time():
                raise web.HTTPTooManyRequests(text='too many requests')
            else:
                answer = await self._source.act(action, value)
        except RefusedError as refused:
            return web.json_response({'done': False, 'answer': str(refused)}, status=409)
        except ParallelRobotError as error:
            return web.json_response({'done': False, 'answer': str(error)}, status=409)
        except KeyError:
            raise web.HTTPNotFound(text='no such action') from None
        return web.json_response({'done': True, 'answer': answer})

    async def _stop(self) -> str:
        """Stop the robot; many requests at once are one, and no flood keeps it off."""
        if self._stopping is None or self._stopping.done():
            self._stopping = asyncio.create_task(self._source.act(STOP, None))
        return await asyncio.shield(self._stopping)


# The socket of the page, and the loop that serves it until the user ends it.

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
    make = partial(HttpProtocol, manager, loop=loop, **words)
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
        for number in termination_signals():
            loop.add_signal_handler(number, ended.set)
        await ended.wait()
