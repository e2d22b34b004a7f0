"""Who is let in at the port: the names under which it is asked, where a page came from, and tokens.

Pure. Any web page can make a browser ask any address, so three things are examined. `Host` must be a name of
this place: a foreign name that was turned to 127.0.0.1 (DNS rebinding) is none. `Origin`, which browsers put
on every WebSocket and no page can change, must be our own page. And whoever is there must know the token,
which is behind the `#` of the address: browsers keep that to themselves, so it is in no request and no log.
"""

from __future__ import annotations

import hmac
from dataclasses import dataclass, field
from urllib.parse import urlsplit

from robotree.tui.errors import ValueRefused

LOOPBACK = frozenset({"127.0.0.1", "localhost", "[::1]"})
"""Names of this machine for itself, as browsers write them."""


def host_of(header: str) -> str:
    """Return the name in a `Host` header, without its port."""
    name, _, port = header.lower().rpartition(":")
    return name if name and port.isdecimal() else header.lower()


def origin_of(given: str) -> str:
    """Return an origin, as browsers write it.

    Args:
        given: by a person, such as `https://robots.example`.

    Raises:
        ValueRefused: it is none.
    """
    parts = urlsplit(given.strip().lower())
    if parts.scheme not in {"http", "https"} or not parts.hostname or parts.path.strip("/") or parts.query:
        raise ValueRefused("ORIGIN", f"{given!r} is none; write for example https://robots.example")
    return f"{parts.scheme}://{parts.netloc}"


@dataclass(frozen=True)
class Door:
    """What is let in."""

    command: str
    """The token of those who command robots."""
    watch: str
    """The token of those who only look."""
    origins: frozenset[str] = frozenset()
    """Pages besides our own on loopback: that of a proxy which is in front of us."""
    scheme: str = "http"
    hosts: frozenset[str] = field(default=LOOPBACK)
    """Names under which this place is asked directly."""

    def stranger(self, host: str) -> str:
        """Return why nobody is served under a name; empty: it is one of ours."""
        name = host_of(host)
        if name in self.hosts or any(host.lower() == urlsplit(one).netloc for one in self.origins):
            return ""
        return f"this place is not called {host[:80]!r}; open the address that `robotree web` printed"

    def foreign(self, origin: str, host: str) -> str:
        """Return why a page may not connect; empty: it is ours.

        Args:
            origin: of the page, as its browser says.
            host: under which it asks.
        """
        if origin in self.origins or (origin == f"{self.scheme}://{host}" and host_of(host) in self.hosts):
            return ""
        whose = origin[:80] or "nowhere"
        return f"pages of {whose} may not connect; open the address that `robotree web` printed"

    def right(self, token: str) -> str:
        """Return what a token opens: `command`, `watch`; empty: nothing."""
        given = token.encode()
        command = hmac.compare_digest(given, self.command.encode())
        watch = hmac.compare_digest(given, self.watch.encode())
        return "command" if command else "watch" if watch else ""
