"""Names of links before they are open, so that their keys can be looked up in time.

An address that a person types is not always the name of the link: a host may have a name, and the links of a
listener are named by the far end and its port.
"""

from __future__ import annotations

import socket
from contextlib import suppress

import msgspec

from robotree.protocol.links.can.identifiers import HOSTS
from robotree.protocol.links.sockets import name
from robotree.protocol.links.url import Url, parse

ANY_PORT = (1024, 34567, 65535)
"""Ports of which some partner of a listener may speak: a pattern for all has to match these."""
ANY_HOST = (HOSTS[0], HOSTS[-1])
"""The same, numbers of hosts on a CAN bus."""


def names(text: str, *, listening: bool) -> list[str]:
    """The names that links of an address have, or may have.

    Args:
        text: the address, as it is handed to `connect` or `listen`.
        listening: whether it is for `listen`.

    Returns:
        Link addresses: of a listener samples of all that may come, else those of which one will be it. Empty:
        the host has no address, so there will be no link.

    Raises:
        BadUrl: the address means nothing.
    """
    url = parse(text)
    if url.scheme == "serial":
        from robotree.protocol.links.serial import read

        return [str(read(url))]
    if url.scheme == "can":
        return _on_a_bus(url, listening=listening)
    return _of_sockets(url, listening=listening)


def _on_a_bus(url: Url, *, listening: bool) -> list[str]:
    from robotree.protocol.links.can.address import read

    address = read(url)
    if not listening:
        return [str(address)]
    return [str(msgspec.structs.replace(address, host=host, fd=True)) for host in ANY_HOST]


def _of_sockets(url: Url, *, listening: bool) -> list[str]:
    host, port = url.host_and_port()
    if url.scheme == "udp" and not listening:
        return [name(url.scheme, (host, port))]
    found: list[str] = []
    with suppress(OSError):
        all_found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        found = list(dict.fromkeys(str(one[4][0]) for one in all_found))
    ports = ANY_PORT if listening else (port,)
    return [name(url.scheme, (one, each)) for one in found for each in ports]
