"""A cable between a proxy and its controller, in the virtual time of a World: late, or cut."""

from __future__ import annotations

import zlib
from collections import deque
from collections.abc import Callable, Hashable
from functools import partial
from typing import Protocol

from robotree.protocol.errors import LinkClosed, LinkError
from robotree.protocol.links.link import Handler, LinkStatistics, Unsent, encoded
from robotree.vr.world.world import SimulatedProcess, World


class Socket(Protocol):
    """Where a cable is plugged in at the controller."""

    name: str
    delay: float
    """[s] that each frame takes."""
    jitter: float
    """[s] that a frame takes longer at most."""


class CableEnd:
    """One end of a cable: a `Link`."""

    congested = False

    def __init__(self, cable: Cable, name: str, soon: Callable[..., object]) -> None:
        """Made by `Cable`; `soon` calls the handler back where that may be done."""
        self.address, self.controller = f"cable:{name}", "cable:"
        self.handler: Handler | None = None
        self.other: CableEnd | None = None
        self.gone = False
        """Whether nobody is there any more, and nobody was told."""
        self.last = 0.0
        """[s] When what was sent last arrives at the other end."""
        self.under_way: deque[list[bytes]] = deque()
        """The frames that have not arrived there, by piece."""
        self._cable, self._soon = cable, soon
        self._sent = self._received = 0

    @property
    def statistics(self) -> LinkStatistics:
        return LinkStatistics(sent=self._sent, received=self._received, waiting=0, superseded=0, dropped=0)

    def send(self, frame: bytes | Unsent, topic: Hashable | None = None) -> None:
        del topic
        data = encoded(frame)
        self._sent += len(data)
        if self.other is not None:
            self._cable.carry(data, self, self.other)

    def close(self) -> None:
        self._cable.end(LinkClosed(self.address, by_us=True), self)

    def take(self, data: bytes) -> None:
        """Hand over what has arrived."""
        self._received += len(data)
        if self.handler is not None and not self.gone:
            self._soon(self._hand_over, data)

    def _hand_over(self, data: bytes) -> None:
        if self.handler is not None:  # it may have ended meanwhile
            self.handler.received(data)

    def finish(self, reason: LinkError) -> None:
        """Say that it has ended."""
        handler, self.handler = self.handler, None
        if handler is not None and not self.gone:
            self._soon(handler.closed, reason)


def _at_once(action: Callable[..., object], *values: object) -> None:
    action(*values)


class Cable:
    """See the module; `near` is the proxy's end, `far` the controller's."""

    def __init__(self, world: World, socket: Socket, process: SimulatedProcess) -> None:
        """Lay it.

        Args:
            world: whose time it takes.
            socket: at the controller.
            process: of the proxy; when that is gone, the controller's end closes.
        """
        self._world, self._socket = world, socket
        self.open = True
        self.near = CableEnd(self, f"{socket.name} to its proxy", process.loop.take)
        self.far = CableEnd(self, f"{socket.name} from its proxy", _at_once)
        self.near.other, self.far.other = self.far, self.near

        def leave() -> None:
            self.near.gone = True
            if not process.vanished:
                self.end(LinkClosed(self.near.address, by_us=True), self.near)

        process.on_exit.append(leave)

    def carry(self, data: bytes, source: CableEnd, target: CableEnd) -> None:
        """Bring a frame to the other end, after those before it; frames of one moment arrive as one piece."""
        if not self.open:
            return
        world, socket = self._world, self._socket
        jitter = socket.jitter * world.network.chance() if socket.jitter else 0.0
        when = world.runner.now() + (socket.delay + jitter)
        if when <= source.last and source.under_way:
            source.under_way[-1].append(data)
            return
        source.last = when = max(when, source.last)
        source.under_way.append([data])
        world.runner.at(when, partial(self._arrive, source.under_way, target))

    def _arrive(self, under_way: deque[list[bytes]], target: CableEnd) -> None:
        piece = b"".join(under_way.popleft())
        if self.open:
            self._world.note(target.address, "frames", zlib.crc32(piece))
            target.take(piece)

    def end(self, reason: LinkError, mine: CableEnd | None = None) -> None:
        """End it: for the end that closes it at once, for the other one when what is under way has come."""
        if not self.open:
            return
        if mine is None:
            self.open = False
            self.near.finish(reason)
            self.far.finish(reason)
            return
        other = self.far if mine is self.near else self.near
        mine.finish(reason)
        when = max(self._world.runner.now() + self._socket.delay, mine.last)

        def told() -> None:
            self.open = False
            other.finish(LinkClosed(other.address, by_us=False))

        self._world.runner.at(when, told)
