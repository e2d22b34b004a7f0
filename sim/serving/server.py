"""The controller's socket: several connections, each answered where it asked, none forwarded to another.

The loop carries frames, the cell's own thread computes (`realtime`), one more thread draws (`darkroom`).
"""

import asyncio
import logging
import sys
from collections import Counter
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from typing import Final

from robotree.protocol.endpoint import Endpoint
from robotree.protocol.errors import LinkRefused
from robotree.protocol.links.link import Handler, Link
from robotree.protocol.links.security import UNSIGNED, Sealing
from robotree.protocol.links.url import listen
from robotree.protocol.messages import MavSeverity
from robotree.sim.errors import CannotListen
from robotree.sim.firmware import SILENCE, Outgoing
from robotree.sim.kinds import kind as kind_of
from robotree.sim.serving.allowance import Allowance
from robotree.sim.serving.bystander import LARGEST_WORD, Bystander
from robotree.sim.serving.connection import Connection
from robotree.sim.serving.controller import Controller
from robotree.sim.serving.darkroom import Darkroom
from robotree.sim.serving.fence_file import FenceFile
from robotree.sim.serving.realtime import Pace, RealTime
from robotree.sim.serving.throttle import BURST, PIECE, RESTOCK, STORE, TOTAL, Throttled

_log = logging.getLogger(__name__)

LARGEST_CROWD: Final = 32
"""Clients that are served at a time; each costs its telemetry."""
LINGER: Final = 3.0
"""[s] that a silent client keeps a place that another one needs: three heartbeats missed."""
LARGEST_ROW: Final = 32
"""Bystanders at a time; who comes when there are as many is not even told."""
SWITCH: Final = 0.001
"""[s] after which a thread that computes lets another one go on. CPython's own 5 ms are a whole batch of the
physics, which would be late whenever the loop has much to read."""
SYSTEM: Final = 1
"""MAVLink system id that ground stations expect of the first robot on a link."""


class Server:
    """A controller on the wire. Made by `serving`."""

    def __init__(self, controller: Controller, hurry: float, security: Sealing = UNSIGNED) -> None:
        self._controller, self._security = controller, security
        self._loop = asyncio.get_running_loop()
        self._connections: dict[Endpoint, Connection] = {}
        self._bystanders: dict[Endpoint, Bystander] = {}
        self._garbled = self._lost = 0
        self._store = Allowance(STORE, self._loop.time())
        self._darkroom = Darkroom(controller)
        self.address = ""
        """Where it listens, with the port that was really taken."""
        self.rotations = 0
        """Keys that were changed over the wire."""
        self.unsaid: Counter[str] = Counter()
        """What could not be said, by the kind of message; the first of each is logged."""
        self.failure: asyncio.Future[None] = self._loop.create_future()
        """Raises what ended the physics, if something does."""
        self._realtime = RealTime(controller, self._tell, self._fail, hurry)

    @property
    def pace(self) -> Pace:
        """How real time is kept."""
        return self._realtime.pace

    def accept(self, link: Link) -> Handler:
        """A client has come.

        Where `LARGEST_CROWD` are served already, the one that has been silent for the longest time makes
        room: at once if it never spoke, else after `LINGER`. Where all speak, the newcomer is told so and
        sent away; only its stops are heard.
        """
        if len(self._connections) >= LARGEST_CROWD and not self._make_room():
            return self._turn_away(link)
        connection = Connection(
            link,
            self._controller.firmware.system,
            self._controller,
            self._darkroom,
            self._left,
            self._rotated,
            self._security,
        )
        self._connections[connection.endpoint] = connection
        stops, burst = lambda: self._controller.stops, self._at_once(BURST)
        return Throttled(link, connection, self._share, stops, self._lose, burst)

    def _make_room(self) -> bool:
        """Whether who has been silent for the longest time has made room."""
        silent = min(self._connections.values(), key=lambda each: each.heard)
        if self._loop.time() - silent.heard < LINGER:
            return False
        del self._connections[silent.endpoint]
        silent.refuse("Somebody else came, and you said nothing; send a heartbeat at once and every second.")
        return True

    def _turn_away(self, link: Link) -> Handler:
        """Refuse a newcomer."""
        system = self._controller.firmware.system
        word = max(round(self._at_once(LARGEST_WORD)), PIECE)
        bystander = Bystander(link, system, self._controller, self._forget, word, self._security)
        self._bystanders[bystander.endpoint] = bystander
        if len(self._bystanders) > LARGEST_ROW:
            self._lost += 1
            link.close()
        else:
            bystander.say(f"{LARGEST_CROWD} clients are served already; end one of them.")
        return bystander

    def _forget(self, bystander: Bystander) -> None:
        del self._bystanders[bystander.endpoint]

    def _share(self) -> float:
        """[bytes/s] that one of the clients may send for long."""
        return TOTAL / max(len(self._connections), 1)

    def _at_once(self, most: float) -> float:
        """[bytes] that a new link may bring at once."""
        return self._store.take(most, RESTOCK, self._loop.time())

    def close(self) -> None:
        """End the threads."""
        self._realtime.close()
        self._darkroom.close()

    def _lose(self) -> None:
        self._lost += 1

    def _left(self, connection: Connection) -> None:
        self._connections.pop(connection.endpoint, None)
        self._garbled += connection.garbled

    def _rotated(self, by: Connection, pattern: str, system: int) -> None:
        """A key was changed: all who had it are told so with it, and need the new one from now on.

        Who changed it is told with the new one, and so knows that it is obeyed.
        """
        self.rotations += 1
        text = f"The signing key was changed by system {system}."
        _log.warning("links %s: %s (%s)", pattern, text[:-1].lower(), by.endpoint.link.address)
        for each in [*self._connections.values()]:
            if each.pattern == pattern:
                if each is not by:
                    each.say(MavSeverity.NOTICE, text)
                each.reseal()
        by.say(MavSeverity.NOTICE, text)

    def _tell(self, out: list[Outgoing]) -> None:
        self._loop.call_soon_threadsafe(self._deliver, out)

    def _deliver(self, out: list[Outgoing]) -> None:
        now = sum(connection.garbled for connection in self._connections.values())
        gauges = self._controller.firmware.gauges
        gauges.garbled, gauges.lost = self._garbled + now, self._lost
        for outgoing in out:
            if outgoing.via is None:
                for connection in [*self._connections.values()]:  # one that is told may leave at once
                    self._say(outgoing, connection)
            elif isinstance(outgoing.via, Endpoint):
                hearer = self._connections.get(outgoing.via) or self._bystanders.get(outgoing.via)
                if hearer is not None:
                    self._say(outgoing, hearer)

    def _say(self, outgoing: Outgoing, hearer: Connection | Bystander) -> None:
        """Tell one client one thing; where that fails, the others are told theirs nevertheless."""
        try:
            hearer.send(outgoing)
        except Exception:  # noqa: BLE001  the batch's last fence: acknowledgements are in it, too
            kind = type(outgoing.message).__name__
            if kind not in self.unsaid:  # telemetry would say it fifty times in a second
                _log.exception("%s could not be told to %s", kind, hearer.endpoint.link.address)
            self.unsaid[kind] += 1

    def _fail(self, error: Exception) -> None:
        self._loop.call_soon_threadsafe(self._break, error)

    def _break(self, error: Exception) -> None:
        if not self.failure.done():
            self.failure.set_exception(error)


