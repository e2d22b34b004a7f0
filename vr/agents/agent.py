"""The agent of one robot: answers for it, keeps its bonds, tells the others how it is.

Everything here runs on the event loop and never waits for an author's code. A request that only concerns
leases, stops or descriptions is answered when it comes, whatever the robot is doing.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable

from robotree.vr.agents.agent_requests import AgentRequests
from robotree.vr.agents.bonds import BondKeeper
from robotree.vr.agents.call_counter import CallCounter
from robotree.vr.agents.commands import CommandDesk
from robotree.vr.agents.lease import LeaseKeeper
from robotree.vr.agents.listed import Listed, Listings
from robotree.vr.agents.portrait import Portrait
from robotree.vr.agents.state_news import StateNews
from robotree.vr.description import RobotDescription
from robotree.vr.errors import VrError
from robotree.vr.exchange.answering import conversing
from robotree.vr.exchange.claim import claim, new_address
from robotree.vr.lease import DEFAULT_TERM, Lessor, Tenure
from robotree.vr.robot import Robot
from robotree.vr.running.execution import LONGEST_END
from robotree.vr.space.contract import Space
from robotree.vr.transport import Registration, Transport
from robotree.vr.virtual_robot import VirtualRobot

PARTING = 0.5
"""[s] in which commands may end by themselves when their robot's process ends; the others end with it."""

_log = logging.getLogger(__name__)


