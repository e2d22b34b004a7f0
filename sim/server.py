"""The controller's socket: several connections, each answered where it asked, none forwarded to another.

The loop carries frames; the cell's own thread computes (`realtime`); one more thread draws pictures, so
neither the arm nor the answers wait for them. Each connection has at most one picture in the making; of
further requests the newest per camera waits, and pieces go out no faster than the connection reads them.
"""

import asyncio
import logging
import sys
from collections.abc import AsyncGenerator, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from typing import Final

from robotree.protocol.endpoint import Endpoint
from robotree.protocol.errors import LinkError, LinkRefused
from robotree.protocol.frame import Frame
from robotree.protocol.links.link import Handler, Link
from robotree.protocol.links.security import UNSIGNED, Sealing
from robotree.protocol.links.url import listen
from robotree.protocol.messages import MavSeverity, PictureRequest, SetupSigning
from robotree.protocol.services.picture import split
from robotree.protocol.services.statustext import Speaker
from robotree.sim.camera import Studio, fit, jpeg
from robotree.sim.controller import Controller
from robotree.sim.errors import CannotListen
from robotree.sim.firmware import COMPONENT, SILENCE, Outgoing
from robotree.sim.kinds import kind as kind_of
from robotree.sim.realtime import Pace, RealTime
from robotree.sim.throttle import TOTAL, Throttled

_log = logging.getLogger(__name__)

LARGEST_CROWD: Final = 32
"""Clients that are served at a time; each costs its telemetry."""
SWITCH: Final = 0.001
"""[s] after which a thread that computes lets another one go on. CPython's own 5 ms are a whole batch of the
physics, which would be late whenever the loop has much to read."""
KEY_REFUSED: Final = "Keys are not taken over the wire; give the controller a key file, and start it again."
SYSTEM: Final = 1
"""MAVLink system id that ground stations expect of the first robot on a link."""


WINDOW: Final = 2048
"""Bytes that may wait for a client before a piece of a picture waits, too: so a slow line delays what else is
said by no more than these."""
BREATH: Final = 0.005
"""Between two looks whether they still wait [s]."""


class Darkroom:
    """Draws pictures in a thread of its own, one after the other.

    Args:
        controller: whose cell and cameras.
    """

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._studio = Studio(controller.cell.model)
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="darkroom")

    async def develop(self, request: PictureRequest) -> tuple[bytes, int, int]:
        """The JPEG that was asked for, its width and its height [px]."""
        return await asyncio.get_running_loop().run_in_executor(self._thread, self._draw, request)

    def close(self) -> None:
        """End the thread when its picture is done."""
        self._thread.shutdown(wait=False, cancel_futures=True)

    def _draw(self, request: PictureRequest) -> tuple[bytes, int, int]:
        width, height = fit(request.width, request.height)
        camera = self._controller.cameras[request.target_component]
        picture = self._studio.picture(self._controller.cell.published, camera, width, height)
        return jpeg(picture, request.quality), width, height


class Connection:
    """One client: what it says goes to the controller, the pictures it asks for come back.

    Args:
        link: to the client.
        system: our MAVLink system id.
        controller: hears the client.
        darkroom: draws for it.
        leave: told when the client has gone.
        security: signs what we say, and decides whom we hear.
    """

    def __init__(
        self,
        link: Link,
        system: int,
        controller: Controller,
        darkroom: Darkroom,
        leave: Callable[["Connection"], None],
        security: Sealing = UNSIGNED,
    ) -> None:
        self.endpoint = Endpoint(
            link,
            system=system,
            component=COMPONENT,
            on_frame=self._hear,
            on_closed=self._closed,
            **security.seals(link.address),
        )
        self._controller, self._darkroom, self._leave = controller, darkroom, leave
        self.spoken = False
        """Whether an intact frame has come."""
        self._wanted: dict[int, PictureRequest] = {}
        self._drawing: asyncio.Task[None] | None = None
        self._key_refused = False
        controller.greet(self.endpoint)

    @property
    def garbled(self) -> int:
        """What this client said in vain: no frame, no message that we know, or not signed as it must be."""
        heard = self.endpoint.statistics
        return heard.bad_crc + heard.unknown + heard.incompatible + heard.refused

    def send(self, outgoing: Outgoing) -> None:
        """Say something to this client."""
        self.endpoint.send(outgoing.message, telemetry=outgoing.telemetry, instance=outgoing.instance)

    def refuse(self, text: str) -> None:
        """Tell the client why it is not served (any more), and end the link."""
        for chunk in Speaker().say(MavSeverity.ERROR, text):
            self.endpoint.send(chunk)
        self.endpoint.link.close()

    def _hear(self, frame: Frame) -> None:
        self.spoken = True
        message = frame.message
        if isinstance(message, SetupSigning):
            self._refuse_key()
            return
        if not isinstance(message, PictureRequest):
            self._controller.post(frame, self.endpoint)
            return
        ours = (
            message.target_system == self.endpoint.system
            and message.target_component in self._controller.cameras
        )
        if ours:
            self._wanted[message.target_component] = message
            if self._drawing is None:
                self._drawing = asyncio.create_task(
                    self._draw_wanted(), name=f"pictures for {self.endpoint.link.address}"
                )

    def _refuse_key(self) -> None:
        """A key that comes over the wire is never taken: any program of this machine could lock us out.

        Said once, and neither logged nor passed on.
        """
        if not self._key_refused:
            self._key_refused = True
            for chunk in Speaker().say(MavSeverity.WARNING, KEY_REFUSED):
                self.endpoint.send(chunk)

    async def _draw_wanted(self) -> None:
        try:
            while self._wanted:
                await self._room()
                request = self._wanted.pop(next(iter(self._wanted)))
                data, width, height = await self._darkroom.develop(request)
                for message in split(data, width=width, height=height, quality=request.quality):
                    await self._room()
                    self.endpoint.send(message, component=request.target_component)
        finally:
            self._drawing = None

    async def _room(self) -> None:
        """Wait until a piece of a picture would leave soon. What else is said goes in between."""
        while self.endpoint.link.statistics.waiting > WINDOW:  # noqa: ASYNC110  links do not tell
            await asyncio.sleep(BREATH)

    def _closed(self, _: LinkError) -> None:
        if self._drawing is not None:
            self._drawing.cancel()
        self._controller.leave(self.endpoint)
        self._leave(self)
        if refused := self.endpoint.statistics.refused:
            _log.warning(
                "%s: %d frames were refused, for they were not signed with our key",
                self.endpoint.link.address,
                refused,
            )


