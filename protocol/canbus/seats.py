"""Where the members of a bus find each other: a channel is a row of ports on 127.0.0.1. Pure.

A member takes the first free port of the row as its seat. The system frees the seat of a process that ends,
however it ends, so the row is a directory that cannot go stale and needs nobody to keep it.

>>> first_port(5770), first_port("5770")
(5770, 5770)
>>> first_port("arm") == first_port("arm"), first_port("arm") == first_port("rover")
(True, False)

There are fewer rows than names, so two named channels can share a row. They stay two channels: a greeting
carries `channel_id`, and a member refuses the greeting of another channel.
"""

from __future__ import annotations

from zlib import crc32

HOST = "127.0.0.1"
SEATS = 32
"""Members of one bus, at most."""
DEFAULT = "robotree"
"""The channel of those who name none."""
_NAMED = range(17000, 32000, SEATS)
"""First ports of channels that have a name: below the ports that systems hand out by themselves."""


def first_port(channel: int | str) -> int:
    """The first port of a channel's row.

    Args:
        channel: a port, as a number or in digits, or a name.

    Raises:
        ValueError: the row would leave the range of ports.
    """
    text = str(channel)
    if not (text.isascii() and text.isdigit()):
        return _NAMED[crc32(text.encode()) % len(_NAMED)]
    port = int(text)
    if not 1024 <= port <= 65536 - SEATS:
        raise ValueError(f"channel {port} is no port from 1024 to {65536 - SEATS}; choose one, or a name")
    return port


def channel_id(channel: int | str) -> int:
    """Return the number that identifies a channel in its row: its port, or the CRC-32 of its name.

    Args:
        channel: a port, as a number or in digits, or a name.

    Returns:
        A number below 2^32.
    """
    text = str(channel)
    return int(text) if text.isascii() and text.isdigit() else crc32(text.encode())
