"""The process in which virtual robots live: makes them of source while everything runs, and ends them.

Each robot has its own agent and runs its commands in its own threads; the host only makes them,
knows which there are, and ends those that are left when it ends itself.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from robotree.vr.agents.agent import RobotAgent
from robotree.vr.agents.bundles import KnownBundles
from robotree.vr.agents.moving import LoadedPage, Moves
from robotree.vr.agents.placing import AgentPlace, Placeable, PlaceFinder
from robotree.vr.agents.shared import Beside, Shared
from robotree.vr.agents.taker import say_deleted
from robotree.vr.agents.ways import host_beside
from robotree.vr.author.robot import Robot
from robotree.vr.author.virtual_robot import Service, VirtualRobot
from robotree.vr.base.address import Address, check_name
from robotree.vr.base.envelope import Received
from robotree.vr.base.errors import (
    CannotMove,
    DuplicateName,
    HostFull,
    HostReserved,
    NoSuchRobot,
    NotApart,
    NotIsolated,
    OnItsWay,
    Unreachable,
    VrError,
)
from robotree.vr.base.permissions import LEVELS, Isolation, Permissions
from robotree.vr.base.principal import ITSELF, Principal
from robotree.vr.base.requests import (
    AskMove,
    Cancel,
    Create,
    Described,
    DescribeHost,
    Drain,
    EventsRead,
    EventsVerified,
    History,
    HostDescribed,
    Level,
    Migrate,
    PrepareMove,
    ReadBundle,
    ReadEvents,
    ReadHistory,
    Reload,
    Reloaded,
    Remembered,
    Reply,
    SafeStop,
    TakeRobot,
    VerifyEvents,
)
from robotree.vr.base.transport import Transport
from robotree.vr.bundle import Bundle
from robotree.vr.bundle.admission import Clearance, Gate, is_own
from robotree.vr.bundle.bundle import bundle_of, is_script
from robotree.vr.bundle.child_calls import choosing
from robotree.vr.bundle.loader import LIMIT
from robotree.vr.core.bonds import DEFAULT_TERM
from robotree.vr.core.machine import LONGEST_DEADLINE, RobotState
from robotree.vr.exchange.authority import Here, RobotThere
from robotree.vr.exchange.claim import Declarations, claim, expect_free, new_address
from robotree.vr.exchange.client import RobotClient
from robotree.vr.exchange.dispatcher import Dispatcher, SendReply, not_for
from robotree.vr.history.writer import HistoryWriter, MoveNote, answer_of
from robotree.vr.isolation.apart import KeptApart, RobotApart, RobotsApart, lack_for
from robotree.vr.journal.journal import HostJournal
from robotree.vr.journal.kept import stop_left, take_stop_back
from robotree.vr.journal.records import KeptPage
from robotree.vr.journal.recovery import KeptRobot, rebase
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.orders.ledger import Ledger, OrderMemory
from robotree.vr.running.heard import speaking
from robotree.vr.running.process import Process
from robotree.vr.running.runner import runner_of, soon

AT_ONCE = 4
"""Sources that are loaded at the same time; one that hangs keeps its place until its time is over."""

MOST_REMEMBERED = 2000
"""Lines from the logs of robots that have ended."""

_log = logging.getLogger(__name__)


_Heard = list[tuple[Level, str, bool]]
"""Output of a page, as `RobotRuntime.say` takes it."""


def _listen(make: Callable[[], VirtualRobot]) -> tuple[VirtualRobot, _Heard]:
    """Make a robot; return it with the output of its page meanwhile."""
    heard: _Heard = []

    def hear(level: Level, text: str, *, piece: bool = False) -> None:
        heard.append((level, text, piece))

    with speaking(hear):
        return make(), heard


class Host:
    """Makes virtual robots and is their home."""

    apart: RobotsApart | None = None
    """Its robots in processes of their own; None: it makes none."""
    isolate: Isolation = "none"
    """The level of robots for which nobody asks for another one."""
    instead_of: str = ""
    """Name of the host whose robots it has taken over with the journal; empty: they are its own."""
    most: int | None = None
    """How many robots it runs at most; None: any number."""
    placing: PlaceFinder | None = None
    """Looks after the places of its robots; None: nobody does."""
    log_folder: Path | None = None
    """Where others leave a stop for its robots while it is away; None: nowhere."""

    def __init__(  # noqa: PLR0913 # what it stands on, and what people may choose
        self,
        transport: Transport,
        name: str,
        *,
        registrar: Registrar | None = None,
        term: float = DEFAULT_TERM,
        limit: float = LIMIT,
        process: Process | None = None,
        only: str = "",
        journal: HostJournal | None = None,
        gate: Gate | None = None,
        ledger: Ledger | None = None,
    ) -> None:
        """Prepare a host.

        Args:
            transport: the way to the others, shared by all its robots.
            name: of the host.
            registrar: where its robots are listed.
            term: [s] of the leases that its robots grant and ask for.
            limit: [s] for a source to run, and again for the robot's constructor.
            process: whose threads carry its robots' commands out; None: one of its own.
            only: name of the one robot that it runs; empty: it runs any number.
            journal: of the process: what is kept of its robots; None: nothing is.
            gate: decides which pages run; None: this user's own alone.
            ledger: of the process: which orders its robots have begun; None: they take none.

        Raises:
            BadName: the name cannot be one.
        """
        self._journal, self._ledger = journal, ledger
        self.gate = Gate() if gate is None else gate
        self._history: HistoryWriter | None = None
        self.address = new_address("host", name)
        self.agents: dict[str, RobotAgent] = {}
        """The robots that live here, by name."""
        self.bundles = KnownBundles(transport, self.address.key)
        """The pages that it has, or gets, by their hash."""
        self._pages: dict[str, str] = {}
        """Hashes of the pages of the robots, by name."""
        self._behaviours: dict[str, list[RobotAgent]] = {}
        """The robots that a service has brought along, by name of the service."""
        self.clearances: dict[str, Clearance] = {}
        """How the robots run, by name."""
        self._transport, self._registrar, self._term = transport, registrar, term
        self._process = Process(runner_of(asyncio.get_running_loop())) if process is None else process
        self._shared = Shared(name, self.gate.level)
        self._limit, self._only = limit, only
        self._first: asyncio.Future[RobotAgent] = asyncio.get_running_loop().create_future()
        self._coming = self._kept_names()
        self._ended: list[RobotAgent] = []
        self._remembered: deque[Remembered] = deque(maxlen=MOST_REMEMBERED)
        self._declared = Declarations()
        self._watchers = Beside()
        self._loop = asyncio.get_running_loop()
        self._loaders = ThreadPoolExecutor(AT_ONCE, thread_name_prefix="loader")
        self._open = False
        self.moves = Moves(self, transport, self._process, journal)
        """Of its robots, to other hosts, and of others to this one."""

    async def start(self) -> None:
        """Serve, then be there.

        Raises:
            DuplicateName: a living host has this name.
            TransportError: the transport does not work.
        """
        self.opens()
        if self.apart is not None:
            self.apart.courier, self.apart.registrar = self.moves, self._registrar
            self.apart.on_lost = lambda identity: self.moves.keep(
                say_deleted(self._transport, identity, self.address.key)
            )
        try:
            now = asyncio.get_running_loop().time
            dispatcher = Dispatcher(self.address.name, self.answer, now=now, here=self.here)
            await self._declared.keep(self._transport.serve(self.address.key, dispatcher.take))
            await self._declared.keep(claim(self._transport, self.address))
        except BaseException:
            await self.close()
            raise

    @property
    def here(self) -> Here:
        """The host, as the rights of askers name it."""
        return Here("host", self.address.name, self._transport.gate, robot=self._robot_here)

    def finds_places(self, used: Callable[[], float] = time.process_time) -> None:
        """Measure the ways to others from now on, and look after the places of the robots.

        Args:
            used: [s] of processor time that the process has had.
        """
        self.placing = PlaceFinder(self, self._transport, unix=self._process.runner.unix, used=used)
        self.moves.keep(self.placing.run())

    def placeables(self) -> dict[str, Placeable]:
        """Return the robots, by key, whose places may be looked after."""
        unix, apart = self._process.runner.unix, {} if self.apart is None else self.apart.robots
        here: dict[str, Placeable] = {
            agent.address.key: AgentPlace(agent, unix) for agent in self.agents.values()
        }
        return here | {one.address.key: one for one in apart.values() if one.address is not None}

    def has_room(self) -> int | None:
        """How many robots it still takes; None: any number."""
        if self.most is None:
            return None
        return max(self.most - len(self.agents.keys() | self._coming), 0)

    async def move(self, robot: str, host: str) -> Reply:
        """Have a robot go on in another host; see `Moves.migrate`."""
        return await self.moves.migrate(robot, host)

    def opens(self) -> None:
        """Take robots, though nobody sees this host: it is the inside of a robot apart."""
        self._open = True

    def keeps_history(self, history: HistoryWriter) -> None:
        """Begin to keep what its robots do, and answer who asks for it."""
        self._history, history.page_of = history, self.page_of
        history.start()

    async def close(self, *, returns: bool | None = None) -> None:
        """End its robots politely, then itself; a journal keeps those that are here now. Twice is once.

        Args:
            returns: whether they go on with their state later; None: with a journal they do.
        """
        returns = self._journal is not None if returns is None else returns
        self._open = False
        self.moves.close()
        await self._declared.aclose()
        agents = list(self.agents.values())
        if self._journal is not None:
            await asyncio.gather(*(agent.rest() for agent in agents if not agent.runtime.is_on_way))
            self._journal.seal()
        if self.apart is not None:
            await self.apart.close(returns=returns)
        await asyncio.gather(*(agent.close(returns=returns) for agent in agents))
        self._watchers.cancel()
        self._loaders.shutdown(wait=False, cancel_futures=True)
        self._process.close()

    def _kept_names(self) -> set[str]:
        """Return the names of the robots that are to come back: nobody else gets them before."""
        return set() if self._journal is None else {kept.name for kept in self._journal.found.robots}

    async def restore(self, *, abandon: str = "", left: Sequence[SafeStop | Cancel] = ()) -> None:
        """Have the robots of the journal go on where they were when this host ended.

        One whose page cannot be loaded any more, or whose name somebody else has now, is left out, and its
        log says why.

        Args:
            abandon: why their open commands end before they go on; empty: they go on.
            left: what they obey before they go on.

        Raises:
            JournalUnusable: the journal cannot be written.
        """
        journal = self._journal
        if journal is None:
            return
        reason = "" if self.log_folder is None else stop_left(self.log_folder)
        robots, now = journal.found.robots, self._process.runner.now()
        self._process.gap = max(0.0, now - journal.found.latest - journal.shift)
        rebase([kept.state for kept in robots], journal.shift, now)
        made = [(kept, agent) for kept in robots if (agent := await self._made_again(kept)) is not None]
        for kept, agent in made:
            journal.made(kept.key, kept.name, kept.page, agent.runtime.look)
            if kept.out is not None:
                agent.runtime.freeze(closed=True)
                journal.still_out(kept.key, kept.out)
        journal.begin()
        back = await self._settled(made)
        self._coming -= self._kept_names()
        await asyncio.gather(*(agent.take_back() for agent in back))
        if reason:
            for agent in back:
                agent.stop(f"{reason}, while its host was away")
        for agent in back:
            agent.obey(left)
        if self.log_folder is not None or left:
            journal.barrier()
        if self.log_folder is not None:
            take_stop_back(self.log_folder)
        await self._go_on(back, abandon)

    async def _go_on(self, back: list[RobotAgent], abandon: str) -> None:
        """Have the robots that are back go on, and those in processes of their own."""
        await asyncio.gather(*(agent.meet_callers() for agent in back))
        for agent in back:
            agent.go_on(abandon)
            await agent.take_orders()
        if self.apart is not None:
            await self._restore_apart(self.apart)

    async def _settled(self, made: list[tuple[KeptRobot, RobotAgent]]) -> list[RobotAgent]:
        """Have robots that were kept be present; returns those that go on, the others may be elsewhere."""
        back: list[RobotAgent] = []
        for kept, agent in made:
            try:
                await self._settle(agent)
            except VrError as error:
                if self._journal is not None:
                    self._journal.gone(kept.key)
                _log.error("%s is not back: %s", kept.name, error)
            else:
                if kept.out is None:
                    back.append(agent)
                else:
                    self.moves.find_out(agent, kept.out)
        return back

    async def _made_again(self, kept: KeptRobot) -> RobotAgent | None:
        """Make a robot of the page that was kept, with its state; None: that page cannot be used."""
        page = kept.page
        bundle = bundle_of(page)
        make = partial(bundle.create, kept.name, limit=self._limit)
        try:
            clearance = self._admitted_again(bundle, page.service)
            self._expect_apart(clearance, kept.name)
            robot, heard = await self._heard(make)
        except VrError as error:
            _log.error("%s is not back: %s", kept.name, error)
            return None
        kept.state.home = f"host {self.address.name}"
        agent = self._new_agent(robot, clearance, kept.state)
        if page.service:
            self._behaviours.setdefault(page.service, []).append(agent)
        agent.runtime.page = page.origin
        self._pages[kept.name] = self.bundles.keep(bundle)
        _say(agent, heard)
        here, before = self.address.name, self.instead_of
        started = here if self._shared.isolation == "none" else "its process"
        why = f"{here} has taken over from {before}" if before else f"{started} was started again"
        agent.runtime.log.say(
            "warning", f"it is back after {self._process.gap:.1f} s: {why}{_going_on(kept.state)}"
        )
        return agent

    async def _heard(self, make: Callable[[], VirtualRobot]) -> tuple[VirtualRobot, _Heard]:
        """Make a robot in a thread of its own; return it with the output of its page meanwhile."""
        return await asyncio.get_running_loop().run_in_executor(self._loaders, partial(_listen, make))

    def _admitted_again(self, bundle: Bundle, service: str) -> Clearance:
        """Return how a robot that is back runs; a behaviour as its service, which came back before it.

        Raises:
            NoSuchRobot: that service is not back.
            BundleError: the page does not run here any more.
        """
        if not service:
            return self.gate.admit(bundle, ITSELF, self.address.name)
        if service not in self.clearances:
            raise NoSuchRobot(name=service)
        return self.clearances[service]

    def _new_agent(
        self, robot: VirtualRobot, clearance: Clearance, state: RobotState | None = None
    ) -> RobotAgent:
        self.clearances[robot.name] = clearance
        agent = RobotAgent(
            robot,
            self._transport,
            registrar=self._registrar,
            term=self._term,
            process=self._process,
            shared=self._shared,
            state=state,
            orders=None if self._ledger is None else OrderMemory(self._ledger),
        )
        if isinstance(robot, Service):
            agent.before_end = partial(self._end_behaviours, robot.name)
            agent.brings = lambda parent: any(
                each.address == parent for each in self._behaviours.get(robot.name, ())
            )
        agent.runtime.permissions, agent.runtime.unchecked = clearance.permissions, clearance.unchecked
        return agent

    # -- what `Moves` needs -------------------------------------------------------------------------

    async def load(
        self, sent: Create, name: str, asker: Principal, *, sender: str = "", children: tuple[str, ...] = ()
    ) -> LoadedPage:
        """Load the page of a robot that another host is about to send, where it is to run.

        Args:
            sent: the page, or its hash, and how the robot is kept apart if its author wants it.
            name: of the robot.
            asker: who sends it.
            sender: as in `PrepareMove`.
            children: names of the robots that are under it.

        Raises:
            NoSuchBundle: nobody has the page.
            BundleError: it cannot be used here.
            CannotMove: it must be kept apart here, and cannot be.
        """
        whole = sent
        if sent.hash:
            found = await self.bundles.find(sent.hash, asker)
            whole = replace(found.request(), path=sent.path, wanted=sent.wanted, origin=sent.origin)
        page = replace(_page(bundle_of(whole), whole.origin), sender=sender)
        bundle, clearance = self._admitted(bundle_of(page), asker)
        level: Isolation = max((sent.isolate or "none", self.isolate, clearance.isolation), key=LEVELS.index)
        if LEVELS.index(level) > LEVELS.index(self.gate.level):
            create = replace(bundle.request(name, origin=page.origin), isolate=sent.isolate)
            may, chooses = _reach(bundle, clearance)
            kept = KeptApart(create, bundle.sender, level, ITSELF, chooses, children)
            return LoadedPage(await self._expected_apart(kept, may), clearance, page)
        robot, _ = await self._heard(partial(bundle.create, name, limit=self._limit))
        return LoadedPage(robot, clearance, page)

    async def _expected_apart(self, kept: KeptApart, may: Permissions | None) -> RobotApart:
        """Have a process of its own load the page of a robot that may come.

        Raises:
            CannotMove: this host has none; says why.
        """
        name, here, lack = kept.create.name, self.address.name, lack_for(kept.level)
        if self.apart is None or not self.apart.keeps or lack:
            reason = f"{here} keeps its code apart ({kept.level}), and has no process for it"
            raise CannotMove(robot=name, host=here, reason=f"{reason}: {lack}" if lack else reason)
        return await self.apart.expect(kept, may)

    async def stop_apart(self, robot: Address, reason: str, order: str) -> None:
        """Have a robot in a process of its own obey a stop that came while it was on its way."""
        if (apart := self._apart(robot.name)) is not None and apart.address == robot:
            await apart.stop(reason, order)

    async def migrate_apart(self, robot: str, host: str, asker: Principal = ITSELF) -> Reply | None:
        """Have a robot in a process of its own go on in another host; None: there is none of that name.

        Raises:
            VrError: it stays here; the error says why.
        """
        apart = self._apart(robot)
        return None if apart is None else await apart.migrate(Migrate(robot=robot, host=host), asker)

    async def settle_in(
        self, robot: VirtualRobot, clearance: Clearance, state: RobotState, page: KeptPage
    ) -> RobotAgent:
        """Have a robot that has come from another host serve and be present; it does not go on yet."""
        agent = self._new_agent(robot, clearance, state)
        runtime, name = agent.runtime, robot.name
        runtime.came, runtime.page = True, page.origin
        self._pages[name] = self.bundles.keep(bundle_of(page))
        if self._journal is not None:
            self._journal.looks(agent.address.key, runtime.look)
        runtime.log.say("info", f"it has come to {self.address.name}{_going_on(state)}")
        await self._enter(agent)
        return agent

    def note_move(self, agent: RobotAgent, text: str, person: str) -> None:
        """Keep that a robot has moved, or not, with what it carries out; `person`: who wanted it."""
        if self._history is None:
            return

        def look(state: RobotState) -> tuple[list[tuple[str, str]], int]:
            running = [(key, call.command) for key, call in state.calls.live.items() if call.running]
            return running, state.lease.epoch

        running, epoch = agent.runtime.look(look)
        for key, command in running or [("", "")]:
            note = MoveNote(key, command, person, f"{text}; {command} goes on" if command else text)
            self._history.take((agent.robot.name, self._process.runner.now(), note, epoch))

    def reserve(self, name: str, *, waits: bool = False) -> None:
        """Give a name to nobody else.

        Args:
            name: of a robot that comes.
            waits: for one of this name that is here, which may be just ending; see `expect_free`.

        Raises:
            DuplicateName: somebody has it.
            HostReserved: the host runs another robot alone.
            HostFull: it has no room.
        """
        if self._only not in ("", name):
            raise HostReserved(host=self.address.name, robot=self._only)
        here = not waits and (name in self.agents or self._apart(name) is not None)
        if here or name in self._coming:
            raise DuplicateName(role="robot", name=name)
        if self.has_room() == 0:
            raise HostFull(host=self.address.name, most=self.most)
        self._coming.add(name)

    def release(self, name: str) -> None:
        """Give it again."""
        self._coming.discard(name)

    def forget(self, agent: RobotAgent) -> None:
        """Have a robot no longer that has left; its log goes on in the other host."""
        name = agent.robot.name
        if self.agents.get(name) is agent:
            del self.agents[name]
            self._pages.pop(name, None)
            self.clearances.pop(name, None)

    async def create(
        self,
        bundle: Bundle,
        name: str,
        settings: Mapping[str, Any] | None = None,
        *,
        origin: str = "",
        asker: Principal = ITSELF,
    ) -> RobotAgent:
        """Make a virtual robot of this source.

        Args:
            bundle: its source.
            name: of the robot.
            settings: values that are not the defaults.
            origin: where a reload finds the page.
            asker: who wants it.

        Returns:
            Its agent, when it can be called.

        Raises:
            BadName: the name cannot be one.
            DuplicateName: a living robot has it.
            HostReserved: the host runs another robot alone.
            HostFull: it has no room.
            BadArgument: a setting cannot have its value, or there is none of this name.
            BundleError: the source cannot be used.
        """
        self.reserve(check_name(name), waits=True)
        try:
            bundle, clearance = self._admitted(bundle, asker)
            return await self._made(bundle, clearance, name, settings, origin=origin)
        finally:
            self.release(name)

    async def _made(
        self,
        bundle: Bundle,
        clearance: Clearance,
        name: str,
        settings: Mapping[str, Any] | None = None,
        *,
        origin: str = "",
        service: str = "",
    ) -> RobotAgent:
        """Make a robot of a page that was admitted, and what it brings along; `service`: whose behaviour."""
        # before anybody's source is run for nothing
        await expect_free(self._transport, Address("robot", name, ""))
        make = partial(bundle.create, name, settings=settings, limit=self._limit)
        robot, heard = await self._heard(make)
        agent = self._new_agent(robot, clearance)
        if self._journal is not None:
            page = replace(_page(bundle, origin), service=service)
            self._journal.made(agent.address.key, name, page, agent.runtime.look)
        _say(agent, heard)
        self._pages[name] = self.bundles.keep(bundle)
        await self._settle(agent)
        agent.runtime.page = origin
        try:
            await self._bring_behaviours(agent, bundle, clearance)
        except BaseException:
            await agent.end()  # nobody remembers it as one that is away
            raise
        await self._begin(agent)
        return agent

    # -- services ---------------------------------------------------------------------------------

    async def _bring_behaviours(self, service: RobotAgent, bundle: Bundle, clearance: Clearance) -> None:
        """Make the behaviours of a service that are not here, and end those that its page has no more.

        Raises:
            DuplicateName: another robot has the name of one; then none of them is here.
            BundleError: the script of one cannot be used; likewise.
        """
        name, wanted = service.robot.name, behaviours_of(service.robot, bundle.path)
        if not (wanted or name in self._behaviours):
            return
        for old in list(self._behaviours.get(name, ())):
            bundle_now = wanted.get(old.robot.name)
            if bundle_now is None or self._pages.get(old.robot.name) != bundle_now.hash:
                await self._end_behaviour(name, old)
        here = {old.robot.name for old in self._behaviours.get(name, ())}
        try:
            for behaviour, page in wanted.items():
                if behaviour not in here:
                    made = await self._made(page, clearance, behaviour, service=name)
                    self._behaviours.setdefault(name, []).append(made)
                    await self._bind_service(service, made)
        except BaseException:
            await self._end_behaviours(name)
            raise

    async def _bind_service(self, service: RobotAgent, behaviour: RobotAgent) -> None:
        """Put a behaviour on top of its service, where it has a partner of this kind and that is free."""
        if service.runtime.lease is not None:
            return
        kind, slots = service.robot.kinds()[0], behaviour.description().slots
        for slot in [slot for slot in slots if slot.kind == kind and not slot.filled][:1]:
            await RobotClient(self._transport, behaviour.address).enslave(slot.name, service.address)

    async def _end_behaviours(self, service: str) -> None:
        """End what a service has brought along, and nobody else: whoever has such a name without it stays."""
        for behaviour in list(self._behaviours.get(service, ())):
            await self._end_behaviour(service, behaviour)
        self._behaviours.pop(service, None)

    async def _end_behaviour(self, service: str, behaviour: RobotAgent) -> None:
        self._behaviours[service].remove(behaviour)
        await behaviour.end()

    async def deserted(self, within: float) -> None:
        """Return when the first robot has ended, or when none has come.

        Args:
            within: [s] for the first robot to come.
        """
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(within):
                await asyncio.shield(self._first)
        if self._first.done():
            await self._first.result().closed.wait()

    def _expect_apart(self, clearance: Clearance, name: str, level: Isolation | None = None) -> None:
        """Refuse a page that must be kept apart more than its robot is.

        Args:
            clearance: how it is to run.
            name: of the robot.
            level: how that is kept apart; None: as all robots of this process.

        Raises:
            NotApart: it must.
        """
        if LEVELS.index(clearance.isolation) > LEVELS.index(level or self.gate.level):
            raise NotApart(level=clearance.isolation, name=name)

    def _admitted(self, bundle: Bundle, asker: Principal) -> tuple[Bundle, Clearance]:
        """Return a page with who has sent it, and how it runs here.

        Raises:
            BundleError: it does not run here; says why.
        """
        sender = "" if bundle.signed is not None or is_own(asker) else asker.person or asker.agent
        bundle = replace(bundle, sender=sender) if sender and not bundle.sender else bundle
        return bundle, self.gate.admit(bundle, asker, self.address.name)

    async def reload(
        self,
        bundle: Bundle,
        name: str,
        *,
        origin: str = "",
        now: bool = False,
        within: float = 10.0,
        asker: Principal = ITSELF,
    ) -> Reloaded:
        """Have a robot of this host go on with another page; whatever fails, it goes on with the old one.

        Args:
            bundle: the other page.
            name: of the robot.
            origin: where a later reload finds the page.
            now: whether the running command is cancelled.
            within: [s] for the running command to end.
            asker: who wants it.

        Raises:
            NoSuchRobot: it does not live here.
            BundleError: the page cannot be used, or the running command did not end in time.
            SlotHeld: the page lacks a slot that holds a child.
        """
        agent = self.agents.get(name)
        if agent is None or not isinstance(agent.robot, VirtualRobot):
            raise NoSuchRobot(name=name)
        if name in self.moves.leaving:
            raise OnItsWay(robot=name)
        bundle, clearance = self._admitted(bundle, asker)
        self._expect_apart(clearance, name)
        robot, heard = await self._heard(partial(bundle.again, agent.robot, limit=self._limit))
        key, page = agent.address.key, _page(bundle, origin)
        if self._journal is not None:
            self._journal.offered(key, page)
        notes = await agent.reload(robot, origin, now=now, within=within, permissions=clearance.permissions)
        self._pages[name], self.clearances[name] = self.bundles.keep(bundle), clearance
        agent.runtime.unchecked = clearance.unchecked
        if self._journal is not None:
            self._journal.turned(key, page)
        _say(agent, heard)
        await self._bring_behaviours(agent, bundle, clearance)
        if not agent.runtime.look(lambda state: state.calls.running):
            await self._begin(agent)
        return Reloaded(robot=agent.description(), notes=tuple(notes))

    async def make(self, request: Create, asker: Principal) -> RobotAgent:
        """Make the robot for which somebody asks; its log names the person."""
        bundle, settings = bundle_of(request), request.settings
        agent = await self.create(bundle, request.name, settings, origin=request.origin, asker=asker)
        if person := asker.person:
            agent.runtime.log.say("info", f"created from {request.path} by {person}")
        return agent

    async def _created(self, request: Create, asker: Principal) -> Described:
        """Make a robot where it is to run.

        Raises:
            NotIsolated: this host cannot.
        """
        bundle, clearance = self._admitted(bundle_of(request), asker)
        wanted: Isolation = request.isolate or "none"
        level: Isolation = max((wanted, self.isolate, clearance.isolation), key=LEVELS.index)
        if level == "none":
            return Described(robot=(await self.make(request, asker)).description())
        name = check_name(request.name)
        lack = lack_for(level)
        if self.apart is None or lack:
            raise NotIsolated(host=self.address.name, level=level, lack=lack and f": {lack}")
        if name in self.apart.robots:
            raise DuplicateName(role="robot", name=name)
        self.reserve(name, waits=True)
        try:
            await expect_free(self._transport, Address("robot", name, ""))
            may, chooses = _reach(bundle, clearance)
            kept = KeptApart(request, bundle.sender, level, asker, chooses)
            self.clearances[name] = clearance
            self.bundles.keep(bundle)
            return await self.apart.begin(kept, may, fresh=True)
        finally:
            self.release(name)

    async def _restore_apart(self, apart: RobotsApart) -> None:
        """Have the robots go on that live in processes of their own; of one that cannot the log says why."""

        async def restore(kept: KeptApart) -> None:
            name = kept.create.name
            try:
                bundle = replace(bundle_of(kept.create), sender=kept.sender)
                self.bundles.keep(bundle)
                clearance = self.gate.admit(bundle, ITSELF, self.address.name)
                self.clearances[name] = clearance
                await apart.begin(kept, _reach(bundle, clearance)[0], fresh=False)
            except VrError as error:
                _log.error("%s is not back: %s", name, error)

        robots = apart.kept()
        for kept in [one for one in robots if not self._has_come(one)]:
            apart.drop(kept)
            robots.remove(kept)
        await asyncio.gather(*map(restore, robots))

    def _has_come(self, kept: KeptApart) -> bool:
        """Whether a robot that was kept has come, if it is from another host: the journal decides."""
        parcel = kept.parcel
        return parcel is None or (
            self._journal is not None and parcel.sent.transfer in self._journal.destination.taken
        )

    async def _begin(self, agent: RobotAgent) -> None:
        """Call the command with which a robot begins by itself."""
        command, name = agent.robot.begins, agent.robot.name
        if command:
            client = RobotClient(self._transport, agent.address)
            try:
                await client.tell(command, {}, deadline=LONGEST_DEADLINE, caller=name)
            except VrError as error:  # it is there, and says why it does not begin when it is called again
                _log.warning("%s does not begin by itself: %s", name, error)

    async def _settle(self, agent: RobotAgent) -> None:
        await self._enter(agent)
        await agent.listed()

    async def _enter(self, agent: RobotAgent) -> None:
        agent.runtime.on_move = partial(self._move_itself, agent.robot.name)
        agent.runtime.on_locate = partial(self._locate, agent)
        await agent.start()
        self.agents[agent.robot.name] = agent
        if self._journal is not None:
            agent.on_gone = partial(self._journal.gone, agent.address.key)
        if not self._first.done():
            self._first.set_result(agent)
        self._watchers.begin(self._watch(agent))
        if not self._open:  # the host has ended meanwhile
            await agent.close()
            raise Unreachable(key=self.address.key)

    def _move_itself(self, name: str, host: str, done: Callable[[VrError | None], None]) -> None:
        """Have a robot move that wants it itself. From any thread."""

        async def move() -> None:
            try:
                await self.moves.migrate(name, host)
            except VrError as error:
                done(error)
            else:
                done(None)

        soon(self._loop, lambda: self.moves.keep(move()))

    def _locate(self, agent: RobotAgent, slot: str, done: Callable[[str | VrError], None]) -> None:
        """Find the host of a child of a robot. From any thread."""

        async def locate() -> None:
            try:
                bond = agent.runtime.bond_in(slot)
                child = await RobotClient(self._transport, bond.child).describe()
                home = agent.runtime.look(lambda state: state.home).removeprefix("host ")
                done(host_beside(self._transport.presence, bond.child, child.host, home))
            except VrError as error:
                done(error)

        soon(self._loop, lambda: self.moves.keep(locate()))

    async def _watch(self, agent: RobotAgent) -> None:
        await agent.closed.wait()
        name = agent.robot.name
        self._remembered.extend(Remembered(name, line) for line in agent.runtime.log.since(0))
        self.forget(agent)
        self._ended = [ended for ended in (*self._ended, agent) if ended.abandoned]

    async def answer(  # noqa: C901, PLR0911, PLR0912 # one for each request
        self, received: Received, send: SendReply = lambda _: None
    ) -> Reply:
        """Answer a request to this host, once it is authorised; `send` sends replies before the last one.

        Raises:
            VrError: it is refused, or fails.
        """
        request = received.request
        match request:
            case Create():
                whole = await self._whole(request, received.principal)
                return await self._created(whole, received.principal)
            case Reload(page=page, within=within) if (apart := self._apart(page.name)) is not None:
                whole = await self._whole(page, received.principal)
                bundle, clearance = self._admitted(bundle_of(whole), received.principal)
                may, chooses = _reach(bundle, clearance)
                self._expect_apart(clearance, page.name, apart.kept.level)
                again = replace(request, page=whole)
                return await apart.control(again, received.principal, within + 10.0, may, chooses)
            case Reload(page=page, now=now, within=within):
                return await self.reload(
                    bundle_of(await self._whole(page, received.principal)),
                    page.name,
                    origin=page.origin,
                    now=now,
                    within=within,
                    asker=received.principal,
                )
            case DescribeHost(ways_to=keys) if keys and self.placing is not None:
                return replace(self.description(), ways=await self.placing.measured(keys))
            case DescribeHost():
                return self.description()
            case ReadBundle():
                return self.bundles.answer(request)
            case ReadHistory():
                return History(lines=tuple(self._remembered))
            case Migrate(robot=robot, host=host):
                return await self.moves.migrate(robot, host, received.principal)
            case Drain():
                return await self.moves.drain(send)
            case PrepareMove() | TakeRobot() | AskMove():
                return await self.moves.answer(request, received.principal, received.asked)
            case ReadEvents(robot=robot) if (apart := self._apart(robot)) is not None:
                return await apart.control(request, received.principal, 10.0)
            case ReadEvents() | VerifyEvents() if self._history is not None:
                ask = partial(answer_of, self._history, request)
                return await asyncio.get_running_loop().run_in_executor(None, ask)
            case ReadEvents() | VerifyEvents():
                return EventsRead() if isinstance(request, ReadEvents) else EventsVerified()
            case _:
                raise not_for("host", request)

    def _robot_here(self, name: str) -> RobotThere | None:
        """Return what a policy wants to know of a robot of this host."""
        agent = self.agents.get(name)
        if agent is None:
            return None
        bonds = agent.runtime.look(lambda state: state.slots.bonds())
        children = tuple((bond.child.name, bond.description.kinds) for bond in bonds.values())
        return RobotThere(agent.robot.kinds(), children)

    def _apart(self, name: str) -> RobotApart | None:
        """Return the robot of this name that lives in a process of its own."""
        return None if self.apart is None else self.apart.robots.get(name)

    async def _whole(self, page: Create, asker: Principal) -> Create:
        """Return a request with its page, which it may name by its hash alone.

        Raises:
            NoSuchBundle: nobody has it.
        """
        if not page.hash:
            return page
        found = await self.bundles.find(page.hash, asker)
        return replace(found.request(page.name, page.settings), isolate=page.isolate)

    def page_of(self, name: str) -> str:
        """Return the hash of the page of a robot; empty: it is not here."""
        return self._pages.get(name, "")

    def description(self) -> HostDescribed:
        """Describe the host: which robots live here."""
        robots = tuple(sorted(agent.address for agent in self.agents.values() if not agent.gone))
        ended = (*self._ended, *(agent for agent in self.agents.values() if agent.gone))
        abandoned = tuple(f"{agent.robot.name}.{name}" for agent in ended for name in agent.abandoned)
        pages = {robot.name: self._pages.get(robot.name, "") for robot in robots}
        apart = [] if self.apart is None else [one for one in self.apart.robots.values() if one.address]
        robots = tuple(sorted((*robots, *(one.address for one in apart if one.address is not None))))
        pages |= {one.name: one.page for one in apart}
        abandoned += tuple(f"{one.name}.{command}" for one in apart for command in one.abandoned)
        trouble = "" if self._journal is None else self._journal.trouble
        return HostDescribed(
            address=self.address,
            robots=robots,
            abandoned=abandoned,
            pages=pages,
            trouble=trouble,
            instead_of=self.instead_of,
            keeps=self._journal is not None,
            alone=self._only,
            on_way={
                **{name: departure.target for name, departure in self.moves.leaving.items()},
                **{one.name: one.on_way for one in apart if one.on_way},
            },
            load=None if self.placing is None else self.placing.load(),
            ways={} if self.placing is None else self.placing.distances(),
        )


def _say(agent: RobotAgent, heard: _Heard) -> None:
    for level, text, piece in heard:
        agent.runtime.say("", level, text, piece=piece)


def _going_on(state: RobotState) -> str:
    """Say which commands go on, as the end of a sentence."""
    running = [call.command for call in state.calls.live.values() if call.running]
    return f"; {', '.join(running)} goes on" if running else ""


def _page(bundle: Bundle, origin: str) -> KeptPage:
    files, signed, sender = dict(bundle.files), bundle.signed, bundle.sender
    return KeptPage(bundle.source, bundle.path, bundle.wanted, files, origin, signed, sender)


def _reach(bundle: Bundle, clearance: Clearance) -> tuple[Permissions | None, dict[str, str] | None]:
    """Return what a page may do in a process of its own, and the slots for which it chooses children.

    A page that nobody has signed has the permissions that its head declares, if it declares any.
    """
    if is_script(bundle.path):
        return clearance.permissions, None
    may = clearance.permissions
    if may is None and bundle.signed is None:
        from robotree.vr.bundle.requirements import declared  # most hosts need nothing of it

        may = declared(bundle.source, bundle.path).permissions
    return may, choosing(bundle.source)


def behaviours_of(robot: Robot, path: str) -> dict[str, Bundle]:
    """Return the behaviours that a service brings, by names of their robots, `SERVICE-BEHAVIOUR`.

    Args:
        robot: the service; another robot brings none.
        path: of its page, for messages.

    Raises:
        BadName: the two names together are too long.
    """
    if not isinstance(robot, Service):
        return {}
    return {
        check_name(f"{robot.name}-{name}"): Bundle(text, f"{path}/{name}.yaml")
        for name, text in robot.behaviours.items()
    }
