"""A network within one process of the machine: every member is a transport, every fault can be caused.

It behaves as the mesh of processes does (`network/mesh.py`). Between two members there are two channels,
urgent and bulk; what is sent on one of them arrives in its order. Each member lets the others know what it
serves and holds, and knows only what has reached it.

Faults: a member dies (`kill`), or its whole machine without a word (`vanish`); it is stopped (`pause`), or
falls silent while it works (`freeze`); two lose each other (`cut`), in one direction only (`cut_one_way`); a
connection breaks with what is under way (`reset`); requests arrive twice; messages are late by chance.
Silence is noticed after `lease` seconds; until then presence stands, and what is sent waits as in a socket.

Time is an `Agenda`: that of a `VirtualRunner`, where all repeats from its seed, or else of an event loop.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import heapq
import itertools
import math
import os
import threading
from collections import Counter
from collections.abc import AsyncIterator, Callable, Sequence
from functools import partial
from typing import Protocol, TypeVar

import msgspec

from robotree.vr.base.errors import TransportClosed
from robotree.vr.base.pattern import matches
from robotree.vr.base.places import here_of
from robotree.vr.base.policy import OPEN, PolicyGate
from robotree.vr.base.presence import Held, Presence
from robotree.vr.base.principal import Credentials
from robotree.vr.base.transport import (
    ELSEWHERE,
    CutOffHandler,
    End,
    Incoming,
    Occupied,
    OnReply,
    Registration,
    RequestHandler,
    Respond,
    SampleHandler,
    TakeRequest,
)
from robotree.vr.network.on_loop import Replies, answered
from robotree.vr.world.virtual_loop import VirtualLoop

RECONNECT = 0.5
"""[s] at most until a connection that broke is there again: the mesh looks once in this time."""

URGENT, BULK = 0, 1
"""The two channels between two members."""

OnMessage = Callable[[str, str, str, str, bytes], None]
"""Told of each message that arrives: source, target, what it is, under which key, its body."""

_T = TypeVar("_T", bound="MemoryTransport")


class Agenda(Protocol):
    """When something happens."""

    def now(self) -> float:
        """Return the time [s]."""
        ...

    def at(self, when: float, action: Callable[[], None]) -> None:
        """Do something at a time [s], in the order of (time, asking)."""
        ...

    def outside(self) -> None:
        """Let what an action does from now on find no running event loop, as a reader thread of a network."""
        ...


class LoopAgenda:
    """The agenda of an event loop in real time. What comes from other threads is handed over."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        """Take the clock of this loop."""
        self._loop = loop
        self._thread = threading.get_ident()
        self._actions: list[tuple[float, int, Callable[[], None]]] = []
        self._order = itertools.count()
        self.now = loop.time

    def at(self, when: float, action: Callable[[], None]) -> None:
        if threading.get_ident() != self._thread:
            with contextlib.suppress(RuntimeError):  # the loop is closed: nobody is there any more
                self._loop.call_soon_threadsafe(self.at, when, action)
            return
        heapq.heappush(self._actions, (when, next(self._order), action))
        if when > self.now():
            self._loop.call_at(when, self._pump, when)
        else:
            self._loop.call_soon(self._pump, when)

    def outside(self) -> None:
        """See `Agenda.outside`: here actions are callbacks of the loop."""

    def _pump(self, until: float) -> None:
        while self._actions and self._actions[0][0] <= until:
            heapq.heappop(self._actions)[2]()


class Weather(msgspec.Struct):
    """The faults of messages by chance. May be changed at any time."""

    jitter: float = 0.0
    """[s] that a message takes longer at most; on one channel none overtakes another."""
    duplication: float = 0.0
    """Probability that a request arrives twice; nobody hears the second one's replies."""
    loss: float = 0.0
    """Probability that a published sample does not arrive, as from a sender that is too quick."""


