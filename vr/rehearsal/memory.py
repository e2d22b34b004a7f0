"""A network within one process: every member is a transport, and every accident can be caused on purpose.

For tests, and for a whole fleet without a network. It behaves as the one between processes does, with its
accidents at will: a member dies (`kill`), falls silent as a stopped process does (`freeze`), or two lose
sight of each other (`cut`). Silence is noticed after `lease` seconds; until then presence stands, and what
is sent is held back as a socket would. Time is the event loop's, chance there is none.
"""

from __future__ import annotations

import asyncio
import heapq
import itertools
import logging
from collections.abc import AsyncIterator, Callable
from functools import partial

from robotree.vr.errors import TransportClosed
from robotree.vr.network.pattern import matches
from robotree.vr.network.replies import Replies
from robotree.vr.rehearsal.memory_link import Link
from robotree.vr.transport import (
    CutOffHandler,
    Held,
    PresenceHandler,
    Registration,
    RequestHandler,
    SampleHandler,
    Unlisted,
)

_log = logging.getLogger(__name__)


class MemoryNetwork:
    """Joins members; causes accidents."""

    def __init__(self, *, delay: float = 0.0, lease: float = 2.0) -> None:
        """Make an empty network.

        Args:
            delay: [s] one way between members.
            lease: [s] of silence after which a member counts as gone.
        """
        self.delay, self.lease = delay, lease
        self.members: list[MemoryTransport] = []
        self._links: dict[frozenset[MemoryTransport], Link] = {}
        self._frozen: set[MemoryTransport] = set()
        self._cut: set[frozenset[MemoryTransport]] = set()
        self.unlisted: set[MemoryTransport] = set()
        """Those whom nobody who comes from now on can reach: see `unlist`."""
        self._posts: list[tuple[float, int, Callable[[], None]]] = []
        self._order = itertools.count()

    def join(self, name: str = "") -> MemoryTransport:
        """Return the transport of a new member. The name is for messages only."""
        member = MemoryTransport(self, name or f"member-{len(self.members)}")
        self._cut.update(frozenset((member, other)) for other in self.unlisted)
        self.members.append(member)
        self._look_at_links()
        self.refresh()
        return member

    def kill(self, member: MemoryTransport) -> None:
        """End a member as `kill -9` would: others see it at once, itself it does nothing any more."""
        member.fall()
        self.members.remove(member)
        for pair in [pair for pair in self._links if member in pair]:
            self._links.pop(pair).lose()
        self.refresh()

    def freeze(self, member: MemoryTransport) -> None:
        """Silence a member in both directions, as a stopped process is."""
        self._frozen.add(member)
        self._look_at_links()

    def thaw(self, member: MemoryTransport) -> None:
        """Let a frozen member go on: what it held present is present again."""
        self._frozen.discard(member)
        self._look_at_links()

    def cut(self, one: MemoryTransport, other: MemoryTransport) -> None:
        """Silence between two members."""
        self._cut.add(frozenset((one, other)))
        self._look_at_links()

    def heal(self, one: MemoryTransport, other: MemoryTransport) -> None:
        """End the silence between two members."""
        self._cut.discard(frozenset((one, other)))
        self._look_at_links()

    def unlist(self, member: MemoryTransport) -> None:
        """Take a member out of the record: who comes from now on never meets it."""
        self.unlisted.add(member)
        self.refresh()

    # -- for the members and links ----------------------------------------------------------------

    def link(self, one: MemoryTransport, other: MemoryTransport) -> Link:
        """Return the link between two members; one that leads to itself is always up."""
        pair = frozenset((one, other))
        if pair not in self._links:
            self._links[pair] = Link(self)
        return self._links[pair]

    def post(self, delay: float, action: Callable[[], None]) -> None:
        """Do something later, in the order of (time, posting)."""
        loop = asyncio.get_running_loop()
        when = loop.time() + delay
        heapq.heappush(self._posts, (when, next(self._order), action))
        if delay > 0:
            loop.call_at(when, self._pump, when)
        else:
            loop.call_soon(self._pump, when)

    def held(self, member: MemoryTransport, key: str) -> Held:
        """Return what the record says of something that a member holds."""
        frozen = member in self._frozen
        how = "which hangs" if frozen else "which lives and could not be reached from here"
        return Held(key, member.name, f"thaw {member.name}", how, frozen)

    def refresh(self) -> None:
        """Let every watcher compare what it sees with what it saw."""
        for member in self.members:
            member.look()

    def _pump(self, until: float) -> None:
        while self._posts and self._posts[0][0] <= until:
            _, _, action = heapq.heappop(self._posts)
            try:
                action()
            except Exception:  # noqa: BLE001 # one handler's fault must not hide a sample from the next
                _log.exception("a handler raised")

    def _look_at_links(self) -> None:
        for one, other in itertools.combinations(self.members, 2):
            pair = frozenset((one, other))
            silent = pair in self._cut or not self._frozen.isdisjoint(pair)
            known = pair in self._links
            link = self.link(one, other)
            if not silent:
                link.speak()
                continue
            link.hush()
            if not known:  # they never met
                link.lose()


