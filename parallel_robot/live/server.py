"""The web server: the page, one stream of frames to each browser, and what a browser may ask."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator, Awaitable, Callable

from aiohttp import WSMsgType, web

from parallel_robot.live.connections import Connections
from parallel_robot.live.guard import Guard
from parallel_robot.live.hub import Hub
from parallel_robot.live.page import files
from parallel_robot.live.source import RefusedError, Source
from parallel_robot_model.common.errors import ParallelRobotError

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
    """Serves one source.

    Attributes:
        guard: Who may ask for what.
        connections: What is held open.
    """

    def __init__(self, source: Source, host: str, read_only: bool = False) -> None:
        """Prepare.

        Args:
            source: What is shown.
            host: Name or address that the server listens on.
            read_only: Whether nothing can be changed by the page.
        """
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
