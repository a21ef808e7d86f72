"""Who may ask for what: checks of a request before anything is done with it."""

from __future__ import annotations

import ipaddress
import secrets
import time
from collections.abc import Callable

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
