"""Going onto a bus: which kind of port its interface needs."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import can

from robotree.protocol.errors import LinkRefused
from robotree.protocol.links.can.direct import DirectPort
from robotree.protocol.links.can.threaded import ThreadedPort
from robotree.protocol.links.in_thread import opened

if TYPE_CHECKING:
    from robotree.protocol.links.can.address import CanAddress
    from robotree.protocol.links.can.port import Port

DIRECT = frozenset({"robotree", "socketcan", "udp_multicast"})
"""Interfaces with a descriptor to watch, whose `send` does not wait. All others get two threads."""


async def open_port(address: CanAddress) -> Port:
    """Go onto a bus.

    Raises:
        LinkRefused: the interface does not exist, or the bus cannot be had.
    """
    open_bus: Callable[..., can.BusABC] = can.Bus
    try:
        bus = await opened(
            partial(open_bus, interface=address.interface, channel=address.channel, **address.bus_options),
            lambda bus: bus.shutdown(),
        )
    except (can.CanError, OSError, ValueError, TypeError, ImportError) as error:
        raise LinkRefused(str(address), str(error) or type(error).__name__) from error
    kind = DirectPort if address.interface in DIRECT else ThreadedPort
    return kind(bus, fd=address.fd)