class _Way:
    """The way between two members, in one direction: it passes on, holds back, or loses."""

    __slots__ = ("connection", "held", "last", "lost", "network", "silences", "silent", "source", "target")

    def __init__(self, network: MemoryNetwork, source: MemoryTransport, target: MemoryTransport) -> None:
        self.network, self.source, self.target = network, source, target
        self.connection = self.silences = 0
        """How often it was broken, and fell silent: what was under way on a broken connection is gone."""
        self.silent = self.lost = False
        self.held: list[tuple[int, Callable[[], None]]] = []
        self.last = [0.0, 0.0]
        """When the last message arrives, on each channel."""

    def send(self, action: Callable[[], None], channel: int) -> None:
        """Let something happen at the far end."""
        if self.lost:
            return
        if self.silent:
            self.held.append((channel, action))
            return
        network, last = self.network, self.last
        agenda, jitter = network.agenda, network.weather.jitter
        when = agenda.now() + network.delay
        if jitter:
            when += jitter * network.chance()
        if when < last[channel]:  # noqa: PLR1730 # `max` is a call, and this is done very often
            when = last[channel]
        last[channel] = when
        agenda.at(when, partial(self._arrive, self.connection, action))

    def know(self, action: Callable[[], None]) -> None:
        """Let the far end know something: at once, if the network has no delay."""
        network = self.network
        if self.lost or self.silent or network.delay or network.weather.jitter:
            self.send(action, URGENT)
        else:
            self.target.take(action)

    def hush(self) -> None:
        """Fall silent: after a lease the far end counts the source as lost."""
        self.silent = True
        self.silences += 1
        number, network = self.silences, self.network

        def give_up() -> None:
            if self.silent and self.silences == number and not self.lost:
                self.lose()

        network.agenda.at(network.agenda.now() + network.lease, give_up)

    def speak(self) -> None:
        """End the silence."""
        self.silent = False
        held, self.held = self.held, []
        if self.lost:
            self.connect()
        for channel, action in held:
            self.send(action, channel)

    def connect(self) -> None:
        """Be there again after a loss, and tell the far end everything anew."""
        self.lost = False
        source, target = self.source, self.target
        served, tokens = frozenset(source.served), frozenset(source.tokens)
        self.know(lambda: target.meet(source, served, tokens))

    def lose(self) -> None:
        """Count as lost: the far end sees its source no longer, and hears no more replies of it."""
        self.lost = True
        self.held.clear()
        self.target.lose_sight(self.source)
        # behind what was sent before
        agenda, target = self.network.agenda, self.target
        when = max(agenda.now() + self.network.delay, *self.last)
        for exchange in target.exchanges.pop(self.source, {}):
            # a source that is only silent may still begin with it
            later = exchange.void_at + self.network.longest_way if self.silent else 0.0
            agenda.at(max(when, later), partial(target.take, exchange.end))

    def break_off(self) -> None:
        """Lose it, and what is under way with it."""
        self.connection += 1
        self.last = [0.0, 0.0]
        self.lose()

    def _arrive(self, connection: int, action: Callable[[], None]) -> None:
        if connection == self.connection:
            target = self.target
            if target.paused or target.closed:
                target.take(action)
            else:
                action()


