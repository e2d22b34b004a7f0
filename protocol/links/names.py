"""Names of controllers before their links are open, so that their keys can be looked up in time.

An address that a person types is not always the name of its controller: a host may have a name, and a
listener may take any port that is free.
"""

from __future__ import annotations

import socket
from contextlib import suppress

from robotree.protocol.links.sockets import name
from robotree.protocol.links.url import parse

ANY_PORT = (1024, 34567, 65535)
"""Ports of which a listener may take some when it is told to take any."""


def names(text: str) -> list[str]:
    """The names that the controller at an address has, or may have; see `Link.controller`.

    Args:
        text: the address, as it is handed to `connect` or `listen`.

    Returns:
        One of these will be its name. Empty: the host has no address, so there will be no link.

    Raises:
        BadUrl: the address means nothing.
    """
    url = parse(text)
    if url.controller:
        return [url.controller]
    if url.scheme == "serial":
        from robotree.protocol.links import serial

        return [str(serial.read(url))]
    if url.scheme == "can":
        from robotree.protocol.links.can import address

        return [str(address.read(url)).partition("&")[0]]
    host, port = url.host_and_port()
    found: list[str] = []
    with suppress(OSError):
        all_found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        found = list(dict.fromkeys(str(one[4][0]) for one in all_found))
    return [name(url.scheme, (one, each)) for one in found for each in ((port,) if port else ANY_PORT)]
