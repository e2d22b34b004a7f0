"""Robots that move between hosts: what a host does for those that leave it and for those that come.

`core/transfer.py` decides, the journals keep what it has decided, and this carries it out. The address of the
robot stays, so whoever has it finds the robot again: the transport asks the process with the highest number
of moves, and the destination is present before the source is gone.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Coroutine
from typing import Any, NamedTuple, Protocol

import msgspec
from msgspec.structs import replace

from robotree.vr.agents.agent import RobotAgent
from robotree.vr.agents.shared import Beside, loop_now
from robotree.vr.agents.unfit import unfit_reasons
from robotree.vr.author.virtual_robot import VirtualRobot
from robotree.vr.base.address import Address, everyone, parted
from robotree.vr.base.chance import token
from robotree.vr.base.envelope import same_clock, this_clock
from robotree.vr.base.errors import (
    CannotMove,
    DuplicateName,
    HostFull,
    HostReserved,
    NoSuchBundle,
    NoSuchHost,
    NoSuchRobot,
    NoSuchSite,
    NotDrained,
    VrError,
)
from robotree.vr.base.places import Places, here_of
from robotree.vr.base.principal import ITSELF, Principal
from robotree.vr.base.requests import (
    Accepted,
    AskMove,
    Create,
    DescribeHost,
    Done,
    HostDescribed,
    MoveDecided,
    MoveReady,
    PrepareMove,
    Progress,
    Reply,
    TakeRobot,
)
from robotree.vr.base.transport import Transport
from robotree.vr.bundle.admission import Clearance
from robotree.vr.bundle.bundle import bundle_of
from robotree.vr.core import transfer as of
from robotree.vr.core.machine import RobotState, decode_state, encode_state
from robotree.vr.exchange.asking import ask
from robotree.vr.exchange.claim import SETTLE
from robotree.vr.exchange.client import LOADING
from robotree.vr.exchange.dispatcher import SendReply
from robotree.vr.isolation.apart import KeptApart, RobotApart
from robotree.vr.isolation.pipe import Parcel
from robotree.vr.journal.journal import HostJournal
from robotree.vr.journal.records import KeptPage, MovedOut
from robotree.vr.journal.recovery import see_from, welcome
from robotree.vr.running.process import Process

STAND_WITHIN = 1.0
"""[s] for the code of a robot to come to a wait; a page that computes for longer does not move now."""
LOOK = 0.0005
"""[s] between two looks whether it has."""
ANSWERED_WITHIN = 3.0
"""[s] for the destination to take a robot, or to say what became of it, before it is asked once more."""
SLOWEST = 20_000.0
"""[bytes/s] of a line to another site, at least, for a robot to move over it."""
SEEN_WITHIN = 2.0
"""[s] for the news to come that a robot is at another site, before it is here no longer."""
ASK_AGAIN = 0.2
"""[s] before it is asked once more."""
KEEPS = 5
"""How often in the term of a lease the children of a robot on its way are asked to prolong it."""
AT_ONCE = 8
"""Robots of a host that carry something out and move at the same time when all leave it: each pauses longer
for the others."""
IDLE_AT_ONCE = 32
"""Robots that carry nothing out, likewise: nobody waits for them, and their moves mostly wait."""
PREPARED_FOR = 60.0
"""[s] for which a destination waits for a robot."""
LONGEST_PARCEL = 16 << 20
"""[bytes] of the state of a robot that moves."""

_log = logging.getLogger(__name__)


class LoadedPage(NamedTuple):
    """The page of a robot that may come, and how it runs here."""

    robot: VirtualRobot | RobotApart
    """The robot; in a process of its own: that, which has loaded the page."""
    clearance: Clearance
    page: KeptPage


class Expected(NamedTuple):
    """A robot that may come."""

    source: str
    """Key of the host that sends it."""
    name: str
    loaded: LoadedPage


class MovingHost(Protocol):
    """A host, as its moves know it."""

    address: Address
    agents: dict[str, RobotAgent]

    async def load(
        self, sent: Create, name: str, asker: Principal, *, sender: str = "", children: tuple[str, ...] = ()
    ) -> LoadedPage:
        """Load the page of a robot that another host is about to send, where it is to run."""
        ...

    async def settle_in(
        self, robot: VirtualRobot, clearance: Clearance, state: RobotState, page: KeptPage
    ) -> RobotAgent:
        """Have a robot that has come serve and be present; its commands do not go on yet."""
        ...

    async def migrate_apart(self, robot: str, host: str, asker: Principal = ITSELF) -> Reply | None:
        """Have a robot in a process of its own move; None: there is none of that name."""
        ...

    async def stop_apart(self, robot: Address, reason: str, order: str) -> None:
        """Have such a robot obey a stop that came while it was on its way."""
        ...

    def note_move(self, agent: RobotAgent, text: str, person: str) -> None:
        """Keep that a robot has moved, or not; `person`: who wanted it."""
        ...

    def reserve(self, name: str) -> None:
        """Give a name to nobody else.

        Raises:
            DuplicateName: somebody has it.
            HostReserved: the host runs another robot alone.
            HostFull: it has no room.
        """
        ...

    def release(self, name: str) -> None:
        """Give it again."""
        ...

    def forget(self, agent: RobotAgent) -> None:
        """Have a robot no longer that has left."""
        ...

    def description(self) -> HostDescribed:
        """Say which robots live here."""
        ...


class Moves:
    """All moves of one host. Lives on the event loop."""

    def __init__(
        self, host: MovingHost, transport: Transport, process: Process, journal: HostJournal | None
    ) -> None:
        """Begin without any.

        Args:
            host: whose robots move.
            transport: the way to the other hosts.
            process: whose threads carry its robots' commands out.
            journal: of the process; None: no robot moves from or to it.
        """
        self._host, self._transport, self._process, self._journal = host, transport, process, journal
        self.key, self.name = host.address.key, host.address.name
        """Of the host."""
        self.leaving: dict[str, Departure] = {}
        """The robots that are on their way, by name."""
        self._expected: dict[str, Expected] = {}
        """The robots that may come, by transfer."""
        self._one: dict[str, asyncio.Lock] = {}
        self._begun = Beside()
        self.keep = self._begun.begin
        """Has something done beside everything else."""

    @staticmethod
    def moment(place: str) -> None:
        """Pass a boundary of a move: a test may end the process here."""

    # -- leaving ----------------------------------------------------------------------------------

    async def migrate(self, robot: str, host: str, asker: Principal = ITSELF) -> Reply:
        """Have a robot go on in another host; returns when it does.

        Args:
            robot: its name.
            host: name of the other host, `SITE:NAME` at another site.
            asker: who wants it.

        Raises:
            NoSuchRobot: it is not here.
            NoSuchHost: that host is not there.
            CannotMove: it stays here; the error says why.
        """
        agent = self._host.agents.get(robot)
        here, whole = self._host.address.name, self._whole_name(robot, host)
        if whole == here and (agent is not None or robot in self._apart()):
            return Done(note=f"{robot} is in {here} already")
        if agent is None and (reply := await self._host.migrate_apart(robot, whole, asker)) is not None:
            return reply
        if agent is None or agent.gone:
            raise NoSuchRobot(name=robot)
        host = whole
        if robot in self.leaving:
            raise self._refusal(robot, host, f"it is on its way to {self.leaving[robot].target}")
        if self._journal is None:
            raise self._refusal(robot, host, f"{here} keeps nothing of its robots (it has no journal)")
        departure = Departure(self, agent, host, self._transport, self._journal, asker=asker)
        self.leaving[robot] = departure
        try:
            reason = await departure.run()
        except VrError as error:
            self._note_refusal(agent, host, asker, str(error))
            raise
        finally:
            self._ended(robot, departure)
        if reason:
            self._note_refusal(agent, host, asker, reason)
            raise self._refusal(robot, host, reason)
        by = f" for {asker.person}" if asker.person else ""
        _log.info("%s has moved to %s%s", robot, host, by)
        return Done(
            note=f"{robot} has moved from {here} to {host}; it paused for {departure.paused * 1e3:.1f} ms"
        )

    def _note_refusal(self, agent: RobotAgent, host: str, asker: Principal, reason: str) -> None:
        by = f" for {asker.person}" if asker.person else ""
        text = f"it did not move to {host}{by}: {reason}"
        agent.runtime.log.say("warning", text)
        self._host.note_move(agent, text, asker.person)

    def _whole_name(self, robot: str, host: str) -> str:
        """Return the name of a host that is there, with its site if that is another one.

        Raises:
            NoSuchHost: it is not there.
            CannotMove: there are several.
        """
        site, name = parted(host)
        places = Places(self._transport.presence)
        if site:
            keys = places.at("host", site, name)
            if not keys and site not in (places.own, *places.sites()):
                raise NoSuchSite.among(site, places.sites())
            sites = {places.site_of(key) for key in keys}
        else:
            keys = self._transport.presence.keys(everyone("host", name))
            sites = {places.site_of(key) for key in keys}
            sites = {""} if "" in sites else sites
        if not sites:
            raise NoSuchHost(name=host)
        if len(sites) > 1:
            among = " or ".join(f"{one}:{name}" for one in sorted(sites))
            raise self._refusal(robot, host, f"several sites have such a host: say {among}")
        (found,) = sites
        return f"{found}:{name}" if found else name

    async def drain(self, send: SendReply) -> Done:
        """Have all robots go on in other hosts, those that carry something out first.

        Args:
            send: tells who waits of each that has moved.

        Raises:
            NotDrained: some have not moved; the error says why.
        """
        send(Accepted(key=""))
        agents = {agent.robot.name: agent for agent in sorted(self._host.agents.values(), key=_urgency)}
        robots = [*agents, *sorted(self._apart())]
        hosts = await self._others()
        here, moved, reasons = self._host.address.name, list[str](), list[str]()
        busy, idle, counts = asyncio.Semaphore(AT_ONCE), asyncio.Semaphore(IDLE_AT_ONCE), dict(hosts)

        async def move(name: str) -> None:
            async with idle if name in agents and _urgency(agents[name])[0] else busy:
                if not counts:
                    reasons.append(f"{name}: no other host keeps its robots and takes any")
                    return
                target = min(counts, key=lambda host: (counts[host], host))
                counts[target] += 1
                try:
                    await self.migrate(name, target)
                except NoSuchRobot:  # it has ended meanwhile
                    return
                except VrError as error:
                    reasons.append(str(error))
                    return
            moved.append(name)
            send(Progress(key="", fraction=len(moved) / len(robots), text=f"{name} has moved to {target}"))

        await asyncio.gather(*map(move, robots))
        if reasons:
            raise NotDrained(host=here, reasons="; ".join(sorted(reasons)))
        return Done(confirmed=tuple(moved))

    def _apart(self) -> set[str]:
        """Return the names of the robots of the host that live in processes of their own."""
        return {robot.name for robot in self._host.description().robots} - self._host.agents.keys()

    async def _others(self) -> dict[str, int]:
        """Return the other hosts that take robots, with how many they have."""
        presence = self._transport.presence
        keys = [key for key in here_of(presence, presence.keys(everyone("host", "*"))) if key != self.key]
        asked = (
            ask(self._transport, key, DescribeHost(), HostDescribed, timeout=ANSWERED_WITHIN) for key in keys
        )
        found = await asyncio.gather(*asked, return_exceptions=True)
        return {
            one.address.name: len(one.robots)
            for one in found
            if isinstance(one, HostDescribed) and one.takes_robots
        }

    def find_out(self, agent: RobotAgent, out: MovedOut) -> None:
        """Ask what became of a robot that was on its way when the process before ended, until it is known."""
        assert self._journal is not None  # noqa: S101 # it has told of the move
        departure = Departure(self, agent, out.host, self._transport, self._journal, out)
        here = self._host.address.name
        text = f"{here} ended while it was on its way to {out.host}: nobody acts for it until that is known"
        self._host.note_move(agent, text, "")
        self.leaving[agent.robot.name] = departure
        self.keep(self._find_out(departure, agent))

    async def _find_out(self, departure: Departure, agent: RobotAgent) -> None:
        began = self._process.runner.now()
        try:
            reason = await departure.run()
        finally:
            self._ended(agent.robot.name, departure)
        what = f"it is here: {reason}" if reason else f"it is in {departure.target}"
        seconds = self._process.runner.now() - began
        self._host.note_move(agent, f"after {seconds:.1f} s it is known that {what}", "")

    def _ended(self, name: str, departure: Departure) -> None:
        if self.leaving.get(name) is departure:
            del self.leaving[name]

    def _refusal(self, robot: str, host: str, reason: str) -> CannotMove:
        return CannotMove(robot=robot, host=host, reason=reason)

    def forget(self, agent: RobotAgent) -> None:
        """Take note that a robot has left."""
        self._host.forget(agent)

    def close(self) -> None:
        """Ask for nothing any more: the process ends."""
        self._begun.cancel()

    # -- robots in processes of their own -----------------------------------------------------------

    def made_anew(
        self, kept: KeptApart, request: PrepareMove | TakeRobot | AskMove, asker: Principal
    ) -> PrepareMove | TakeRobot | AskMove:
        """Say of a robot that leaves its own process what its host knows; see `isolation.apart.Courier`.

        Such a process decides when it leaves, and hands over its state. It does not decide what page it is,
        who has sent that and how far it is trusted, nor whom it may command.
        """
        if isinstance(request, PrepareMove):
            page = replace(kept.create, settings={}, sender="")
            if request.page.hash:
                digest = bundle_of(kept.create).hash
                page = replace(page, source="", files={}, signed=None, hash=digest)
            person = self._transport.gate.asker(asker) if asker.person else None
            return replace(request, page=page, sender=kept.sender, asker=person, children=kept.children)
        if isinstance(request, TakeRobot):
            return replace(request, source=self.name, person=asker.person)
        return request

    # -- coming -----------------------------------------------------------------------------------

    async def answer(
        self, request: PrepareMove | TakeRobot | AskMove, asker: Principal, asked: float = 0.0
    ) -> Reply:
        """Answer another host.

        Args:
            request: what it asks.
            asker: who asks.
            asked: [s] on the clock of this process, when it was asked.

        Raises:
            CannotMove: the robot is not wanted, or cannot be kept.
            VrError: its page cannot be used here.
        """
        name, here = request.robot.name, self._host.address.name
        if not asker.agent.startswith("host/"):
            raise self._refusal(name, here, "only a host sends robots")
        if self._journal is None or self._journal.suspended:
            raise self._refusal(name, here, f"{here} keeps nothing of its robots")
        lock = self._one.setdefault(request.transfer, asyncio.Lock())
        async with lock:
            match request:
                case PrepareMove():
                    return await self._prepare(request, self._journal, asker)
                case TakeRobot():
                    return await self._take(request, self._journal, asker, asked)
                case AskMove():
                    return await self._asked(request, self._journal)

    async def _prepare(self, request: PrepareMove, journal: HostJournal, asker: Principal) -> Reply:
        name, here = request.robot.name, self._host.address.name
        presence = self._transport.presence
        named = here_of(presence, presence.keys(everyone("robot", name)))
        if any(key != request.robot.key for key in named):
            raise self._refusal(
                name, here, f"another robot here is called {name}; one of them needs another name"
            )
        try:
            self._host.reserve(name)
        except (DuplicateName, HostReserved, HostFull) as error:
            raise self._refusal(name, here, str(error)) from None
        try:
            loaded = await self._host.load(
                request.page, name, asker, sender=request.sender, children=request.children
            )
        except BaseException:
            self._host.release(name)
            raise
        expected = Expected(asker.agent, name, loaded)
        if not journal.destination.prepare(request.transfer):
            self._drop(expected)
            raise self._refusal(name, here, "that move is over")
        self._expected[request.transfer] = expected
        asyncio.get_running_loop().call_later(PREPARED_FOR, self._expect_no_longer, request.transfer)
        self.moment("ready")
        return MoveReady(log=journal.name)

    def _expect_no_longer(self, transfer: str) -> None:
        """Take what was expected out; the machine of the journal has it as ready until it is asked."""
        expected = self._expected.pop(transfer, None)
        if expected is not None and self._journal is not None:
            self._journal.destination.ready.pop(transfer, None)
            self._drop(expected)
        self._one.pop(transfer, None)

    def _drop(self, expected: Expected) -> None:
        """Let the name and the process of a robot go that does not come."""
        self._host.release(expected.name)
        if isinstance(expected.loaded.robot, RobotApart):
            self.keep(expected.loaded.robot.end_expecting())

    async def _take(self, request: TakeRobot, journal: HostJournal, asker: Principal, asked: float) -> Reply:
        if len(request.state) > LONGEST_PARCEL:
            raise self._refusal(request.robot.name, self._host.address.name, "its state is too large")
        self.moment("got")
        taken, expected = False, self._expected_from(request, asker)
        state = None if expected is None else self._arrived_state(request, asker, asked)
        agent: RobotAgent | None = None
        for effect in journal.destination.take(request.transfer):
            match effect:
                case of.WriteTaken():
                    assert expected is not None and state is not None  # noqa: S101 PT018 # it was prepared
                    if isinstance(apart := expected.loaded.robot, RobotApart):
                        await self._write_taken_apart(apart, self._parcel(request, state, asked), journal)
                    else:
                        await self._write_taken(request, state, expected.loaded.page, journal)
                    self.moment("logged")
                case of.WriteNever():
                    await self._write_never(request.transfer, journal)
                case of.BeginHere():
                    assert expected is not None and state is not None  # noqa: S101 PT018 # as above
                    self._expected.pop(request.transfer, None)
                    agent = await self._begun_here(expected.loaded, state, far=bool(asker.site))
                    self._host.release(request.robot.name)
                    self.moment("served")
                case of.SayDecision():
                    taken = effect.taken
        if agent is not None:
            self._note_arrival(agent, request, asked)
            self.keep(self._go_on(agent, request.stopped, request.order))
        return MoveDecided(taken=taken)

    def _expected_from(self, request: TakeRobot, asker: Principal) -> Expected | None:
        """Return what was made ready for a robot; None: nothing, and so it never comes under this transfer.

        Raises:
            CannotMove: another host was to send it.
        """
        expected = self._expected.get(request.transfer)
        if expected is not None and expected.source != asker.agent:
            raise self._refusal(request.robot.name, self._host.address.name, "another host was to send it")
        if (
            expected is not None
            and isinstance(robot := expected.loaded.robot, RobotApart)
            and robot.has_ended
        ):
            self._expect_no_longer(request.transfer)
            return None
        return expected

    async def _begun_here(self, loaded: LoadedPage, state: RobotState, *, far: bool) -> RobotAgent | None:
        """Have a robot that has come serve, in this process or in its own; None: it goes on in that."""
        if isinstance(loaded.robot, RobotApart):
            await loaded.robot.arrive(state.address, state.moves, ANSWERED_WITHIN / 2)
            return None
        # to write took time, and until all ask here, the source goes on to grant its lease
        return await self._begin_here(loaded, state, ANSWERED_WITHIN if far else SETTLE)

    async def _begin_here(self, loaded: LoadedPage, state: RobotState, margin: float) -> RobotAgent:
        """Have a robot serve that has come into this process; it does not go on yet."""
        assert isinstance(loaded.robot, VirtualRobot)  # noqa: S101 # else it is in a process of its own
        welcome(state, 0.0, self._process.runner.now(), ANSWERED_WITHIN, margin)
        return await self._host.settle_in(loaded.robot, loaded.clearance, state, loaded.page)

    async def take_in(self, loaded: LoadedPage, parcel: Parcel) -> RobotAgent:
        """Have a robot go on for which this process was made, and which its host has taken."""
        assert self._journal is not None  # noqa: S101 # only such hosts take robots
        sent, now, unix = parcel.sent, self._process.runner.now(), self._process.runner.unix()
        state = decode_state(sent.state)
        by = (now - unix) - (parcel.now - parcel.unix)  # 0, unless the machine was started again meanwhile
        welcome(state, by if abs(by) > ANSWERED_WITHIN else 0.0, now, ANSWERED_WITHIN, ANSWERED_WITHIN)
        self._journal.arrived(sent.robot.key, sent.robot.name, loaded.page, sent.transfer, state)
        await self._synced(self._journal)
        agent = await self._begin_here(loaded, state, SETTLE)
        self._note_arrival(agent, sent, parcel.now)
        self.keep(self._go_on(agent, sent.stopped, sent.order))
        return agent

    def _parcel(self, request: TakeRobot, state: RobotState, asked: float) -> Parcel:
        sent = replace(request, state=encode_state(state))
        return Parcel(sent, asked or self._process.runner.now(), self._process.runner.unix())

    async def _write_taken_apart(self, robot: RobotApart, parcel: Parcel, journal: HostJournal) -> None:
        """Write what has come into the folder of its process, and then that it has: the commit."""
        name, trouble = parcel.sent.robot.name, ""
        robot.begin_arrival()
        try:
            await asyncio.get_running_loop().run_in_executor(None, robot.keep_arrival, parcel)
        except OSError as error:
            trouble = error.strerror or str(error)
        else:
            journal.came_apart(parcel.sent.transfer)
            await self._synced(journal)
            trouble = journal.trouble
        if trouble:
            journal.destination.not_written(parcel.sent.transfer)
            self._expect_no_longer(parcel.sent.transfer)
            raise self._refusal(name, self._host.address.name, trouble)
        robot.count_arrival(parcel)

    def _note_arrival(self, agent: RobotAgent, request: TakeRobot, asked: float) -> None:
        stood = request.stood + max(0.0, self._process.runner.now() - asked) if asked else request.stood
        by = f" for {request.person}" if request.person else ""
        text = f"it moved from host {request.source} to {self._host.address.name}{by}, and stood still for"
        self._host.note_move(agent, f"{text} {stood * 1e3:.1f} ms", request.person)

    def _arrived_state(self, request: TakeRobot, asker: Principal, asked: float) -> RobotState:
        try:
            state = decode_state(request.state)
        except msgspec.MsgspecError as error:
            raise self._refusal(request.robot.name, self._host.address.name, str(error)) from None
        if state.address != request.robot:
            raise self._refusal(request.robot.name, self._host.address.name, "its state is another robot's")
        now = self._process.runner.now()
        by = 0.0 if same_clock(request.clock) else (asked or now) - request.now
        welcome(state, by, now, ANSWERED_WITHIN)
        if asker.site:
            see_from(state, asker, Places(self._transport.presence).own)
        state.moves += 1
        state.home = f"host {self._host.address.name}"
        return state

    async def _write_taken(
        self, request: TakeRobot, state: RobotState, page: KeptPage, journal: HostJournal
    ) -> None:
        key, name = request.robot.key, request.robot.name
        journal.arrived(key, name, page, request.transfer, state)
        await self._synced(journal)
        if journal.suspended:
            journal.destination.not_written(request.transfer)
            journal.gone(key)
            raise self._refusal(name, self._host.address.name, journal.trouble)

    async def _write_never(self, transfer: str, journal: HostJournal) -> None:
        journal.never(transfer)
        await self._synced(journal)
        expected = self._expected.pop(transfer, None)
        if expected is not None:
            self._drop(expected)
        if journal.suspended:
            journal.destination.never.pop(transfer, None)
            raise self._refusal("the robot", self._host.address.name, journal.trouble)

    async def _synced(self, journal: HostJournal) -> None:
        await asyncio.get_running_loop().run_in_executor(None, journal.sync)

    async def _asked(self, request: AskMove, journal: HostJournal) -> Reply:
        if request.log != journal.name:
            name, here = request.robot.name, self._host.address.name
            raise self._refusal(name, here, f"{here} has another log than {request.log}")
        taken = False
        for effect in journal.destination.ask(request.transfer):
            if isinstance(effect, of.WriteNever):
                await self._write_never(request.transfer, journal)
            elif isinstance(effect, of.SayDecision):
                taken = effect.taken
        agent = self._host.agents.get(request.robot.name)
        if taken and request.stopped and agent is not None and agent.address == request.robot:
            agent.stop(request.stopped, request.order)
        elif taken and request.stopped:
            await self._host.stop_apart(request.robot, request.stopped, request.order)
        return MoveDecided(taken=taken)

    async def _go_on(self, agent: RobotAgent, stopped: str, order: str) -> None:
        """Have a robot that has come hold its children, and go on."""
        try:
            if stopped:
                agent.stop(stopped, order)
            await agent.take_back()
            await agent.meet_callers()
            self.moment("went")
            agent.go_on()
            await agent.take_orders()
            await agent.listed()
        except VrError as error:
            _log.error("%s has come and does not go on: %s", agent.robot.name, error)


class Departure:
    """One robot that leaves: carries out what `core.transfer.Source` decides."""

    def __init__(  # what it needs of its host
        self,
        moves: Moves,
        agent: RobotAgent,
        target: str,
        transport: Transport,
        journal: HostJournal,
        out: MovedOut | None = None,
        asker: Principal = ITSELF,
    ) -> None:
        """Prepare.

        Args:
            moves: of the host.
            agent: of the robot.
            target: name of the other host, `SITE:NAME` at another site.
            transport: the way there.
            journal: of the process.
            out: the process was started again while the robot was on its way.
            asker: who wants it to move.
        """
        self._asker = asker
        self._moves, self._agent, self.target = moves, agent, target
        self._transport, self._journal = transport, journal
        self._runtime, self._name = agent.runtime, agent.robot.name
        self.transfer = token() if out is None else out.transfer
        self._secret = token() if out is None else out.secret
        self._source = of.Departing("preparing" if out is None else "out")
        if out is not None:
            self._source.log = out.log
        self._entrusted: frozenset[tuple[str, str]] = frozenset()
        self._over: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        self._keeper: asyncio.Task[None] | None = None
        self._frozen_at = 0.0
        self.paused = 0.0
        """[s] for which nobody has acted for it."""
        self._tasks: set[asyncio.Task[None]] = set()

    @property
    def in_doubt(self) -> bool:
        """Whether it is not known who has the robot."""
        return self._source.phase == "out"

    async def run(self) -> str:
        """Move; returns why it has not, as a clause, empty: it has.

        Raises:
            VrError: the other host refuses.
        """
        self._agent.on_stop = self._stopped
        self._show(on_way=self.target)
        try:
            if self.in_doubt:
                self._keep_children()
                self._do(self._source.begins)
            else:
                self._do(self._source.handle(await self._prepared()))
            return await asyncio.shield(self._over)
        except BaseException as error:
            if self._source.phase in of.BEFORE:
                self._do(self._source.handle(of.Refused(reason=str(error))))
            raise
        finally:
            self._agent.on_stop = lambda _reason, _order: None
            self._show(on_way="")

    def _show(self, *, on_way: str) -> None:
        self._runtime.on_way, self._runtime.in_doubt = on_way, self.in_doubt
        self._runtime.changed()

    def _stopped(self, reason: str, order: str) -> None:
        self._do(self._source.handle(of.StopCame(reason=reason, order=order)))

    async def _prepared(self) -> of.SourceEvent:
        """See whether it can travel, and have the other host be ready."""
        await self._order_told()
        if reasons := unfit_reasons(self._runtime):
            return of.Refused(reason="; ".join(reasons))
        page = self._journal.page_of(self._runtime.key)
        if page is None:
            return of.Refused(reason="its page is not kept")
        if page.service:
            return of.Refused(reason=f"the service {page.service} has brought it, and it stays with it")
        try:
            ready = await self._have_prepared(page, whole=not self._far)
        except NoSuchBundle:  # it may not read pages here, or the way was too slow
            ready = await self._have_prepared(page, whole=True)
        children = self._agent.children
        if children is not None:
            self._entrusted = await children.entrust(self._secret)
        self._moves.moment("prepared")
        return of.DestinationReady(log=ready.log)

    async def _order_told(self) -> None:
        """Wait a moment while it tells of an order that is done, or is about to begin one."""
        until = loop_now() + STAND_WITHIN
        while self._runtime.takes_order and loop_now() < until:
            if self._runtime.look(lambda state: bool(state.calls.live)):
                return
            await asyncio.sleep(0.01)

    async def _have_prepared(self, page: KeptPage, *, whole: bool) -> MoveReady:
        """Have the other host load the page; to another site goes only its hash, unless it is sent `whole`.

        Raises:
            VrError: it refuses, or is not there.
        """
        target = self._targets()[:1]
        if not target:
            raise NoSuchHost(name=self.target)
        request = PrepareMove(
            transfer=self.transfer,
            robot=self._agent.address,
            page=_sent(page, self._name, whole=whole),
            sender=page.sender,
            asker=self._transport.gate.asker(self._asker) if self._asker.person else None,
            children=tuple(sorted({child.split("/")[1] for _, child in self._children_now()})),
        )
        return await ask(
            self._transport, target[0], request, MoveReady, timeout=LOADING, sender=self._moves.key
        )

    def _targets(self) -> list[str]:
        """Return the keys of the hosts that may know: the other one, and who may have its log.

        Only those of its site may: at another one a host of the same name has a log of the same name.
        """
        site, name = parted(self.target)
        places = Places(self._transport.presence)
        there = [key for key in places.at("host", site or places.own) if key != self._moves.key]
        named = [key for key in there if key in self._transport.presence.keys(everyone("host", name))]
        others = [key for key in there if key not in named]
        return [*reversed(named), *(others if self.in_doubt else ())]

    @property
    def _far(self) -> bool:
        return ":" in self.target

    # -- effects ----------------------------------------------------------------------------------

    def _do(self, effects: list[of.SourceEffect]) -> None:  # noqa: C901 # one for each
        for effect in effects:
            match effect:
                case of.Freeze():
                    self._frozen_at = loop_now()
                    self._runtime.freeze()
                    self._start(self._stand())
                case of.WriteOut():
                    self._start(self._write_out())
                case of.Send():
                    self._keep_children()
                    self._show(on_way=self.target)
                    self._start(self._send())
                case of.AskOther():
                    self._show(on_way=self.target)
                    self._start(self._ask())
                case of.StopBelow(reason=reason, order=order):
                    if self._agent.children is not None:
                        self._agent.children.stop_all(reason, order)
                case of.WriteBack():
                    self._journal.back(self._runtime.key)
                    self._journal.barrier()
                case of.Thaw(reason=reason):
                    self._thaw(reason)
                case of.LeaveHere():
                    self._start(self._leave())

    def _start(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._done)

    def _done(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if task.cancelled() or (error := task.exception()) is None:
            return
        _log.error("the move of %s: %r", self._name, error)
        if self._source.phase == "out":
            self._do(self._source.handle(of.NoWord()))
        else:
            self._do(self._source.handle(of.Refused(reason=str(error))))

    async def _stand(self) -> None:
        """Wait until all code of the robot waits, and take nothing more from then on."""
        until = loop_now() + STAND_WITHIN
        while not self._runtime.close():
            if self._source.phase != "freezing":
                return
            if loop_now() >= until:
                reason = f"its code has not come to a wait for {STAND_WITHIN:g} s"
                self._do(self._source.handle(of.Refused(reason=reason)))
                return
            await asyncio.sleep(LOOK)
        self._moves.moment("frozen")
        reasons = unfit_reasons(self._runtime, standing=True)
        if self._children_now() != self._entrusted:
            reasons.append("its children have changed meanwhile")
        event = of.Refused(reason="; ".join(reasons)) if reasons else of.Still()
        self._do(self._source.handle(event))

    def _children_now(self) -> frozenset[tuple[str, str]]:
        def look(state: RobotState) -> frozenset[tuple[str, str]]:
            return frozenset((slot, bond.child.key) for slot, bond in state.slots.bonds().items())

        return self._runtime.look(look)

    async def _write_out(self) -> None:
        key, log = self._runtime.key, self._source.log
        self._journal.out(key, self.transfer, self.target, log, self._secret)
        await asyncio.get_running_loop().run_in_executor(None, self._journal.sync)
        self._moves.moment("out")
        if self._journal.suspended:
            self._do(self._source.handle(of.Refused(reason=self._journal.trouble)))
        else:
            self._do(self._source.handle(of.OutWritten()))

    async def _send(self) -> None:
        def parcel(state: RobotState) -> bytes:
            return encode_state(msgspec.structs.replace(state, secret=self._secret))

        body, runner = self._runtime.look(parcel), self._runtime.process.runner
        stopped, order = self._stop
        request = TakeRobot(
            transfer=self.transfer,
            robot=self._agent.address,
            state=body,
            now=runner.now(),
            clock=this_clock(),
            stopped=stopped,
            order=order,
            source=self._moves.name,
            person=self._asker.person,
            stood=loop_now() - self._frozen_at,
        )
        await self._hear(self._targets()[:1], request)

    async def _ask(self) -> None:
        """Ask what became of it, as long as nobody knows."""
        await asyncio.sleep(ASK_AGAIN)
        stopped, order = self._stop
        request = AskMove(
            transfer=self.transfer,
            robot=self._agent.address,
            log=self._source.log,
            stopped=stopped,
            order=order,
        )
        await self._hear(self._targets(), request)

    @property
    def _stop(self) -> tuple[str, str]:
        """Reason and order of the stop that has come meanwhile; empty: none has."""
        stop = self._source.stop
        return ("", "") if stop is None else (stop.reason, stop.order)

    async def _hear(self, targets: list[str], request: TakeRobot | AskMove) -> None:
        event: of.SourceEvent = of.NoWord()
        within = ANSWERED_WITHIN
        if isinstance(request, TakeRobot) and self._far:
            within += len(request.state) / SLOWEST
        for key in targets:
            with contextlib.suppress(VrError):
                decided = await ask(
                    self._transport,
                    key,
                    request,
                    MoveDecided,
                    timeout=within,
                    sender=self._moves.key,
                )
                event = of.WordCame(taken=decided.taken)
                break
        self._moves.moment("answered")
        self._do(self._source.handle(event))

    async def _leave(self) -> None:
        self.paused = loop_now() - self._frozen_at if self._frozen_at else 0.0
        self._journal.gone(self._runtime.key)
        self._journal.barrier()
        self._moves.moment("gone")
        self._end_keeping()
        if self._far:
            await self._seen_there()
        await self._agent.leave()
        self._moves.forget(self._agent)
        self._settle("")

    async def _seen_there(self) -> None:
        """Wait until all of this machine know at which site the robot is: until then it would be nowhere."""
        places, until = Places(self._transport.presence), loop_now() + SEEN_WITHIN
        while not places.site_of(self._runtime.key) and loop_now() < until:  # noqa: ASYNC110 # a table, which tells nobody
            await asyncio.sleep(0.005)
        await self._transport.settle(ANSWERED_WITHIN)

    def _thaw(self, reason: str) -> None:
        self._end_keeping()
        children = self._agent.children
        if children is not None:
            children.moves_with("")
        if self._runtime.ice is not None:
            restored = self._runtime.ice.closed and not self._frozen_at
            self._runtime.thaw()
            if restored:  # of a process that was started again: nothing of it has begun here
                self._start(self._begin_again())
        if children is not None and self._entrusted:
            children.renew_all()
        self._settle(reason)

    async def _begin_again(self) -> None:
        await self._agent.take_back()
        await self._agent.meet_callers()
        self._agent.go_on()

    def _settle(self, reason: str) -> None:
        if not self._over.done():
            self._over.set_result(reason)

    # -- its children meanwhile -------------------------------------------------------------------

    def _keep_children(self) -> None:
        """Have the leases of its children prolonged, for its core takes no time any more."""
        children = self._agent.children
        if children is None or self._keeper is not None:
            return
        children.moves_with(self._secret)

        async def keep() -> None:
            while True:
                children.renew_all()
                bonds = self._runtime.look(lambda state: state.slots.copied())
                await asyncio.sleep(min((bond.lease.term for bond in bonds.values()), default=1.0) / KEEPS)

        self._keeper = asyncio.ensure_future(keep())

    def _end_keeping(self) -> None:
        if self._keeper is not None:
            self._keeper.cancel()
            self._keeper = None


def _urgency(agent: RobotAgent) -> tuple[int, str]:
    """Return by what robots are sorted that leave a host: those that carry something out come first."""

    def look(state: RobotState) -> int:
        return 0 if state.calls.live else 1 if state.slots.bonds() or state.lease.current else 2

    return agent.runtime.look(look), agent.robot.name


def _sent(page: KeptPage, name: str, *, whole: bool) -> Create:
    """Return a page as it is sent; `whole`: not only its hash."""
    bundle = bundle_of(page)
    if whole:
        return replace(bundle.request(name, origin=page.origin), sender="")
    return Create(
        name=name, path=page.path, source="", wanted=page.wanted, origin=page.origin, hash=bundle.hash
    )
