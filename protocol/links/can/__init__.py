"""MAVLink over CAN: `can:INTERFACE/CHANNEL?node=1&fd=1&…`, for every interface of python-can.

MAVLink frames travel as ISO-TP payloads (`robotree.protocol.isotp`) under identifiers with the node numbers
of both ends (`identifiers`). A controller listens and has a link with each host; a host connects to one
controller. Many of both share a bus.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotree.protocol.errors import BadUrl
from robotree.protocol.links.can.address import CanAddress, Telemetry, read
from robotree.protocol.links.can.host import connect
from robotree.protocol.links.can.link import CanLink
from robotree.protocol.links.can.listener import CanListener, listen

if TYPE_CHECKING:
    from robotree.protocol.links.link import Accept, Link, Listener
    from robotree.protocol.links.url import Url

__all__ = [
    "CanAddress",
    "CanLink",
    "CanListener",
    "Telemetry",
    "connect",
    "connect_url",
    "listen",
    "listen_url",
]

NETWORKED = frozenset({"socketcand", "udp_multicast"})
"""Interfaces whose frames cross a network."""


async def connect_url(url: Url, accept: Accept) -> Link:
    """`can:INTERFACE/CHANNEL?node=…`."""
    return await connect(read(url), accept)


async def listen_url(url: Url, accept: Accept, *, exposed: bool) -> Listener:
    """`can:INTERFACE/CHANNEL?node=…`."""
    address = read(url)
    if address.interface in NETWORKED and not exposed:
        raise BadUrl(
            url.text, f"{address.interface} can be reached from outside; use an interface of this machine"
        )
    return await listen(address, accept)