class MemoryNetwork:
    """Joins members; causes faults."""

    def __init__(
        self,
        *,
        delay: float = 0.0,
        lease: float = 2.0,
        agenda: Agenda | None = None,
        loop: asyncio.AbstractEventLoop | None = None,
        chance: Callable[[], float] = lambda: 0.5,
    ) -> None:
        """Make an empty network.

        Args:
            delay: [s] one way between members.
            lease: [s] of silence after which a member counts as gone.
            agenda: when things happen; None: that of the event loop.
            loop: on which the handlers of members run; None: the running one.
            chance: 0 to 1, for the weather.
        """
        self.weather = Weather()
        self.gate: PolicyGate = OPEN
        """The policy of those who come from now on."""
        self.delay, self.lease, self.chance = delay, lease, chance
        self.members: list[MemoryTransport] = []
        self.on_message: OnMessage = _ignore
        self.unlisted: set[MemoryTransport] = set()
        """Those that nobody who comes from now on can reach: see `unlist`."""
        self.processes = itertools.count(1)
        """The numbers of its processes."""
        self._loop = loop
        if agenda is not None:
            self.agenda = agenda
        self._thread = threading.get_ident()
        self._ways: dict[tuple[MemoryTransport, MemoryTransport], _Way] = {}
        self._frozen: set[MemoryTransport] = set()
        self._cut: set[tuple[MemoryTransport, MemoryTransport]] = set()
        self._listeners: dict[str, list[MemoryTransport]] = {}

    @property
    def longest_way(self) -> float:
        """[s] that a request and its first reply take together at most."""
        return 2 * (self.delay + self.weather.jitter)

    @functools.cached_property
    def agenda(self) -> Agenda:
        """When things happen: that of the event loop, unless another one was given."""
        loop = self._loop or asyncio.get_running_loop()
        return loop.world if isinstance(loop, VirtualLoop) else LoopAgenda(loop)

    def join(self, name: str = "", *, loop: asyncio.AbstractEventLoop | None = None) -> MemoryTransport:
        """Return the transport of a new member.

        Args:
            name: for messages only.
            loop: on which its handlers run; None: the network's.
        """
        return self.enter(
            MemoryTransport(self, name or f"member-{len(self.members)}", loop=loop or self._loop)
        )

    def enter(self, member: _T) -> _T:
        """Let a transport be a member, which knows all that can be known and is known to all."""
        for other in self.members:
            if other in self.unlisted:
                self._cut |= {(member, other), (other, member)}
            for source, target in ((member, other), (other, member)):
                way = self._ways[source, target] = _Way(self, source, target)
                if self._is_silent(source, target):  # they never met
                    way.silent = way.lost = True
                else:
                    target.meet(source, frozenset(source.served), frozenset(source.tokens))
        self.members.append(member)
        self.changed_subscriptions()
        return member

    # -- faults --------------------------------------------------------------------------------

    def kill(self, member: MemoryTransport) -> None:
        """End a member as `kill -9` would: others see it at once, itself it does nothing any more."""
        self._take_out(member)
        for pair in [pair for pair in self._ways if member in pair]:
            way = self._ways.pop(pair)
            if pair[0] is member and not way.lost:
                way.lose()

    def vanish(self, member: MemoryTransport) -> None:
        """End a member together with its machine: the others notice that it is silent."""
        self._take_out(member)
        for pair in [pair for pair in self._ways if member in pair]:
            way = self._ways.pop(pair)
            if pair[0] is member and not way.silent:
                way.hush()

    def pause(self, member: MemoryTransport) -> None:
        """Stop a member as SIGSTOP does: what is sent to it waits until it goes on."""
        member.paused = True
        self._look_at_ways()

    def resume(self, member: MemoryTransport) -> None:
        """Let a paused member go on: it reads what waits, and what it held present is present again."""
        member.paused = False
        self._look_at_ways()
        member.read_on()

    def freeze(self, member: MemoryTransport) -> None:
        """Silence a member in both directions, while it goes on working."""
        self._frozen.add(member)
        self._look_at_ways()

    def thaw(self, member: MemoryTransport) -> None:
        """Let a frozen member be heard: what it held present is present again."""
        self._frozen.discard(member)
        self._look_at_ways()

    def cut(self, one: MemoryTransport, other: MemoryTransport) -> None:
        """Silence between two members."""
        self._cut |= {(one, other), (other, one)}
        self._look_at_ways()

    def cut_one_way(self, source: MemoryTransport, target: MemoryTransport) -> None:
        """One hears the other no longer."""
        self._cut.add((source, target))
        self._look_at_ways()

    def heal(self, one: MemoryTransport, other: MemoryTransport) -> None:
        """End the silence between two members, in both directions."""
        self._cut -= {(one, other), (other, one)}
        self._look_at_ways()

    def reset(self, one: MemoryTransport, other: MemoryTransport) -> None:
        """Break the connection of two members; what is under way is lost. It is made anew soon."""
        for pair in ((one, other), (other, one)):
            way = self._ways.get(pair)
            if way is not None and not way.lost:
                way.break_off()

        def again() -> None:
            for pair in ((one, other), (other, one)):
                way = self._ways.get(pair)
                if way is not None and way.lost and not way.silent:
                    way.connect()

        self.agenda.at(self.agenda.now() + RECONNECT * self.chance(), again)

    def unlist(self, member: MemoryTransport) -> None:
        """Take a member out of the record: who comes from now on never meets it."""
        self.unlisted.add(member)
        member.judge_itself()

    # -- for the members --------------------------------------------------------------------------

    def way(self, source: MemoryTransport, target: MemoryTransport) -> _Way | None:
        """Return the way from one to another one; None: one of them has ended."""
        return self._ways.get((source, target))

    def inside(self, action: Callable[[], None]) -> None:
        """Do something in the thread of the network: at once, if this is it."""
        if threading.get_ident() == self._thread:
            action()
        else:
            self.agenda.at(self.agenda.now(), action)

    def held(self, member: MemoryTransport, key: str) -> Held:
        """Return what the record says of something that a member holds."""
        asleep = member in self._frozen or member.paused
        how = "which hangs" if asleep else "which runs and could not be reached from here"
        return Held(key, member.name, f"thaw {member.name}", how, asleep)

    def listeners(self, key: str) -> list[MemoryTransport]:
        """Return who subscribes to a key."""
        known = self._listeners.get(key)
        if known is None:
            known = self._listeners[key] = [member for member in self.members if member.hearing(key)]
        return known

    def changed_subscriptions(self) -> None:
        """Somebody subscribes, or does no longer."""
        self._listeners.clear()

    # -- inside -----------------------------------------------------------------------------------

    def _take_out(self, member: MemoryTransport) -> None:
        member.fall()
        self.members.remove(member)
        self.changed_subscriptions()

    def _is_silent(self, source: MemoryTransport, target: MemoryTransport) -> bool:
        return (
            source.paused or (source, target) in self._cut or source in self._frozen or target in self._frozen
        )

    def _look_at_ways(self) -> None:
        for (source, target), way in list(self._ways.items()):
            silent = self._is_silent(source, target)
            if silent and not way.silent:
                way.hush()
            elif way.silent and not silent:
                way.speak()


