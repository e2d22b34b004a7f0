"""A process that speaks to a mesh by hand: the test decides which bytes it sends, and when."""

from __future__ import annotations

import os
import socket
from collections.abc import Sequence
from pathlib import Path

from robotree.vr.network.link import VERSION, Channel, Hello, LinkFrame, Topic, pack
from robotree.vr.network.rendezvous import Rendezvous

SOON = 60.0
"""[s] that a test waits at most for what should come at once."""


def descriptors() -> int:
    """Return how many this process has."""
    return len(list(Path("/proc/self/fd").iterdir()))


class Visitor:
    """Dials a member of a realm and listens nowhere itself, as a lean stop does."""

    def __init__(self, place: Rendezvous, member: str, *, tag: str | None = None) -> None:
        self.place, self.member = place, member
        self.tag = f"{os.getpid()}-{os.urandom(4).hex()}" if tag is None else tag
        self.lines: dict[Channel, socket.socket] = {}

    def dial(self, channel: Channel) -> socket.socket:
        line = self.lines[channel] = self.place.dial(self.member)
        line.setblocking(True)
        line.settimeout(SOON)
        return line

    def greet(self, *holds: str, subscribes: Sequence[str] = ()) -> None:
        """Say hello on both channels."""
        for channel in Channel:
            urgent = channel is Channel.URGENT
            known = {Topic.HOLDS: list(holds), Topic.SUBSCRIBES: list(subscribes)} if urgent else {}
            self.dial(channel)
            self.say(channel, Hello(VERSION, self.tag, channel, known))

    def say(self, channel: Channel, *frames: LinkFrame) -> None:
        self.lines[channel].sendall(b"".join(map(pack, frames)))

    def is_cut_off(self, channel: Channel) -> bool:
        """Whether the far end closes this connection within `SOON`."""
        try:
            while self.lines[channel].recv(1 << 16):
                pass
        except ConnectionError:
            return True
        except TimeoutError:
            return False
        return True

    def is_cut_off_now(self, channel: Channel) -> bool:
        """Whether the far end has closed this connection within a moment."""
        self.lines[channel].settimeout(0.5)
        return self.is_cut_off(channel)

    def close(self) -> None:
        for line in self.lines.values():
            line.close()
        self.lines.clear()
