"""Keeps a store up to date from a realm client: arrivals and states as they come, the tree when it changed.

Callbacks of the realm_client arrive on the event loop; asking for the tree costs a question to every robot,
so it is done only after something hinted at a change, and never more often than `PAUSE`.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Protocol

from robotree.tui.errors import SupervisorError
from robotree.tui.seen import absence, unlisted
from robotree.tui.seen.store import Away, SeenGroup, Store
from robotree.tui.seen.watched import Alarm, judging
from robotree.vr.base.address import Address, Role, shown_address
from robotree.vr.base.errors import NoSuchPermit, TransportClosed, VrError
from robotree.vr.network.permit_file import permits_beside
from robotree.vr.supervision.groups import members_among

if TYPE_CHECKING:
    from robotree.vr.base.description import RobotDescription
    from robotree.vr.base.requests import LoggedLine, State
    from robotree.vr.supervision.realm_client import RealmClient

PAUSE = 0.4
"""[s] at least between two looks at the tree."""

GLANCE = 0.2
"""[s] between two looks for processes that are late or hang: the table is asked, not the network."""

WHERE = 1.0
"""[s] between two questions to the gateway where robots of other sites are."""

PATROL = 5.0
"""[s] at most between two looks at the tree, the hosts and the lookup services, hint or no hint."""

RESULTS = "`inbox` prints it, the page of the orders shows it"
"""How a person gets at a result."""

ALARMS = "`alarm ack` acknowledges it, or `k` on the page of the readings"
"""How a person acknowledges an alarm."""

PERMITS = "`permits` shows what it would do, and takes your answer"
"""How a person answers an assistant."""

log = logging.getLogger(__name__)


class AlarmKeeper(Protocol):
    """Keeps the alarms of a realm."""

    def all(self) -> tuple[Alarm, ...]:
        """Return them; the same object while nothing has changed."""
        ...

    def change(self, change: Callable[[dict[str, Alarm]], None]) -> tuple[Alarm, ...]:
        """Change them by name; returns them as they are then."""
        ...


class Feed:
    """Feeds one store from one realm client while it is open."""

    def __init__(
        self,
        realm_client: RealmClient,
        store: Store,
        clock: Callable[[], float],
        alarms: AlarmKeeper | None = None,
    ) -> None:
        """Feed `store` from `realm_client`; `clock` gives its `now` [s]; `alarms` keeps alarms."""
        self.realm_client, self.store, self.clock = realm_client, store, clock
        self.moment_of: Callable[[LoggedLine], float] = lambda _: clock()
        """When a line of a log was said [s on the store's clock]: now; clocks of hosts are not compared."""
        self._hint = asyncio.Event()
        self._open = contextlib.AsyncExitStack()
        self.alarms = alarms
        self._alarms: tuple[Alarm, ...] = ()
        """As they were shown."""
        self._alarming = False
        """Whether they cannot be kept, which was told."""
        self._troubles: dict[str, str] = {}
        """Of hosts whose robots would not survive their end, as told, by name."""

    async def open(self) -> None:
        """Begin to feed: what lookup services list at once, the rest as it comes."""
        client, at_end = self.realm_client, self._open.push_async_callback
        self._take_lists()
        self._open.callback(client.on_change(self._take_lists))
        at_end((await client.watch_state(None, self._take_state)).close)
        at_end((await client.watch_log(None, self._take_lines)).close)
        at_end((await client.orders.on_change(lambda _: self._hint.set())).close)
        for work in (self._keep_looking, self._keep_glancing, self._keep_asking_where):
            at_end(_ended, asyncio.create_task(work(), name=f"feed: {work.__name__}"))

    async def close(self) -> None:
        """End. Twice is once."""
        await self._open.aclose()

    def _take_lists(self) -> None:
        now = self.clock()
        self.store.take_services(self.realm_client.services, now, stale=self.realm_client.stale)
        if not self.realm_client.stale:
            self.store.take_lists(self.realm_client.robots(), self.realm_client.views(), now)
        for address in [one for one in self.store.missed if self.realm_client.left(one)]:
            self.store.departed(address, now, left=True)
        self._hint.set()

    @property
    def _present(self) -> set[Address]:
        return self._present_as("robot", "view") | self._servers

    @property
    def _servers(self) -> set[Address]:
        return self._present_as("host", "lookup", "directory")

    def _present_as(self, *roles: Role) -> set[Address]:
        return {address for role in roles for address in self.realm_client.present(role)}

    def _take_state(self, name: str, state: State) -> None:
        shape = self.store.shape
        self.store.take_state(name, state, self.clock())
        if self.store.shape != shape:
            self._hint.set()

    def _take_lines(self, name: str, lines: Sequence[LoggedLine]) -> None:
        for line in lines:
            self.store.take_line(name, line, self.moment_of(line))

    def hint(self) -> None:
        """Ask for the tree again soon: it has changed."""
        self._hint.set()

    async def _keep_looking(self) -> None:
        while True:
            self._hint.clear()
            await self._look()
            await asyncio.sleep(PAUSE)
            try:
                async with asyncio.timeout(PATROL):
                    await self._hint.wait()
            except TimeoutError:
                continue

    async def _keep_glancing(self) -> None:
        """Show within a second who hangs: a look at the tree, which that holds up, takes longer."""
        with contextlib.suppress(TransportClosed):
            while True:
                self.store.take_late(self.realm_client.late())
                hang = self.realm_client.hang()
                self.store.take_silent(hang, self.clock())
                answering = self._servers.difference(shown_address(one.key) for one in hang)
                self.store.take_servers(answering, self.clock(), left=self.realm_client.left)
                self._take_permits()
                self._take_alarms()
                await asyncio.sleep(GLANCE)

    def _take_permits(self) -> None:
        """Show what assistants ask for; a realm that keeps nothing has no permits."""
        with contextlib.suppress(NoSuchPermit):
            self.store.take_permits(permits_beside(self.realm_client.gate).waiting(), self.clock(), PERMITS)

    def _take_alarms(self) -> None:
        """Keep which readings have passed their thresholds, and show what is kept, also by others."""
        passed, store, keeper = self.store.watched.passed, self.store, self.alarms
        if keeper is None:
            return
        try:
            after = keeper.change(judging(passed, time.time() - self.clock())) if passed else keeper.all()
        except SupervisorError as error:
            if not self._alarming:
                store.tell(str(error), "warning", self.clock())
            self._alarming = True
            return
        self._alarming = False
        passed.clear()
        if after is not self._alarms:
            self._alarms = after
            store.take_alarms(after, self.clock(), ALARMS)

    async def _keep_asking_where(self) -> None:
        """Show where robots of other sites are, and how old that is. Without a gateway nobody is asked."""
        with contextlib.suppress(TransportClosed):
            while True:
                self.store.take_elsewhere(await self.realm_client.elsewhere(), self.clock())
                await asyncio.sleep(WHERE)

    async def _take_unlisted(self, tree: Sequence[RobotDescription]) -> None:
        """Without a lookup service show what `ls` shows then: who is seen alive says itself what it is."""
        if not self.realm_client.stale:
            return
        robots, views = unlisted.robots(self.realm_client, tree), await unlisted.views(self.realm_client)
        if self.realm_client.stale:  # none has come meanwhile
            self.store.take_lists(robots, views, self.clock())

    async def _tell_of_the_missed(self) -> None:
        """Tell whose process has gone, and whose hangs."""
        hanging = await self.realm_client.hanging()
        store, now, present = self.store, self.clock(), self._present
        living = {description.address for description in store.descriptions.values()}
        alive = {*present, *(address for one in hanging if (address := shown_address(one.key)))}
        for address in list(store.missed):
            if address in living:
                store.found(address, now)
            elif address not in alive:
                store.departed(address, now, left=self.realm_client.left(address))
        store.take_silent(hanging, now)
        for address in store.hanging - alive:
            store.departed(address, now, left=self.realm_client.left(address))
        if store.missed:
            self._hint.set()

    def _tell_of_trouble(self, troubles: dict[str, str]) -> None:
        """Tell once of each host whose robots would not survive its end, and when they would again."""
        for name, trouble in troubles.items():
            if trouble != self._troubles.get(name, ""):
                text = trouble or "its robots are kept again"
                self.store.tell(f"host {name}: {text}", "error" if trouble else "good", self.clock())
        self._troubles = troubles

    async def _take_away(self) -> None:
        """Take which robots are away and which results wait, where a directory remembers them."""
        orders, now = self.realm_client.orders, time.time()
        if not orders.directories:
            self.store.take_away({})
            return
        present = {address.name for address in self.realm_client.present("robot")}
        holds = await orders.holds()
        self.store.take_away(
            {
                each.name: Away(each.robot, each.readings, absence.with_holds(each, holds, now))
                for each in await orders.known()
                if each.robot is not None and not each.deleted and each.name not in present
            }
        )
        self.store.take_results(len(await orders.inbox()), self.clock(), RESULTS)

    def _take_groups(self, tree: Sequence[RobotDescription]) -> None:
        """Take who is in each group now, from what robots have just said of themselves."""
        found: dict[str, SeenGroup] = {}
        for name, group in self.realm_client.groups.all().items():
            try:
                members = members_among(self.realm_client, group, tree)
            except VrError as error:  # its rule names a group that there is no more
                found[name] = SeenGroup(str(error))
            else:
                found[name] = SeenGroup(group.about, tuple(one.name for one in members if one.sure))
        self.store.take_groups(found)

    async def _look(self) -> None:
        try:
            tree = await self.realm_client.tree()
            # of these, some have answered before that
            hang = {shown_address(one.key) for one in self.realm_client.hang()}
            tree = [robot for robot in tree if robot.address not in hang]
            self.store.take_descriptions(tree, self.clock())
            await self._take_unlisted(tree)
            await self._tell_of_the_missed()
            self.store.take_processes(self.realm_client.held())
            hosts = await self.realm_client.hosts()
            self.store.take_hosts(hosts)
            self._tell_of_trouble({host.address.name: host.trouble for host in hosts})
            self.store.take_services(self.realm_client.services, self.clock(), stale=self.realm_client.stale)
            await self._take_away()
            self._take_groups(tree)
        except VrError as error:
            self.store.tell(f"cannot see the tree: {error}", "warning", self.clock())
        except Exception:  # the last fence of this task: the supervisor goes on with what it knows
            log.exception("a look at the tree failed")
            self.store.tell("cannot see the tree: the log file says why", "error", self.clock())


async def _ended(task: asyncio.Task[None]) -> None:
    """End a task, whatever has become of it."""
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