class _Entry:
    """A registration: takes itself back by calling `undo` once."""

    def __init__(self, undo: Callable[[], object]) -> None:
        self._undo: Callable[[], object] | None = undo

    async def close(self) -> None:
        undo, self._undo = self._undo, None
        if undo is not None:
            undo()


class _Exchange:
    """A request whose replies somebody waits for."""

    __slots__ = ("asked", "asker", "on_reply", "server", "void_at")

    def __init__(
        self, asker: MemoryTransport, server: MemoryTransport, on_reply: OnReply, void_at: float
    ) -> None:
        self.asker, self.server = asker, server
        self.on_reply: OnReply | None = on_reply
        self.asked: tuple[str, bytes, float, bool] = ("", b"", 0.0, False)
        """Key and body, `void_at` and `urgent` as it was asked."""
        self.void_at = void_at
        """[s] until when the server may begin with it; 0: it has answered."""

    def reply(self, body: bytes) -> None:
        """Hand a reply on, if it is still waited for."""
        self.void_at = 0.0
        if self.on_reply is not None:
            self.on_reply(body)

    def end(self) -> None:
        """There are no more."""
        on_reply, self.on_reply = self.on_reply, None
        mine = self.asker.exchanges.get(self.server)
        if mine is not None:
            mine.pop(self, None)
        if on_reply is not None:
            on_reply(None)


