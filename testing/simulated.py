"""The simulated robot of a kind in a rehearsal: MuJoCo, the real firmware, and the real proxy.

Its physics advance with virtual time, 5 ms at once, as fast as the processor allows. Frames go over a cable
that takes 1 ms each way. The proxy is a process that can be killed or frozen; the controller goes on.
"""

from __future__ import annotations

import asyncio
import random
import zlib
from collections import deque
from collections.abc import Callable, Hashable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

from robotree.protocol.endpoint import Endpoint
from robotree.protocol.errors import LinkBroken, LinkClosed, LinkError, LinkRefused
from robotree.protocol.links.link import Handler, LinkStatistics, Unsent, encoded
from robotree.proxy.agent import running_proxy
from robotree.proxy.kinds import KINDS as PROXIES
from robotree.sim.firmware import COMPONENT, SILENCE
from robotree.sim.kinds import KINDS as SIMULATED
from robotree.testing.parts import Part, Stage
from robotree.vr.author.command import commands_of
from robotree.vr.world.world import SimulatedProcess, World

if TYPE_CHECKING:
    from robotree.protocol.frame import Frame
    from robotree.protocol.links.link import Accept, Link
    from robotree.sim.firmware import Outgoing

BATCH = 0.005
"""[s] of a batch of the physics."""
POLL = 0.01
"""[s] between two looks at whether the proxy is online."""


class Simulated(Part):
    """A simulated robot; made by `cell`."""

    def __init__(self, kind: str) -> None:
        """Choose the kind; the world is built when a rehearsal begins.

        Raises:
            ValueError: there is no such kind with one controller and one robot.
        """
        super().__init__()
        known = sorted(SIMULATED.keys() & PROXIES.keys())
        if kind not in known:
            raise ValueError(f"there is no simulated robot {kind!r}; there is: {', '.join(known)}")
        self.kind = kind
        self.delay, self.jitter = 0.001, 0.0
        """[s] that a frame takes between proxy and controller, and how much longer at most."""
        self.name = kind
        self.world: Any = None
        """The simulated world: `sim.arm.world.ArmWorld` and the like, with the truth that no sensor shows."""
        self._team: Stage
        self._cables: list[Cable] = []
        self._endpoints: list[Endpoint] = []
        self._plugged = True

    def known_commands(self) -> Sequence[str]:
        return tuple(commands_of(PROXIES[self.kind]))

    def cut(self) -> None:
        """Break the cable; a new one cannot be had until `mend`."""
        self._plugged = False
        cables, self._cables = self._cables, []
        for cable in cables:
            cable.end(LinkBroken(self.name, "the cable was cut"))

    def mend(self) -> None:
        """Let the proxy lay a new cable."""
        self._plugged = True

    def enter(self, team: Stage, path: str, name: str) -> None:
        self._team, self.name = team, name
        self._cables, self._endpoints, self._plugged = [], [], True
        kind = SIMULATED[self.kind]
        self.world = kind.world()
        self._controller = kind.controller(self.world, 1, SILENCE)
        self._began = team.now
        self._advance()
        self.start_proxy(path)

    def start_proxy(self, path: str) -> None:
        """Start the process of its proxy; again, if it was lost: the controller has gone on without it."""
        team, name = self._team, self.name

        async def live(process: SimulatedProcess) -> None:
            robot = PROXIES[self.kind](
                name,
                f"tcp:{name}:5760",
                dial=lambda url, accept: self._dial(url, accept, process),
                chance=random.Random(f"{team.world.seed} {name}"),
                runner=process.runner,
            )
            threads = team.threads(process)
            async with running_proxy(robot, process.transport, process=threads) as agent:
                while not robot.online:  # noqa: ASYNC110 # the frames of the controller make it so
                    await asyncio.sleep(POLL)
                team.lives(path, agent)
                await agent.closed.wait()

        team.start_process(path, live)

    # -- the controller ---------------------------------------------------------------------------

    def _advance(self) -> None:
        """Let the physics go on for one batch, and say what the controller has to say; then again."""
        for outgoing in self._controller.advance():
            self._tell(outgoing)
        self._team.world.runner.at(self._began + self._controller.cell.time_ms / 1000, self._advance)

    def _tell(self, outgoing: Outgoing) -> None:
        for endpoint in list(self._endpoints):
            if outgoing.via is None or outgoing.via is endpoint:
                endpoint.send(
                    outgoing.message,
                    component=outgoing.component,
                    telemetry=outgoing.telemetry,
                    instance=outgoing.instance,
                )

    async def _dial(self, url: str, accept: Accept, process: SimulatedProcess) -> Link:
        """Open a link to the controller; see `proxy.connection.Dial`.

        Raises:
            LinkRefused: the cable is cut.
        """
        if not self._plugged:
            raise LinkRefused(url, "the cable is cut")
        cable = Cable(self._team.world, self, process)
        self._cables.append(cable)
        controller, endpoints = self._controller, self._endpoints

        def hear(frame: Frame) -> None:
            controller.post(frame, endpoint)

        def closed(_: LinkError) -> None:
            endpoints.remove(endpoint)
            controller.leave(endpoint)

        endpoint = Endpoint(cable.far, system=1, component=COMPONENT, on_frame=hear, on_closed=closed)
        endpoints.append(endpoint)
        cable.far.handler = endpoint
        controller.greet(endpoint)
        cable.near.handler = accept(cable.near)
        return cable.near


# -- the cable between proxy and controller: late, or cut --------------------------------------------


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
    """A cable in the virtual time of a World; `near` is the proxy's end, `far` the controller's."""

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