class RobotAgent:
    """One incarnation of a robot among the agents."""

    def __init__(
        self,
        robot: Robot,
        transport: Transport,
        *,
        registrar: Listings | None = None,
        host: str = "",
        space: Space | None = None,
        term: float = DEFAULT_TERM,
        unix: Callable[[], float] = time.time,
        obeyed: Callable[[], int | None] = lambda: None,
    ) -> None:
        """Make the agent, on the event loop; `start` lets it live.

        Args:
            robot: what it answers for.
            transport: the way to the others.
            registrar: where it is listed while nobody has enslaved it.
            host: name of the process, for people.
            space: where calls are counted over incarnations.
            term: [s] of leases, those it grants and those it asks for.
            unix: returns seconds since 1970; epochs come from it.
            obeyed: returns the epoch that what stands behind the robot obeys, None before it was heard: its
                own go above the first.

        Raises:
            TypeError: the robot's class declares a command in a way that cannot be called from afar.
        """
        self.robot, self.transport = robot, transport
        self.address = new_address("robot", robot.name)
        self.closed = asyncio.Event()
        """Set when it has ended, whoever ended it."""
        self.open = False
        """Whether it takes anything new."""
        self._loop = asyncio.get_running_loop()
        lessor = Lessor(robot.name, term=term, unix=unix())
        self._lease = LeaseKeeper(lessor, transport, unix=unix, obeyed=obeyed, on_end=self._freed)
        self._calls = CallCounter(space, robot.name)
        self._home = f"host {host}" if host else f"the process of {robot.name}"
        self._desk = CommandDesk(
            robot, self._lease, transport, on_change=self.changed, on_call=self._calls.count, home=self._home
        )
        self._bonds: BondKeeper | None = None
        if isinstance(robot, VirtualRobot):
            slots = robot.child_slots
            self._bonds = self._desk.bonds = BondKeeper(
                self.address, slots, transport, lineage=self.lineage, on_change=self.changed, term=term
            )
        self._portrait = Portrait(robot, self.address, host, self._lease, self._desk, self._calls)
        self._listed = Listed(registrar, self.address)
        self._news = StateNews(transport, self.address.key, self._portrait.state)
        self._declared: list[Registration] = []
        self._presence: Registration | None = None
        self._publishing: asyncio.Task[None] | None = None
        self._ending: asyncio.Task[None] | None = None
        self._gone: asyncio.Future[None] = self._loop.create_future()
        self._last_words: list[Callable[[str], None]] = []
        self._requests = AgentRequests(robot, self, self._lease, self._desk, self._portrait)

    # -- life -------------------------------------------------------------------------------------

    async def start(self) -> None:
        """Serve requests, then be present, then enter the lookup.

        Raises:
            DuplicateName: a living robot has this name.
            TransportError: the transport does not work.
        """
        await self._calls.recall()
        self.open = True
        try:
            handler = conversing(self._requests.answer, self.robot.name)
            self._declared.append(await self.transport.serve(self.address.key, handler))
            self._declared.append(await self.transport.watch_itself(self._cut_off))
            self._presence = await claim(self.transport, self.address)
        except BaseException:
            self.open = False
            await self._withdraw()
            raise
        self._publishing = self._loop.create_task(self._news.run())
        self.changed()

    async def listed(self) -> None:
        """Wait until the lookup services know what they should, or as many of them as answer."""
        await self._listed.settled()

    async def close(self) -> None:
        """End politely: release the children, leave the lookup, be gone. Twice is once."""
        await asyncio.shield(self._begin_to_end(PARTING))

    @property
    def gone(self) -> bool:
        """Whether it has ended for everybody else; it may still be tidying up."""
        return self._gone.done()

    @property
    def abandoned(self) -> tuple[str, ...]:
        """Return the commands that were ended and whose code still runs, also after the robot's own end."""
        return self._desk.jobs.abandoned

    def _begin_to_end(self, grace: float) -> asyncio.Task[None]:
        """End once, whoever asks how often, and whether or not they wait for it."""
        if self._ending is None:
            self._ending = self._loop.create_task(self._end(grace))
        return self._ending

    async def _end(self, grace: float) -> None:
        try:
            await self._let_go(grace)
        finally:
            left = self._left_behind()
            for say in self._last_words:  # while the way to whoever asked is still open
                say(left)
            self._gone.set_result(None)
            self._lease.close()
            self._desk.callers.close()
            if self._publishing is not None:
                self._publishing.cancel()
                await asyncio.wait([self._publishing])
            await self._withdraw()
            self.closed.set()

    async def _let_go(self, grace: float) -> None:
        """Tell the children, the lookup services and everybody else; take nothing more."""
        self.open = False
        self._desk.jobs.cancel_all(f"{self.robot.name} is being ended")
        await self._desk.jobs.settled(grace)
        if self._bonds is not None:
            await self._bonds.close()
        self._listed.want(None)
        await self._listed.settled()
        if self._presence is not None:
            with contextlib.suppress(VrError):
                await self._presence.close()

    async def _withdraw(self) -> None:
        for registration in (self._presence, *reversed(self._declared)):
            if registration is not None:
                with contextlib.suppress(VrError):
                    await registration.close()

    def notify(self) -> None:
        """Take note that the robot has changed: reachable or not, halted, its attributes. From any thread."""
        halted = self.robot.halted  # as it is now: a stop that ends soon has been one, too
        with contextlib.suppress(RuntimeError):  # the loop is closed: nobody wants to know
            self._loop.call_soon_threadsafe(self._robot_changed, halted)

    def description(self) -> RobotDescription:
        """Describe the robot as it is now."""
        return self._portrait.description()

    def _robot_changed(self, halted: str) -> None:
        self._desk.take_halt(halted)
        self.changed()

    def changed(self) -> None:
        """See `Life.changed`."""
        if self.open and self._publishing is not None:
            self._news.changed()
            self._listed.want(self._portrait.listing())

    def lineage(self) -> tuple[str, ...]:
        """See `Life.lineage`."""
        tenure = self._lease.tenure
        return (*(() if tenure is None else tenure.lineage), self.robot.name)

    def lineage_changed(self) -> None:
        """See `Life.lineage_changed`."""
        if self._bonds is not None:
            self._bonds.hurry()
        self.changed()

    def _cut_off(self, reason: str) -> None:
        """End all motion when nobody could end it any more: no stop would reach the robot."""
        if reason:
            _log.warning("%s ends its commands: %s", self.robot.name, reason)
            self._desk.jobs.cancel_all(reason)

    def _freed(self, tenure: Tenure, reason: str) -> None:
        _log.info("%s is free again: %s", self.robot.name, reason)
        self._desk.jobs.cancel_all(f"the bond with {tenure.parent.name}.{tenure.slot} is over: {reason}")
        self.lineage_changed()

    async def delete(self, last_words: Callable[[str], None]) -> None:
        """See `Life.delete`."""
        self._last_words.append(last_words)
        self._begin_to_end(LONGEST_END + PARTING)
        await asyncio.shield(self._gone)

    def _left_behind(self) -> str:
        running = ", ".join(self._desk.jobs.abandoned)
        return running and f"its {running} heeds no cancel and still runs; restart {self._home}"