class MemoryTransport:
    """One member's transport."""

    def __init__(
        self, network: MemoryNetwork, name: str, *, loop: asyncio.AbstractEventLoop | None = None
    ) -> None:
        """Prepare; `MemoryNetwork.enter` makes it a member."""
        self.network, self.name = network, name
        self.loop = loop or asyncio.get_running_loop()
        self._take = self.loop.take if isinstance(self.loop, VirtualLoop) else self._soon
        """Does what has arrived; nothing may be done after it."""
        self.closed = self.paused = False
        self.identity = Credentials(next(network.processes), os.geteuid())
        self.gate = network.gate
        self.served: dict[str, TakeRequest] = {}
        self.ranks: dict[str, int] = {}
        """Of each key that it serves, or has served: see `Transport.serve`."""
        self.tokens: Counter[str] = Counter()
        """How often it announces each key."""
        self.exchanges: dict[MemoryTransport, dict[_Exchange, None]] = {}
        """Its requests under way, by the one that was asked."""
        self._known: dict[MemoryTransport, tuple[set[str], set[str]]] = {}
        """The keys that each visible member serves and holds."""
        self._where: dict[str, MemoryTransport] = {}
        self.presence = Presence(held=self._held, unheard=self._unheard, hand_on=self._soon)
        self._inbox: list[Callable[[], None]] = []
        """Messages that have arrived while it was paused."""
        self._subscriptions: dict[int, tuple[str, SampleHandler]] = {}
        self._heard: dict[str, list[int]] = {}
        """Which of these a key concerns, as far as it was asked."""
        self._cut_off_handlers: dict[int, CutOffHandler] = {}
        self._cut_off = False
        self._numbers = itertools.count()
        self._tasks: dict[asyncio.Future[None], None] = {}
        self._asking: dict[Replies, None] = {}

    # -- requests ---------------------------------------------------------------------------------

    async def serve(self, key: str, take: TakeRequest, *, rank: int = 0) -> Registration:
        self._check(key)
        self.begin_serving(key, take, rank=rank)
        return _Entry(partial(self.end_serving, key))

    def begin_serving(self, key: str, take: TakeRequest, *, rank: int = 0) -> None:
        """Answer the requests to a key; `rank` as in `Transport.serve`.

        Raises:
            ValueError: this member serves it already.
        """
        if key in self.served:
            raise ValueError(f"{key} is served already")
        self.served[key] = take
        self.ranks[key] = rank
        self._let_know(lambda other: other.learn_server(self, key, there=True))

    def request(
        self, key: str, body: bytes, *, timeout: float, urgent: bool = False, void_at: float = 0.0
    ) -> AsyncIterator[bytes]:
        self._check(key)
        replies = Replies(key, timeout)
        self._asking[replies] = None

        def on_reply(reply: bytes | None) -> None:
            if reply is not None:
                replies.feed(reply)
            else:
                replies.end()
                self._asking.pop(replies, None)

        self._ask(key, bytes(memoryview(body)), void_at, on_reply, urgent=urgent)
        return replies

    def ask(
        self, key: str, body: bytes, *, void_at: float = 0.0, urgent: bool = False, on_reply: OnReply
    ) -> None:
        packed, network = bytes(memoryview(body)), self.network

        def told(reply: bytes | None) -> None:
            network.agenda.outside()
            on_reply(reply)

        network.inside(lambda: self._ask(key, packed, void_at, told, urgent=urgent))

    def after_reading(self, job: Callable[[], bool]) -> bool:
        """See `Transport.after_reading`: no thread reads here."""
        del job
        return False

    def _ask(self, key: str, body: bytes, void_at: float, on_reply: OnReply, *, urgent: bool) -> None:
        if self.closed:
            on_reply(None)
            return
        network = self.network
        server = self if key in self.served else self._where.get(key)
        if server is None:
            if void_at == math.inf:
                self._leave(key, body)
            network.agenda.at(network.agenda.now(), lambda: on_reply(None))
            return
        exchange = _Exchange(self, server, on_reply, 0.0 if void_at == math.inf else void_at)
        exchange.asked = key, body, void_at, urgent
        channel = URGENT if urgent else BULK
        arrive = partial(server.asked, self, exchange, key, body, channel)
        if server is self:
            network.agenda.at(network.agenda.now(), partial(self.take, arrive))
            return
        self.exchanges.setdefault(server, {})[exchange] = None
        way = network.way(self, server)
        if way is not None:
            way.send(arrive, channel)
            if network.weather.duplication and network.chance() < network.weather.duplication:
                way.send(partial(server.asked, self, None, key, body, channel), channel)

    def _leave(self, key: str, body: bytes) -> None:
        """Leave a request with a process that is not seen, which reads it when it wakes: see `Mesh.ask`."""
        for other in self.network.members:
            way = self.network.way(self, other)
            if way is not None and other not in self._known and key in other.served:
                way.send(partial(other.asked, self, None, key, body, URGENT), URGENT)

    def asked(
        self,
        asker: MemoryTransport,
        exchange: _Exchange | None,
        key: str,
        body: bytes,
        channel: int,
    ) -> None:
        """Take a request that has arrived."""
        network = self.network
        network.on_message(asker.name, self.name, "ask", key, body)

        def send(action: Callable[[], None]) -> None:
            if asker is self:
                network.agenda.at(network.agenda.now(), partial(self.take, action))
            elif (way := network.way(self, asker)) is not None:
                way.send(action, channel)

        def respond(reply: bytes) -> None:
            if exchange is not None and not self.closed:
                arrive = partial(asker.replied, self, exchange, bytes(memoryview(reply)))
                network.inside(lambda: send(arrive))

        def end(last: bytes | None) -> None:
            if exchange is not None and not self.closed:
                arrive = partial(asker.ended, self, exchange, last)
                network.inside(lambda: send(arrive))

        def on_loop(handler: RequestHandler) -> None:
            self._take(self._answer, handler, key, body, respond, end)

        take = self.served.get(key)
        if take is None:
            end(ELSEWHERE)
        else:
            network.agenda.outside()
            take(Incoming(body, asker.identity, respond, end, on_loop))

    def ended(self, server: MemoryTransport, exchange: _Exchange, last: bytes | None) -> None:
        """Take the end of the replies, and the last of them."""
        if last is ELSEWHERE:
            self._ask_elsewhere(server, exchange)
            return
        if last is not None:
            self.replied(server, exchange, last)
        exchange.end()

    def _ask_elsewhere(self, server: MemoryTransport, exchange: _Exchange) -> None:
        """Ask who serves a key now that another one serves no longer; nobody may."""
        key, body, void_at, urgent = exchange.asked
        other = self if key in self.served else self._where.get(key)
        on_reply, exchange.on_reply = exchange.on_reply, None
        exchange.end()
        if on_reply is None:
            return
        if other is None or other is server:
            on_reply(None)
        else:
            self._ask(key, body, void_at, on_reply, urgent=urgent)

    def replied(self, server: MemoryTransport, exchange: _Exchange, body: bytes) -> None:
        """Take a reply that has arrived."""
        self.network.on_message(server.name, self.name, "reply", "", body)
        exchange.reply(body)

    def _answer(self, handler: RequestHandler, key: str, body: bytes, respond: Respond, end: End) -> None:
        task = None if self.closed else answered(handler, body, respond, end, key)
        if task is not None:
            self._tasks[task] = None
            task.add_done_callback(self._tasks.pop)

    def end_serving(self, key: str) -> None:
        """Answer them no more."""
        if self.served.pop(key, None) is not None:
            self._let_know(lambda other: other.learn_server(self, key, there=False))

    # -- samples ----------------------------------------------------------------------------------

    def publish(self, key: str, body: bytes) -> None:
        self._check(key)
        packed = bytes(memoryview(body))
        network = self.network
        for member in network.listeners(key):
            hear = partial(member.hear, self, key, packed)
            if member is self:
                network.agenda.at(network.agenda.now(), hear)
            elif not network.weather.loss or network.chance() >= network.weather.loss:
                way = network.way(self, member)
                if way is not None:
                    way.send(hear, BULK)

    def listeners(self, key: str) -> int:
        return len(self.network.listeners(key))

    async def subscribe(self, pattern: str, handler: SampleHandler) -> Registration:
        self._check(pattern)
        return _Entry(partial(self.end_hearing, self.begin_hearing(pattern, handler)))

    def begin_hearing(self, pattern: str, on_sample: SampleHandler) -> int:
        """Take the samples under a pattern; returns a number for `end_hearing`."""
        number = next(self._numbers)
        self._subscriptions[number] = (pattern, on_sample)
        self._heard.clear()
        self.network.changed_subscriptions()
        return number

    def end_hearing(self, number: int) -> None:
        """Take them no more."""
        self._subscriptions.pop(number, None)
        self._heard.clear()
        self.network.changed_subscriptions()

    def patterns(self) -> set[str]:
        """Return the patterns to which it subscribes."""
        return {pattern for pattern, _ in self._subscriptions.values()}

    def hearing(self, key: str) -> list[int]:
        """Return which subscriptions here concern a key."""
        known = self._heard.get(key)
        if known is None:
            known = self._heard[key] = [
                number for number, (pattern, _) in self._subscriptions.items() if matches(pattern, key)
            ]
        return known

    def hear(self, source: MemoryTransport, key: str, body: bytes) -> None:
        """Hand a sample to those who subscribed to it."""
        self.network.on_message(source.name, self.name, "sample", key, body)
        for number in self.hearing(key):
            self._take(self._hand, number, key, body)

    def _hand(self, number: int, key: str, body: bytes) -> None:
        _, handler = self._subscriptions.get(number, ("", None))
        if handler is not None:
            handler(key, body)

    # -- presence ---------------------------------------------------------------------------------

    async def announce(self, key: str, *, unless: Sequence[str] = ()) -> Registration:
        self._check(key)
        found = (other for pattern in unless for other in self.presence.keys(pattern))
        others = [other for other in found if other != key]
        if others := others and here_of(self.presence, others):
            raise Occupied(others)
        self.be_present(key)
        return _Entry(lambda: self.unannounce(key))

    def be_present(self, key: str) -> None:
        """Be present under a key, whoever else is."""
        self.tokens[key] += 1
        if self.tokens[key] == 1:
            self.presence.count(key, there=True)
            self._let_know(lambda other: other.learn_holder(self, key, there=True))

    def held_by_others(self, key: str) -> bool:
        """Whether another member that is seen is present under a key."""
        return any(key in held for _, held in self._known.values())

    async def settle(self, within: float) -> None:
        """See `Transport.settle`: what the network delays or loses nobody acknowledges."""
        self._check("")
        await asyncio.sleep(within)

    def _held(self, pattern: str) -> list[Held]:
        found: list[Held] = []
        for member in self.network.members:
            if member not in self.network.unlisted:
                found += [self.network.held(member, key) for key in member.tokens if matches(pattern, key)]
            elif member is not self:
                asleep = self.network.held(member, "").asleep
                found.append(Held("", member.name, f"list {member.name}", "its entry is gone", asleep))
        return found

    def _unheard(self, pattern: str) -> list[tuple[Held, bool]]:
        """Return what is held by others that are silent, and if they are paused or have long been silent."""
        found: list[tuple[Held, bool]] = []
        for member in self.network.members:
            way = self.network.way(member, self)
            if way is None or member in self.network.unlisted:
                continue
            held = [self.network.held(member, key) for key in member.tokens if matches(pattern, key)]
            found += [
                (one, way.silent and (way.lost or one.asleep))
                for one in held
                if way.silent or not self.presence.there(one.key)
            ]
        return found

    async def watch_itself(self, handler: CutOffHandler) -> Registration:
        self._check("")
        number = next(self._numbers)
        self._cut_off_handlers[number] = handler
        return _Entry(partial(self._cut_off_handlers.pop, number, None))

    def unannounce(self, key: str) -> None:
        """Be present under a key once less."""
        if self.tokens[key] > 1:
            self.tokens[key] -= 1
        elif self.tokens.pop(key, 0):
            self.presence.count(key, there=False, left=True)
            self._let_know(lambda other: other.learn_holder(self, key, there=False))

    # -- what the network brings ------------------------------------------------------------------

    def take(self, action: Callable[[], None]) -> None:
        """Take something that has arrived; a paused process reads it later."""
        if self.paused:
            self._inbox.append(action)
        elif not self.closed:
            action()

    def read_on(self) -> None:
        """Read what has arrived during a pause."""
        inbox, self._inbox = self._inbox, []
        agenda = self.network.agenda
        for action in inbox:
            agenda.at(agenda.now(), partial(self.take, action))

    def meet(self, other: MemoryTransport, served: frozenset[str], tokens: frozenset[str]) -> None:
        """Hear all that another one serves and holds; it is seen from now on."""
        if other.closed:
            return
        before = self._known.setdefault(other, (set(), set()))
        for key in sorted(before[0] - served):
            self.learn_server(other, key, there=False)
        for key in sorted(served):
            self.learn_server(other, key, there=True)
        for key in sorted(before[1] - tokens):
            self.learn_holder(other, key, there=False)
        for key in sorted(tokens):
            self.learn_holder(other, key, there=True)
        self.judge_itself()

    def lose_sight(self, other: MemoryTransport) -> None:
        """Another one has died or fallen silent."""
        if self.closed:
            return
        served, tokens = self._known.pop(other, (set[str](), set[str]()))
        for key in served:
            if self._where.get(key) is other:
                self._find_server(key)
        for key in sorted(tokens):
            self.presence.count(key, there=False)
        self.judge_itself()

    def learn_server(self, other: MemoryTransport, key: str, *, there: bool) -> None:
        """Another one serves a key, or does no longer."""
        if other not in self._known:
            return
        (self._known[other][0].add if there else self._known[other][0].discard)(key)
        if there:
            before = self._where.get(key)
            if before is None or other.ranks.get(key, 0) >= before.ranks.get(key, 0):
                self._where[key] = other
        elif self._where.get(key) is other:
            self._find_server(key)

    def _find_server(self, key: str) -> None:
        """Ask another one for a key from now on, if one serves it."""
        self._where.pop(key, None)
        for other, (served, _) in self._known.items():
            if key in served:
                self.learn_server(other, key, there=True)

    def learn_holder(self, other: MemoryTransport, key: str, *, there: bool) -> None:
        """Another one holds a key present, or does no longer."""
        if other not in self._known or (key in self._known[other][1]) == there:
            return
        (self._known[other][1].add if there else self._known[other][1].discard)(key)
        self.presence.count(key, there=there, left=not there)

    def judge_itself(self) -> None:
        """See whether any other process can reach this one, and say when that changes."""
        cut_off = self in self.network.unlisted and not self._known
        if cut_off != self._cut_off:
            self._cut_off = cut_off
            reason = "no other process can reach it: its entry is gone" if cut_off else ""
            for handler in self._cut_off_handlers.values():
                self._soon(handler, reason)

    def fall(self) -> None:
        """Stop being there: no handler runs any more, what was asked ends."""
        self.closed = True
        self.served.clear()
        self.tokens.clear()
        self._subscriptions.clear()
        self._heard.clear()
        self.presence.close()
        self._inbox.clear()
        for task in self._others():
            task.cancel()
        for replies in list(self._asking):
            replies.shut()

    async def close(self) -> None:
        if self.closed:
            return
        self.network.kill(self)
        await asyncio.gather(*self._others(), return_exceptions=True)

    # -- inside -----------------------------------------------------------------------------------

    def _others(self) -> list[asyncio.Future[None]]:
        """Return what answers requests, the oldest first, without the task that asks."""
        me = _current_task()
        return [task for task in self._tasks if task is not me]

    def _check(self, key: str) -> None:
        if self.closed:
            raise TransportClosed(key=key)

    def _soon(self, action: Callable[..., object], *values: object) -> None:
        """Do something on the event loop of the member, unless that has ended; it says what is raised."""
        if not self.loop.is_closed():
            self.loop.call_soon_threadsafe(action, *values)

    def _let_know(self, news: Callable[[MemoryTransport], None]) -> None:
        for member in self.network.members:
            if member is not self and (way := self.network.way(self, member)) is not None:
                way.know(partial(news, member))


def _ignore(*_: object) -> None:
    """Nobody wants to know."""


def _current_task() -> asyncio.Task[None] | None:
    try:
        return asyncio.current_task()
    except RuntimeError:  # no loop runs here
        return None