class _Entry:
    """A registration: takes itself back by calling `undo` once."""

    def __init__(self, undo: Callable[[], object]) -> None:
        self._undo: Callable[[], object] | None = undo

    async def close(self) -> None:
        undo, self._undo = self._undo, None
        if undo is not None:
            undo()


class _Watch:
    """One watcher of presence and what it was told."""

    def __init__(self, pattern: str, handler: PresenceHandler) -> None:
        self.pattern, self.handler = pattern, handler
        self.told: set[str] = set()


class MemoryTransport:
    """One member's transport."""

    def __init__(self, network: MemoryNetwork, name: str) -> None:
        """Made by `MemoryNetwork.join`."""
        self.network, self.name = network, name
        self.closed = False
        self.served: dict[str, RequestHandler] = {}
        self.tokens: list[str] = []
        self._subscriptions: dict[int, tuple[str, SampleHandler]] = {}
        self._watches: dict[int, _Watch] = {}
        self._cut_off_handlers: dict[int, CutOffHandler] = {}
        self._cut_off = False
        self._numbers = itertools.count()
        self._tasks: set[asyncio.Task[None]] = set()
        self._asking: set[Replies] = set()

    async def serve(self, key: str, handler: RequestHandler) -> Registration:
        """See `Transport.serve`."""
        self._check(key)
        if key in self.served:
            raise ValueError(f"{key} is served already")
        self.served[key] = handler
        return _Entry(partial(self.served.pop, key, None))

    def request(self, key: str, body: bytes, *, timeout: float, urgent: bool = False) -> AsyncIterator[bytes]:
        """See `Transport.request`; there is no queue here that an urgent one could jump."""
        del urgent
        self._check(key)
        replies = Replies(key, timeout)
        for server in (self, *self.network.members):
            if key in server.served and self._sees(server):
                self._ask(server, key, bytes(memoryview(body)), replies)
                return replies
        self.network.post(0.0, replies.end)
        return replies

    def publish(self, key: str, body: bytes) -> None:
        """See `Transport.publish`."""
        self._check(key)
        packed = bytes(memoryview(body))
        for member in self.network.members:
            self._send(member, partial(member.hear, key, packed))

    async def subscribe(self, pattern: str, handler: SampleHandler) -> Registration:
        """See `Transport.subscribe`."""
        self._check(pattern)
        number = next(self._numbers)
        self._subscriptions[number] = (pattern, handler)
        return _Entry(partial(self._subscriptions.pop, number, None))

    async def announce(self, key: str) -> Registration:
        """See `Transport.announce`."""
        self._check(key)
        self.tokens.append(key)
        self.network.refresh()
        return _Entry(lambda: self._unannounce(key))

    async def watch(self, pattern: str, handler: PresenceHandler) -> Registration:
        """See `Transport.watch`."""
        self._check(pattern)
        watch = _Watch(pattern, handler)
        watch.told = set(self._visible(pattern))
        for key in sorted(watch.told):
            handler(key, True)
        number = next(self._numbers)
        self._watches[number] = watch
        return _Entry(partial(self._watches.pop, number, None))

    async def present(self, pattern: str) -> list[str]:
        """See `Transport.present`."""
        self._check(pattern)
        return self._visible(pattern)

    async def silent(self, pattern: str) -> list[Held]:
        """See `Transport.silent`."""
        seen = set(self._visible(pattern))
        return [one for one in await self.held(pattern) if one.key not in seen]

    async def held(self, pattern: str) -> list[Held]:
        """See `Transport.held`."""
        self._check(pattern)
        return [
            self.network.held(member, key)
            for member in self.network.members
            if member not in self.network.unlisted
            for key in member.tokens
            if matches(pattern, key)
        ]

    async def unlisted(self) -> list[Unlisted]:
        """See `Transport.unlisted`."""
        self._check("")
        return [
            Unlisted(member.name, "its entry is gone", f"list {member.name}")
            for member in self.network.members
            if member in self.network.unlisted and member is not self
        ]

    async def watch_itself(self, handler: CutOffHandler) -> Registration:
        """See `Transport.watch_itself`."""
        self._check("")
        number = next(self._numbers)
        self._cut_off_handlers[number] = handler
        return _Entry(partial(self._cut_off_handlers.pop, number, None))

    async def close(self) -> None:
        """See `Transport.close`."""
        if not self.closed:
            self.network.kill(self)
            await asyncio.gather(*self._tasks - {asyncio.current_task()}, return_exceptions=True)

    # -- for the network --------------------------------------------------------------------------

    def fall(self) -> None:
        """Stop being there: no handler runs any more, whatever was asked ends."""
        self.closed = True
        self.served.clear()
        self.tokens.clear()
        self._subscriptions.clear()
        self._watches.clear()
        for task in self._tasks:
            task.cancel()
        for replies in self._asking:
            replies.shut()

    def hear(self, key: str, body: bytes) -> None:
        """Hand a sample to whoever subscribed to it."""
        for pattern, handler in list(self._subscriptions.values()):
            if matches(pattern, key):
                handler(key, body)

    def look(self) -> None:
        """Tell each watcher what came and went since it was told last."""
        cut_off = self in self.network.unlisted and not any(map(self._sees, self._others()))
        if cut_off != self._cut_off:
            self._cut_off = cut_off
            for handler in self._cut_off_handlers.values():
                reason = "no other process can reach it: its entry is gone" if cut_off else ""
                self.network.post(self.network.delay, partial(handler, reason))
        for watch in self._watches.values():
            now = set(self._visible(watch.pattern))
            changes = sorted((key, key in now) for key in now ^ watch.told)
            watch.told = now
            for key, there in changes:
                self.network.post(self.network.delay, partial(self._notify, watch, key, there))

    # -- inside -----------------------------------------------------------------------------------

    def _notify(self, watch: _Watch, key: str, there: bool) -> None:  # noqa: FBT001 # as the handler takes it
        if watch in self._watches.values():
            watch.handler(key, there)

    def _others(self) -> list[MemoryTransport]:
        return [member for member in self.network.members if member is not self]

    def _check(self, key: str) -> None:
        if self.closed:
            raise TransportClosed(key=key)

    def _sees(self, other: MemoryTransport) -> bool:
        return other is self or not self.network.link(self, other).lost

    def _visible(self, pattern: str) -> list[str]:
        return sorted(
            {
                key
                for member in self.network.members
                if self._sees(member)
                for key in member.tokens
                if matches(pattern, key)
            }
        )

    def _send(self, other: MemoryTransport, action: Callable[[], None]) -> None:
        if other is self:
            self.network.post(0.0, action)
        else:
            self.network.link(self, other).send(action)

    def _unannounce(self, key: str) -> None:
        if key in self.tokens:
            self.tokens.remove(key)
            self.network.refresh()

    def _ask(self, server: MemoryTransport, key: str, body: bytes, replies: Replies) -> None:
        self._asking.add(replies)
        if server is not self:
            self.network.link(self, server).exchanges.add(replies)
        self._send(server, lambda: server.answer(self, key, body, replies))

    def answer(self, asker: MemoryTransport, key: str, body: bytes, replies: Replies) -> None:
        """Start the handler of a key on a request that has arrived."""
        handler = self.served.get(key)

        def end() -> None:
            asker.done_asking(self, replies)

        if handler is None:
            self._send(asker, end)
            return

        def respond(reply: bytes) -> None:
            packed = bytes(memoryview(reply))
            self._send(asker, lambda: replies.feed(packed))

        async def run() -> None:
            try:
                await handler(body, respond)
            except Exception:  # noqa: BLE001 # the contract: logged, and the reply ends
                _log.exception("the handler of %s raised", key)
            if not self.closed:
                self._send(asker, end)

        task = asyncio.get_running_loop().create_task(run(), name=f"{self.name} answers {key}")
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def done_asking(self, server: MemoryTransport, replies: Replies) -> None:
        """The server's last word has arrived."""
        replies.end()
        self._asking.discard(replies)
        if server is not self:
            self.network.link(self, server).exchanges.discard(replies)
