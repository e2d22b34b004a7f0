"""The controller's socket: several connections, each answered where it asked, none forwarded to another.

The loop carries frames, the cell's own thread computes (`realtime`), one more thread draws (`render_thread`).
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
from robotree.protocol.links.security import UNSIGNED, LinkSecurity
from robotree.protocol.links.url import listen
from robotree.protocol.messages import MavSeverity
from robotree.sim.controller.controller import Controller
from robotree.sim.controller.fence_file import FenceFile
from robotree.sim.errors import CannotListen
from robotree.sim.firmware import SILENCE, Outgoing
from robotree.sim.kinds import kind as kind_of
from robotree.sim.serving.connection import MAX_REFUSED_BYTES, Connection, RefusedClient
from robotree.sim.serving.realtime import Pace, RealTime
from robotree.sim.serving.render_thread import RenderThread
from robotree.sim.serving.throttle import BURST, PIECE, RESTOCK, STORE, TOTAL, Throttled, TokenBucket

_log = logging.getLogger(__name__)

MAX_CLIENTS: Final = 32
"""Clients that are served at a time; each costs processor time for its telemetry."""
SILENT_AFTER: Final = 3.0
"""[s] of silence after which a client may lose its place: three heartbeats."""
MAX_REFUSED: Final = 32
"""Refused clients at a time; beyond that, links are closed without a message."""
SWITCH: Final = 0.001
"""[s] after which a thread that computes lets another one go on. CPython's own 5 ms are a whole batch of the
physics, which would be late whenever the loop has much to read."""
SYSTEM: Final = 1
"""MAVLink system id that ground stations expect of the first robot on a link."""


class Server:
    """A controller on the wire. Made by `serving`."""

    def __init__(self, controller: Controller, speedup: float, security: LinkSecurity = UNSIGNED) -> None:
        self._controller, self._security = controller, security
        self._loop = asyncio.get_running_loop()
        self._connections: dict[Endpoint, Connection] = {}
        self._refused_clients: dict[Endpoint, RefusedClient] = {}
        self._garbled = self._lost = 0
        self._store = TokenBucket(STORE, self._loop.time())
        self._render_thread = RenderThread(controller)
        self.address = ""
        """Where it listens, with the port that was really taken."""
        self.rotations = 0
        """Keys that were changed over the wire."""
        self.unsaid: Counter[str] = Counter()
        """Messages that could not be sent, by their kind; the first of each is logged."""
        self.failure: asyncio.Future[None] = self._loop.create_future()
        """Gets the error that ended the physics, if one did."""
        self._realtime = RealTime(controller, self._tell, self._fail, speedup)

    @property
    def pace(self) -> Pace:
        """How real time is kept."""
        return self._realtime.pace

    def accept(self, link: Link) -> Handler:
        """Serve a new client.

        Where `MAX_CLIENTS` are served already, the one that has been silent for the longest time makes
        room: at once if it never spoke, else after `SILENT_AFTER`. Where all speak, the newcomer is told so
        and sent away; only its stops are heard.
        """
        if len(self._connections) >= MAX_CLIENTS and not self._make_room():
            return self._refuse(link)
        connection = Connection(
            link,
            self._controller.firmware.system,
            self._controller,
            self._render_thread,
            self._left,
            self._rotated,
            self._security,
        )
        self._connections[connection.endpoint] = connection
        stops, burst = lambda: self._controller.stops, self._at_once(BURST)
        return Throttled(link, connection, self._share, stops, self._lose, burst)

    def _make_room(self) -> bool:
        """Whether the client with the longest silence could be removed."""
        silent = min(self._connections.values(), key=lambda each: each.heard)
        if self._loop.time() - silent.heard < SILENT_AFTER:
            return False
        del self._connections[silent.endpoint]
        silent.refuse("Somebody else came, and you said nothing; send a heartbeat at once and every second.")
        return True

    def _refuse(self, link: Link) -> Handler:
        """Refuse a new client."""
        system = self._controller.firmware.system
        word = max(round(self._at_once(MAX_REFUSED_BYTES)), PIECE)
        refused = RefusedClient(link, system, self._controller, self._forget, word, self._security)
        self._refused_clients[refused.endpoint] = refused
        if len(self._refused_clients) > MAX_REFUSED:
            self._lost += 1
            link.close()
        else:
            refused.say(f"{MAX_CLIENTS} clients are served already; end one of them.")
        return refused

    def _forget(self, refused: RefusedClient) -> None:
        del self._refused_clients[refused.endpoint]

    def _share(self) -> float:
        """[bytes/s] that one of the clients may send for long."""
        return TOTAL / max(len(self._connections), 1)

    def _at_once(self, most: float) -> float:
        """[bytes] that a new link may bring at once."""
        return self._store.take(most, RESTOCK, self._loop.time())

    def close(self) -> None:
        """End the threads."""
        self._realtime.close()
        self._render_thread.close()

    def _lose(self) -> None:
        self._lost += 1

    def _left(self, connection: Connection) -> None:
        self._connections.pop(connection.endpoint, None)
        self._garbled += connection.garbled

    def _rotated(self, by: Connection, system: int) -> None:
        """The key was changed: other clients are told under the old key, and need the new one from now on.

        The client that changed it is told under the new key, and so knows that it is in force.
        """
        self.rotations += 1
        text = f"The signing key was changed by system {system}."
        link = by.endpoint.link
        _log.warning("controller %s: %s (%s)", link.controller, text[:-1].lower(), link.address)
        for each in [*self._connections.values()]:
            if each is not by:
                each.say(MavSeverity.NOTICE, text)
            each.set_signer_pair()
        by.say(MavSeverity.NOTICE, text)

    def _tell(self, out: list[Outgoing]) -> None:
        self._loop.call_soon_threadsafe(self._deliver, out)

    def _deliver(self, out: list[Outgoing]) -> None:
        now = sum(connection.garbled for connection in self._connections.values())
        gauges = self._controller.firmware.gauges
        gauges.garbled, gauges.lost = self._garbled + now, self._lost
        for outgoing in out:
            if outgoing.via is None:
                for connection in [*self._connections.values()]:  # a client may leave because of it
                    self._say(outgoing, connection)
            elif isinstance(outgoing.via, Endpoint):
                receiver = self._connections.get(outgoing.via) or self._refused_clients.get(outgoing.via)
                if receiver is not None:
                    self._say(outgoing, receiver)

    def _say(self, outgoing: Outgoing, receiver: Connection | RefusedClient) -> None:
        """Send one message to one client; a failure does not stop the messages to the others."""
        try:
            receiver.send(outgoing)
        except Exception:  # noqa: BLE001  outermost handler of a batch; the other clients still get theirs
            kind = type(outgoing.message).__name__
            if kind not in self.unsaid:  # telemetry would say it fifty times in a second
                _log.exception("%s could not be told to %s", kind, receiver.endpoint.link.address)
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
    speedup: float = 1.0,
    exposed: bool = False,
    security: LinkSecurity = UNSIGNED,
    memory: FenceFile | None = None,
) -> AsyncGenerator[Server]:
    """A simulated controller that is up inside the block.

    Args:
        kind: of robot, one of `kinds.KINDS`.
        url: where to listen, as `tcp:127.0.0.1:5760`; port 0 takes a free one.
        system: MAVLink system id.
        silence: of the link after which the robot holds by itself [s of the clock on the wall].
        speedup: seconds of the world in a second; 1 is real time.
        exposed: allow an address that other machines reach.
        security: the keys of our links.
        memory: what it knows of its earlier lives; None: nothing, and it keeps nothing.

    Yields:
        The server; `address` is where it listens.

    Raises:
        UnknownKind: no such robot can be simulated.
        CannotListen: the port is taken.
        BadUrl: the address means nothing, or can be reached from outside.
    """
    server = Server(kind_of(kind).build(system, silence * speedup, memory), speedup, security)
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
    speedup: float = 1.0,
    security: LinkSecurity = UNSIGNED,
    memory: FenceFile | None = None,
) -> None:
    """Simulate a controller until cancelled.

    Args:
        kind: of robot, one of `kinds.KINDS`.
        url: where to listen, as `tcp:127.0.0.1:5760`; port 0 takes a free one.
        ready: told the address once it listens there.
        speedup: seconds of the world in a second; 1 is real time.
        security: the keys of our links.
        memory: what it knows of its earlier lives; None: nothing, and it keeps nothing.

    Raises:
        UnknownKind: no such robot can be simulated.
        CannotListen: the port is taken.
        BadUrl: the address means nothing, or can be reached from outside.
    """
    sys.setswitchinterval(SWITCH)
    async with serving(kind, url, speedup=speedup, security=security, memory=memory) as server:
        ready(server.address)
        await server.failure