class Server:
    """A controller on the wire. Made by `serving`."""

    def __init__(self, controller: Controller, hurry: float, security: Sealing = UNSIGNED) -> None:
        self._controller, self._security = controller, security
        self._loop = asyncio.get_running_loop()
        self._connections: dict[Endpoint, Connection] = {}
        self._garbled = 0
        self._darkroom = Darkroom(controller)
        self.address = ""
        """Where it listens, with the port that was really taken."""
        self.failure: asyncio.Future[None] = self._loop.create_future()
        """Raises what ended the physics, if something does."""
        self._realtime = RealTime(controller, self._tell, self._fail, hurry)

    @property
    def pace(self) -> Pace:
        """How real time is kept."""
        return self._realtime.pace

    def accept(self, link: Link) -> Handler:
        """A client has come.

        Where `LARGEST_CROWD` are served already, the one that has been silent from the beginning for the
        longest time makes room; where all have spoken, the newcomer is told so and sent away.
        """
        silent = next((each for each in self._connections.values() if not each.spoken), None)
        full = len(self._connections) >= LARGEST_CROWD
        if full and silent is not None:
            del self._connections[silent.endpoint]
            silent.refuse("Somebody else came, and you have said nothing; send a heartbeat at once.")
        connection = Connection(
            link,
            self._controller.firmware.system,
            self._controller,
            self._darkroom,
            self._left,
            self._security,
        )
        if full and silent is None:
            connection.refuse(f"{LARGEST_CROWD} clients are served already; end one of them.")
        else:
            self._connections[connection.endpoint] = connection
        return Throttled(link, connection.endpoint, self._share)

    def _share(self) -> float:
        """[bytes/s] that one of the clients may send for long."""
        return TOTAL / max(len(self._connections), 1)

    def close(self) -> None:
        """End the threads."""
        self._realtime.close()
        self._darkroom.close()

    def _left(self, connection: Connection) -> None:
        self._connections.pop(connection.endpoint, None)
        self._garbled += connection.garbled

    def _tell(self, out: list[Outgoing]) -> None:
        self._loop.call_soon_threadsafe(self._deliver, out)

    def _deliver(self, out: list[Outgoing]) -> None:
        now = sum(connection.garbled for connection in self._connections.values())
        self._controller.firmware.gauges.garbled = self._garbled + now
        for outgoing in out:
            if outgoing.via is None:
                for connection in self._connections.values():
                    connection.send(outgoing)
            elif isinstance(outgoing.via, Endpoint) and outgoing.via in self._connections:
                self._connections[outgoing.via].send(outgoing)

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

    Yields:
        The server; `address` tells where it really listens.

    Raises:
        UnknownKind: no such robot can be simulated.
        CannotListen: the port is taken.
        BadUrl: the address means nothing, or can be reached from outside.
    """
    server = Server(kind_of(kind).build(system, silence), hurry, security)
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


async def serve(
    kind: str,
    url: str,
    *,
    ready: Callable[[str], None],
    system: int = SYSTEM,
    silence: float = SILENCE,
    hurry: float = 1.0,
    exposed: bool = False,
    security: Sealing = UNSIGNED,
) -> None:
    """Simulate a controller until cancelled.

    Args:
        kind: of robot, one of `kinds.KINDS`.
        url: where to listen, as `tcp:127.0.0.1:5760`; port 0 takes a free one.
        ready: told the address once it listens there.
        system: MAVLink system id.
        silence: of the link after which the robot holds by itself [s].
        hurry: seconds of the world in a second; 1 is real time.
        exposed: allow an address that other machines reach.
        security: the keys of our links.

    Raises:
        UnknownKind: no such robot can be simulated.
        CannotListen: the port is taken.
        BadUrl: the address means nothing, or can be reached from outside.
    """
    sys.setswitchinterval(SWITCH)
    async with serving(
        kind, url, system=system, silence=silence, hurry=hurry, exposed=exposed, security=security
    ) as server:
        ready(server.address)
        await server.failure
