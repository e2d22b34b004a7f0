"""The simulated robot of a kind in a rehearsal: MuJoCo, the real firmware, and the real proxy.

Its physics advance with virtual time, 5 ms at once, as fast as the processor allows. Frames go over a cable
that takes 1 ms each way. The proxy is a process that can be killed or frozen; the controller goes on.
"""

from __future__ import annotations

import asyncio
import random
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from robotree.protocol.endpoint import Endpoint
from robotree.protocol.errors import LinkBroken, LinkError, LinkRefused
from robotree.proxy.agent import running_proxy
from robotree.proxy.kinds import KINDS as PROXIES
from robotree.sim.firmware import COMPONENT, SILENCE
from robotree.sim.kinds import KINDS as SIMULATED
from robotree.testing.cable import Cable
from robotree.testing.parts import Part, Stage
from robotree.vr.author.command import commands_of

if TYPE_CHECKING:
    from robotree.protocol.frame import Frame
    from robotree.protocol.links.link import Accept, Link
    from robotree.sim.firmware import Outgoing
    from robotree.vr.world.world import SimulatedProcess

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
