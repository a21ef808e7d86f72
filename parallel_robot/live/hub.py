"""What all browsers share: the newest frames and texts. Whoever is slow gets the newest alone."""

from __future__ import annotations

import asyncio
import json
from collections import deque
from typing import Any, Protocol

from parallel_robot.live.frames import HEADER

BACKLOG = 450  # frames that a browser gets when it begins: 15 s


class Socket(Protocol):
    """What is needed of a WebSocket; both wait while the browser does not read."""

    async def send_str(self, data: str) -> None:
        """Send a text."""

    async def send_bytes(self, data: bytes) -> None:
        """Send bytes."""


class Hub:
    """Keeps what is shown, and passes it on to any number of browsers."""

    def __init__(self) -> None:
        """Begin with nothing."""
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

    async def pass_on(self, socket: Socket) -> None:
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
