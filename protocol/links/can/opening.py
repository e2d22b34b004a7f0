"""Going onto a bus: which kind of port its interface needs."""

from __future__ import annotations

import errno
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

KERNEL = "socketcan"
"""The interface of the kernel's own CAN."""
_WITHOUT = "or use can:robotree/CHANNEL between programs of this machine, which needs none"
_ADVICE = {
    errno.EAFNOSUPPORT: f"this machine's kernel has no CAN; load it (modprobe can_raw), {_WITHOUT}",
    errno.ENODEV: "this machine has no interface {channel}; plug in its adapter, see its name in ip link, "
    f"{_WITHOUT}",
    errno.ENETDOWN: "{channel} is down; bring it up (ip link set {channel} up type can bitrate BITRATE)",
}
"""Why the kernel's CAN cannot be opened, and what to do."""


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
        raise LinkRefused(str(address), _cause(address, error)) from error
    kind = DirectPort if address.interface in DIRECT else ThreadedPort
    return kind(bus, fd=address.fd)


def _cause(address: CanAddress, error: Exception) -> str:
    """Why a bus cannot be had: as a sentence where python-can has only the system's number for it."""
    if address.interface == KERNEL and isinstance(error, OSError) and error.errno in _ADVICE:
        return _ADVICE[error.errno].format(channel=address.channel)
    return str(error) or type(error).__name__