@asynccontextmanager
async def serving(
    kind: str,
    url: str,
    *,
    system: int = SYSTEM,
    silence: float = SILENCE,
    hurry: float = 1.0,
    exposed: bool = False,
    security: Sealing = UNSIGNED,
    memory: FenceFile | None = None,
) -> AsyncGenerator[Server]:
    """A simulated controller that is up inside the block.

    Args:
        kind: of robot, one of `kinds.KINDS`.
        url: where to listen, as `tcp:127.0.0.1:5760`; port 0 takes a free one.
        system: MAVLink system id.
        silence: of the link after which the robot holds by itself [s].
        hurry: seconds of the world in a second; 1 is real time.
        exposed: allow an address that other machines reach.
        security: the keys of our links.
        memory: what it knows of its earlier lives; None: nothing, and it keeps nothing.

    Yields:
        The server; `address` tells where it really listens.

    Raises:
        UnknownKind: no such robot can be simulated.
        CannotListen: the port is taken.
        BadUrl: the address means nothing, or can be reached from outside.
    """
    server = Server(kind_of(kind).build(system, silence, memory), hurry, security)
    try:
        try:
            listener = await listen(url, server.accept, exposed=exposed)
        except LinkRefused as error:
            raise CannotListen(url, error.cause) from error
        server.address = listener.address
        try:
            yield server
        finally:
            await listener.close()
    finally:
        server.close()
        if memory is not None:
            memory.close()


async def serve(
    kind: str,
    url: str,
    *,
    ready: Callable[[str], None],
    security: Sealing = UNSIGNED,
    memory: FenceFile | None = None,
) -> None:
    """Simulate a controller until cancelled.

    Args:
        kind: of robot, one of `kinds.KINDS`.
        url: where to listen, as `tcp:127.0.0.1:5760`; port 0 takes a free one.
        ready: told the address once it listens there.
        security: the keys of our links.
        memory: what it knows of its earlier lives; None: nothing, and it keeps nothing.

    Raises:
        UnknownKind: no such robot can be simulated.
        CannotListen: the port is taken.
        BadUrl: the address means nothing, or can be reached from outside.
    """
    sys.setswitchinterval(SWITCH)
    async with serving(kind, url, security=security, memory=memory) as server:
        ready(server.address)
        await server.failure
