"""What is said of a request that is none: one line to whoever sent it, few to the user."""

from __future__ import annotations

import asyncio
import logging
import time
from typing import Any

from aiohttp import web

from parallel_robot_model.common.errors import first_line, printable

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
