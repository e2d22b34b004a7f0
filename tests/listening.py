"""Where processes listen, as the kernel lists it (proc_pid_net(5))."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from ipaddress import IPv4Address, IPv6Address
from pathlib import Path
from typing import NamedTuple

import psutil

LISTEN, BOUND = "0A", "07"
"""States of a socket: TCP_LISTEN, and TCP_CLOSE, which is that of each datagram socket without a peer."""


class Listening(NamedTuple):
    """One socket to which others can say something."""

    process: int
    protocol: str
    address: IPv4Address | IPv6Address
    port: int


def listening(processes: Iterable[int]) -> list[Listening]:
    """Return the sockets on which these processes, and all that they have started, listen."""
    found = list[Listening]()
    for process in processes:
        family = [psutil.Process(process), *psutil.Process(process).children(recursive=True)]
        for one in family:
            found += _of(one.pid)
    return found


def _of(process: int) -> Iterable[Listening]:
    held = set[str]()
    with contextlib.suppress(FileNotFoundError):
        for descriptor in Path(f"/proc/{process}/fd").iterdir():
            with contextlib.suppress(OSError):
                held.add(str(descriptor.readlink()))
    for protocol in ("tcp", "tcp6", "udp", "udp6", "udplite", "raw", "raw6"):
        with contextlib.suppress(FileNotFoundError):
            for line in Path(f"/proc/{process}/net/{protocol}").read_text().splitlines()[1:]:
                fields = line.split()
                state = LISTEN if protocol.startswith("tcp") else BOUND
                if f"socket:[{fields[9]}]" in held and fields[3] == state:
                    address, port = fields[1].split(":")
                    yield Listening(process, protocol, _address(address), int(port, 16))


def _address(text: str) -> IPv4Address | IPv6Address:
    """Read an address: words of 32 bits, each in the byte order of this machine."""
    words = [bytes.fromhex(text[begin : begin + 8])[::-1] for begin in range(0, len(text), 8)]
    packed = b"".join(words)
    return IPv4Address(packed) if len(packed) == 4 else IPv6Address(packed)
