"""A space as an agent: one process owns the store, and serves it to all others of the realm.

Requests are carried out in the thread that reads them. One thread at a time uses the store: it also carries
out what other threads have read meanwhile, all of it in one transaction of the store (group commit). A
request that must wait for an entry or a fence is kept here, and tried again when something has changed.

What belongs to a program that has gone ends at once: its waiting, its transactions, its fences.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Any

from robotree.vr.base.address import Address
from robotree.vr.base.entry import LARGEST_ENTRY, marks_of
from robotree.vr.base.envelope import Received
from robotree.vr.base.errors import BadEntry, FenceHeld, Garbled, SpaceError, SpaceFull
from robotree.vr.base.principal import Principal
from robotree.vr.base.requests import (
    FOR_EVER,
    AcquireFence,
    AnyRequest,
    CloseTransaction,
    DescribeSpace,
    Done,
    EntriesCame,
    EntriesFound,
    EntryLeased,
    FenceGranted,
    FindEntries,
    GiveUp,
    OpenTransaction,
    Raised,
    RenewEntry,
    RenewFence,
    Reply,
    RollBack,
    SpaceDescribed,
    TransactionOpened,
    WatchEntries,
    WriteEntry,
    encode,
)
from robotree.vr.base.transport import Incoming, Transport
from robotree.vr.exchange.authority import Here
from robotree.vr.exchange.claim import Declarations, claim, new_address
from robotree.vr.exchange.dispatcher import Dispatcher, not_for, refusal
from robotree.vr.space.store import EntryNews, SpaceStore

LONGEST_TRANSACTION = 3600.0
"""[s]"""
LONGEST_FENCE = 7 * 24 * 3600.0
"""[s]"""
MOST_AT_ONCE = 1000
"""Entries in one answer."""
MOST_WAITING = 10_000
"""Requests that wait."""
SWEEP = 1.0
"""[s] between two looks for what has ended, and for changes of which no news came."""
KEPT_ANSWERED, MOST_ANSWERED = 600.0, 10_000
"""[s] and number of answers that are known again, or can be given back."""
MOST_NEWS = 1024
"""Entries that have become visible and are remembered for those who watch."""

_log = logging.getLogger(__name__)


class SpaceRequest:
    """One request that has come."""

    __slots__ = ("agent", "answer", "looks_for", "marks", "principal", "request", "until")

    def __init__(
        self, request: AnyRequest, principal: Principal, until: float, answer: Callable[[Reply], None]
    ) -> None:
        """Take it.

        Args:
            request: what is asked.
            principal: who asks.
            until: [s] on the service's clock, how long it waits.
            answer: answers it; in any thread.
        """
        self.request, self.principal, self.until, self.answer = request, principal, until, answer
        self.agent = principal.agent
        """Key under which the asker is present; empty: under none."""
        self.marks: frozenset[str] | None = None
        """The marks of the entries that it waits for; None: it waits for a fence."""
        if isinstance(request, FindEntries | WatchEntries):
            self.marks = marks_of((request.kind,) if request.kind else (), request.fields)
        about = (getattr(request, name, None) for name in ("take", "transaction", "since", "name"))
        self.looks_for = (type(request), self.marks, *about)
        """Two requests that wait have the same if none of them is answered where the other is not."""


class SpaceService:
    """See the module."""

    def __init__(self, transport: Transport, name: str, store: SpaceStore) -> None:
        """Prepare, on the event loop.

        Args:
            transport: where it serves.
            name: of the space, unique in the realm.
            store: where its entries are; closed by who has opened it.

        Raises:
            BadName: the name cannot be one.
        """
        self.address = new_address("space", name)
        self._transport, self._store = transport, store
        self._loop = asyncio.get_running_loop()
        self._now = self._loop.time
        self._lock = threading.Lock()
        """Guards the next two; held for moments only."""
        self._asked: list[SpaceRequest | Callable[[], None]] = []
        """Requests that have come, and other work, in their order."""
        self._busy = False
        """Whether a thread uses the store and all that follows."""
        self._waiting: dict[int, SpaceRequest] = {}
        """Requests that wait, the oldest first."""
        self._number = 0
        self._answered: OrderedDict[str, tuple[float, Reply]] = OrderedDict()
        """The latest answers, by `ask`: the time [s], and the reply."""
        self._returns: dict[str, Callable[[], object]] = {}
        """Functions that take back what such an answer gave."""
        self._transactions: dict[str, set[str]] = {}
        """Open transactions by the agent that has opened them."""
        self._fences: dict[str, set[tuple[str, int]]] = {}
        """Fences, name and epoch, by the agent that holds them."""
        self._heard: list[EntryNews] = []
        """News of a bell that nobody has looked at."""
        self._news: list[tuple[int, EntryNews]] = []
        """Entries that have become visible lately, with numbers."""
        self._came = 0
        """How many entries have become visible."""
        self._fence_news = False
        """Whether a fence may have become free."""
        self._wake_at = math.inf
        self._wake = asyncio.Event()
        self._declared = Declarations()
        self._answers: dict[type[AnyRequest], Callable[[Any, SpaceRequest], Reply | None]] = {
            WriteEntry: self._write,
            FindEntries: self._find,
            GiveUp: self._give_up,
            RenewEntry: self._renew,
            OpenTransaction: self._open,
            CloseTransaction: self._close,
            RollBack: self._close,
            AcquireFence: self._acquire,
            RenewFence: self._renew_fence,
            WatchEntries: self._watch,
            DescribeSpace: self._describe,
        }
        """Do what is asked; None: it has to wait."""
        store.rings = self._rung

    async def start(self) -> None:
        """Serve, then be there.

        Raises:
            DuplicateName: another space has this name.
        """
        async with Declarations() as declared:
            dispatcher = Dispatcher(
                self.address.name,
                lambda received, _: self._refuse(received.request),
                now=self._now,
                at_once=dict.fromkeys(self._answers, self._take),
                here=Here("space", self.address.name, self._transport.gate),
            )
            await declared.keep(self._transport.serve(self.address.key, dispatcher.take))
            declared.callback(self._transport.presence.watch("**", self._seen))
            declared.work(self._sweep(), f"{self.address.name} sweeps")
            await declared.keep(claim(self._transport, self.address))
            self._declared = declared.pop_all()

    async def close(self) -> None:
        """End it. Twice is once."""
        await self._declared.aclose()

    # -- who comes and goes -----------------------------------------------------------------------

    def _refuse(self, request: AnyRequest) -> Reply:
        raise not_for("space", request)

    def _take(self, received: Received, incoming: Incoming) -> None:
        request = received.request
        if isinstance(request, WriteEntry) and len(incoming.body) > LARGEST_ENTRY:
            reason = f"it has {len(incoming.body)} bytes, more than {LARGEST_ENTRY}; keep less in it"
            raise BadEntry(kind=request.entry.kind, reason=reason)
        within = max(0.0, getattr(request, "within", 0.0))
        self._enter(
            SpaceRequest(
                request,
                received.principal,
                received.asked + within,
                lambda reply: incoming.end(encode(reply)),
            )
        )
        if not (self._store.slow and self._transport.after_reading(self._work_through)):
            self._work_through()

    def _rung(self) -> None:
        """Others have changed the store: in any thread."""
        self._enter(self._hear_bell)
        self._work_through()

    def _hear_bell(self) -> None:
        self._fence_news = True
        self._heard.append(None)

    def _seen(self, key: str, there: bool) -> None:  # noqa: FBT001 # a PresenceHandler
        if not there and (key in self._transactions or key in self._fences or self._waiting):
            self._enter(lambda: self._forget(key))
            self._wake_at = 0.0
            self._wake.set()

    def _forget(self, agent: str) -> None:
        """End all that belongs to an agent which has gone."""
        for number in [n for n, asked in self._waiting.items() if asked.agent == agent]:
            del self._waiting[number]
        for transaction in sorted(self._transactions.pop(agent, ())):
            self._store.roll_back(transaction)
        for name, epoch in sorted(self._fences.pop(agent, ())):
            with contextlib.suppress(SpaceError):
                self._store.renew_fence(name, epoch, 0.0)
                self._fence_news = True

    # -- one thread at a time ---------------------------------------------------------------------

    def _enter(self, work: SpaceRequest | Callable[[], None]) -> None:
        with self._lock:
            self._asked.append(work)

    def _work_through(self) -> bool:
        """Do what has come, unless another thread is just doing that; then it does this, too."""
        with self._lock:
            if self._busy:
                return True
            self._busy = True
        while True:
            with self._lock:
                batch, self._asked = self._asked, []
                if not batch:
                    self._busy = False
                    return True
            self._carry_out(batch)

    def _carry_out(self, batch: list[SpaceRequest | Callable[[], None]]) -> None:
        answers: list[tuple[SpaceRequest, Reply]] = []
        served: dict[int, SpaceRequest] = {}
        try:
            with self._store.together():
                for work in batch:
                    if not isinstance(work, SpaceRequest):
                        try:
                            work()
                        except SpaceError as error:
                            _log.warning("%s", error)
                    elif (reply := self._answer_of(work)) is not None:
                        answers.append((work, reply))
                    else:
                        self._wait(work)
                for number, asked, reply in self._no_longer_waiting():
                    served[number] = asked
                    answers.append((asked, reply))
        except SpaceError as error:  # nothing of it was kept
            for asked, _ in answers:
                ask = getattr(asked.request, "ask", "")
                self._answered.pop(ask, None)
                self._returns.pop(ask, None)
            answers = [(asked, Raised.of(error)) for asked, _ in answers if asked not in served.values()]
            self._waiting.update(served)
        for asked, reply in answers:
            asked.answer(reply)

    def _answer_of(self, asked: SpaceRequest) -> Reply | None:
        """Do what is asked, or say again what was answered before; None: it has to wait."""
        request = asked.request
        ask = "" if isinstance(request, GiveUp) else getattr(request, "ask", "")
        if ask and (before := self._answered.get(ask)) is not None:
            return before[1]
        try:
            reply = self._answers[type(request)](request, asked)
            if ask and reply is not None and _changes(request):
                self._remember(ask, reply)
            return reply  # noqa: TRY300 # what follows is about errors alone
        except Exception as error:  # noqa: BLE001 # the asker gets an answer, whatever happens
            return refusal(error, self.address.name)

    def _wait(self, asked: SpaceRequest) -> None:
        self._number += 1
        self._waiting[self._number] = asked
        self._remind(asked.until)

    def _no_longer_waiting(self) -> list[tuple[int, SpaceRequest, Reply]]:
        """Try those again for which something may have changed; return those that are answered.

        When one has found nothing, the next one that looks for the same is not tried: of a thousand that wait
        for one entry only two are.
        """
        answered: list[tuple[int, SpaceRequest, Reply]] = []
        heard, fences, now = [*self._heard, *self._store.news()], self._fence_news, self._now()
        self._heard, self._fence_news = [], False
        for marks in heard:
            self._came += 1
            self._news.append((self._came, marks))
        in_vain: set[tuple[object, ...]] = set()
        for number, asked in list(self._waiting.items()) if self._waiting else ():
            wanted = asked.marks
            concerned = fences if wanted is None else any(one is None or wanted <= one for one in heard)
            if not (concerned and asked.looks_for not in in_vain) and asked.until > now:
                continue
            reply = self._answer_of(asked)
            if reply is None:
                in_vain.add(asked.looks_for)
            else:
                del self._waiting[number]
                answered.append((number, asked, reply))
        return answered

    def _write(self, request: WriteEntry, _: SpaceRequest) -> Reply:
        term = _term(request.term, FOR_EVER)
        id_, granted = self._store.write(request.entry, term, request.key, request.transaction)
        return EntryLeased(id=id_, term=granted)

    def _renew(self, request: RenewEntry, _: SpaceRequest) -> Reply:
        term = self._store.renew(request.id, _term(request.term, FOR_EVER, ends=True))
        return EntryLeased(id=request.id, term=term)

    def _open(self, request: OpenTransaction, asked: SpaceRequest) -> Reply:
        transaction = self._store.open(granted := _term(request.term, LONGEST_TRANSACTION))
        self._transactions.setdefault(asked.agent, set()).add(transaction)
        self._remind(self._now() + granted)
        return TransactionOpened(transaction=transaction, term=granted)

    def _close(self, request: CloseTransaction | RollBack, asked: SpaceRequest) -> Reply:
        opened = self._transactions.get(asked.agent, set())
        opened.discard(request.transaction)
        if not opened:
            self._transactions.pop(asked.agent, None)
        commits = isinstance(request, CloseTransaction)
        (self._store.commit if commits else self._store.roll_back)(request.transaction)
        return Done()

    def _find(self, request: FindEntries, asked: SpaceRequest) -> Reply | None:
        most = max(1, min(request.most, MOST_AT_ONCE))
        rows = self._store.find(
            request.kind, request.fields, request.transaction, take=request.take, most=most
        )
        if not rows and not self._is_over(asked):
            return None
        if rows and request.take and request.ask and not request.transaction:
            self._returns[request.ask] = lambda: self._store.put_back(rows)
        return EntriesFound(entries=tuple((row.id, row.entry) for row in rows), ask=request.ask)

    def _is_over(self, asked: SpaceRequest) -> bool:
        """Whether one waits no longer.

        Raises:
            SpaceFull: too many wait.
        """
        if asked.until > self._now() and len(self._waiting) >= MOST_WAITING:
            raise SpaceFull(space=self.address.name, reason=f"{MOST_WAITING} requests wait")
        return asked.until <= self._now()

    def _give_up(self, request: GiveUp, _: SpaceRequest) -> Reply:
        ask = request.ask
        for number, asked in self._waiting.items():
            if getattr(asked.request, "ask", "") == ask:
                del self._waiting[number]
                break
        self._answered.pop(ask, None)
        if (give_back := self._returns.pop(ask, None)) is not None:
            give_back()
        return Done()

    def _remember(self, ask: str, reply: Reply) -> None:
        """Take note of an answer: its asker may ask again, or not have got it."""
        self._answered[ask] = (self._now(), reply)
        if len(self._answered) > MOST_ANSWERED:
            self._forget_answer()

    def _forget_answer(self) -> None:
        ask, _ = self._answered.popitem(last=False)
        self._returns.pop(ask, None)

    def _watch(self, request: WatchEntries, asked: SpaceRequest) -> Reply | None:
        if request.since < 0:
            return EntriesCame(number=self._came)
        del self._news[:-MOST_NEWS]
        oldest = self._news[0][0] if self._news else self._came + 1
        wanted = asked.marks or frozenset()
        came = (
            not oldest - 1 <= request.since <= self._came  # it is not known: so it may be
            or any(n > request.since and (one is None or wanted <= one) for n, one in self._news)
        )
        return EntriesCame(number=self._came, came=came) if came or self._is_over(asked) else None

    def _acquire(self, request: AcquireFence, asked: SpaceRequest) -> Reply | None:
        term = _term(request.term, LONGEST_FENCE)
        fence = self._store.acquire(request.name, _name_of(asked.principal), term)
        if fence.granted:
            if asked.agent:
                self._fences.setdefault(asked.agent, set()).add((request.name, fence.epoch))
            if request.ask:
                let_go = RenewFence(name=request.name, epoch=fence.epoch, term=0.0)
                self._returns[request.ask] = lambda: self._renew_fence(let_go, asked)
            return FenceGranted(epoch=fence.epoch, term=fence.left)
        if self._is_over(asked):
            raise FenceHeld(name=request.name, holder=fence.holder, seconds=fence.left)
        self._remind(self._now() + fence.left)
        return None

    def _renew_fence(self, request: RenewFence, asked: SpaceRequest) -> Reply:
        term = _term(request.term, LONGEST_FENCE, ends=True)
        fence = self._store.renew_fence(request.name, request.epoch, term)
        if not term:
            self._fence_news = True
            held = self._fences.get(asked.agent, set())
            held.discard((request.name, request.epoch))
            if not held:
                self._fences.pop(asked.agent, None)
        return FenceGranted(epoch=fence.epoch, term=fence.left)

    def _describe(self, request: DescribeSpace, _: SpaceRequest) -> Reply:
        contents = self._store.contents(request.kind, min(request.most, MOST_AT_ONCE))
        return SpaceDescribed(
            address=self.address,
            store=self._store.where,
            durability=self._store.durability,
            counts=contents.counts,
            transactions=contents.transactions,
            waiting=len(self._waiting),
            entries=contents.entries,
            fences=contents.fences,
        )

    # -- what has ended ---------------------------------------------------------------------------

    def _remind(self, at: float) -> None:
        """Look at a time [s] for what has ended."""
        if at < self._wake_at:
            self._wake_at = at
            with contextlib.suppress(RuntimeError):  # the loop is closed
                self._loop.call_soon_threadsafe(self._wake.set)

    async def _sweep(self) -> None:
        while True:
            self._wake.clear()
            left = min(SWEEP, self._wake_at - self._now())
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(max(0.0, left)):
                    await self._wake.wait()
            if self._wake_at > self._now() and self._wake.is_set():
                continue
            self._enter(self._expire)
            if self._store.slow:
                await asyncio.to_thread(self._work_through)
            else:
                self._work_through()

    def _expire(self) -> None:
        self._wake_at = math.inf
        self._remind(self._now() + max(self._store.expire(), 0.0))
        for asked in self._waiting.values():
            self._remind(asked.until)
        self._fence_news = True
        latest = self._now() - KEPT_ANSWERED
        while self._answered and next(iter(self._answered.values()))[0] < latest:
            self._forget_answer()
        del self._news[:-MOST_NEWS]


def _changes(request: AnyRequest) -> bool:
    """Whether a request changes the space: one that only looks may look again."""
    return request.take if isinstance(request, FindEntries) else not isinstance(request, WatchEntries)


def _name_of(principal: Principal) -> str:
    """Return who asks, for people."""
    address = Address.parse(principal.agent)
    return principal.person or (f"process {principal.process}" if address is None else address.name)


def _term(seconds: float, most: float, *, ends: bool = False) -> float:
    """Return the lease that is granted [s].

    Args:
        seconds: asked for.
        most: that is granted.
        ends: whether 0 is allowed, and ends it.

    Raises:
        Garbled: it is none.
    """
    if not (seconds > 0 or (ends and seconds == 0)):
        raise Garbled(key="a caller", detail=f"{seconds} s is no time of a lease")
    return min(seconds, most)
