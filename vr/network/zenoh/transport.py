"""The transport over Eclipse Zenoh, for what leaves the machine.

Nothing local imports it: processes of one machine meet over `local.py`. A gateway on each machine will be its
user; until then it is held to the same examination as the others.

Why each choice below was made, and what was seen without it (Zenoh 1.10.2), is said beside it.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator, Callable, Coroutine, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import TypeVar

import zenoh

from robotree.vr.base.errors import TransportClosed
from robotree.vr.base.presence import Presence
from robotree.vr.base.principal import this_process
from robotree.vr.base.transport import (
    CutOffHandler,
    Occupied,
    OnReply,
    Registration,
    RequestHandler,
    Respond,
    SampleHandler,
    TakeRequest,
)
from robotree.vr.network.on_loop import FOREVER, LoopTurns, Replies, SampleInbox, handled, relay
from robotree.vr.network.zenoh.declaring import made
from robotree.vr.network.zenoh.session import LEASE, Session
from robotree.vr.network.zenoh.settling import Settling

LARGE = 8192
"""Bytes from which on a body is sent by a thread: a stalled receiver may block the sender for a second."""

URGENT = b"!"
"""What is attached to a request that goes ahead of others."""

WAITING_SAMPLES = 4096
"""Samples that may wait for one subscriber before the oldest are lost."""

HISTORY = 0.5
"""[s] to wait at most for news of all who are there when a watch begins."""

_log = logging.getLogger(__name__)
_R = TypeVar("_R")


async def connect(listen: Sequence[str], dial: Sequence[str]) -> ZenohTransport:
    """Open a transport.

    Args:
        listen: locators at which others may dial, like `tcp/127.0.0.1:7447`.
        dial: locators of others; of two processes only one may dial the other.

    Raises:
        NetworkUnusable: Zenoh cannot listen there.
    """
    transport = ZenohTransport(Session(listen, dial))
    await transport.enter()
    return transport


class ZenohTransport:
    """One process's way to all others that it is connected with."""

    def __init__(self, session: Session) -> None:
        """Made by `connect`."""
        self.session = session
        self.identity = this_process()
        self._loop = asyncio.get_running_loop()
        # threads of our own: a virtual robot that blocks the loop's default ones must not block renewals
        self._pool = ThreadPoolExecutor(4, thread_name_prefix="zenoh")
        self._closing: asyncio.Future[None] | None = None
        self._served: dict[str, RequestHandler] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._asking: set[Replies] = set()
        self._turns = LoopTurns()
        # Zenoh knows only those that it is connected with, and of them not who hangs
        self.presence = Presence(held=lambda _: [], unheard=lambda _: [], hand_on=self._turns.put)
        self.declared: set[_Declared] = set()
        """What is declared now. A token that nobody refers to any more is taken back by Zenoh."""

    async def enter(self) -> None:
        """Called once, by `connect`. If it is cancelled, nothing stays open.

        Raises:
            NetworkUnusable: Zenoh cannot listen there.
        """
        try:
            await made(self._pool, self.session.open, lambda _: self.session.close())
            await self._fill()
        except BaseException:
            self._pool.submit(self.session.close)
            self._pool.shutdown(wait=False)
            raise

    @property
    def closed(self) -> bool:
        """Whether it is closed or about to be."""
        return self._closing is not None

    async def serve(self, key: str, take: TakeRequest) -> Registration:
        """See `Transport.serve`: here every request goes by the event loop."""
        session = self._open(key)
        if key in self._served:
            raise ValueError(f"{key} is served already")
        self._served[key] = handled(take, self.identity)

        def take_query(query: zenoh.Query) -> None:
            payload = query.payload
            body = payload.to_bytes() if payload is not None else b""
            urgent = query.attachment is not None
            if not self._turns.put(partial(self._answer, key, query, body), urgent=urgent):
                query.drop()  # the loop is closed

        def undo() -> None:
            self._served.pop(key, None)

        # never complete=True: after one of two is undeclared, callers get nothing for ever (zenoh pull 2660)
        return await self._declare(
            lambda: session.declare_queryable(key, _direct(take_query)), zenoh.Queryable.undeclare, undo
        )

    def request(
        self, key: str, body: bytes, *, timeout: float, urgent: bool = False, void_at: float = 0.0
    ) -> AsyncIterator[bytes]:
        """See `Transport.request`: Zenoh cannot distinguish a process that hangs from one that has ended."""
        del void_at
        session = self._open(key)
        replies = Replies(key, timeout)
        self._asking.add(replies)
        if key in self._served:
            self._spawn(self._answer_here(self._served[key], bytes(body), replies))
            return replies

        def take(reply: zenoh.Reply) -> None:
            if reply.ok is None:  # nobody here replies with an error: it is Zenoh's own "Timeout"
                self._turns.put(replies.time_out, urgent=urgent)
            else:
                self._turns.put(partial(replies.feed, reply.ok.payload.to_bytes()), urgent=urgent)

        def send() -> None:
            session.get(
                key,
                _direct(take, lambda: self._turns.put(partial(self._asked, replies), urgent=urgent)),
                # anything else holds replies back until the last one is there
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=timeout,
                payload=bytes(body),
                # a queue of its own on this side; who receives it sees no priority, so it is written on it
                priority=zenoh.Priority.INTERACTIVE_HIGH if urgent else zenoh.Priority.DATA,
                attachment=URGENT if urgent else None,
                # DROP loses large bodies
                congestion_control=zenoh.CongestionControl.BLOCK,
            )

        if len(body) < LARGE:
            send()
        else:
            self._spawn(self._send(send, replies))
        return replies

    def ask(
        self, key: str, body: bytes, *, void_at: float = 0.0, urgent: bool = False, on_reply: OnReply
    ) -> None:
        """See `Transport.ask`: here every request goes by the event loop."""
        del void_at

        def begin() -> None:
            if self.closed:
                on_reply(None)
            else:
                self._spawn(relay(self.request(key, body, timeout=FOREVER, urgent=urgent), on_reply))

        self._turns.put(begin, urgent=urgent)

    def after_reading(self, job: Callable[[], bool]) -> bool:
        """See `Transport.after_reading`: the threads that read are Zenoh's."""
        del job
        return False

    def publish(self, key: str, body: bytes) -> None:
        self._open(key).put(
            key,
            bytes(body),
            priority=zenoh.Priority.DATA_LOW,
            congestion_control=zenoh.CongestionControl.DROP,
        )

    async def subscribe(self, pattern: str, handler: SampleHandler) -> Registration:
        session = self._open(pattern)
        inbox = SampleInbox[tuple[str, bytes]](self._turns, lambda item: handler(*item), WAITING_SAMPLES)

        def take(sample: zenoh.Sample) -> None:
            inbox.put((str(sample.key_expr), sample.payload.to_bytes()))

        return await self._declare(
            lambda: session.declare_subscriber(pattern, _direct(take)),
            zenoh.Subscriber.undeclare,
            inbox.close,
        )

    async def announce(self, key: str, *, unless: Sequence[str] = ()) -> Registration:
        session = self._open(key)
        if others := [other for pattern in unless for other in await self._tokens(pattern)]:
            raise Occupied(others)
        return await self._declare(
            lambda: session.liveliness().declare_token(key), zenoh.LivelinessToken.undeclare
        )

    async def settle(self, within: float) -> None:
        """See `Transport.settle`: liveliness tokens are not acknowledged."""
        self._open("")
        await asyncio.sleep(within)

    async def watch_itself(self, handler: CutOffHandler) -> Registration:
        """See `Transport.watch_itself`: it is not known here whether a new process could reach this one."""
        self._open("")
        del handler
        return _Nothing()

    async def close(self) -> None:
        if self._closing is None:
            self.presence.close()
            self._closing = asyncio.ensure_future(self._close())
        await asyncio.shield(self._closing)

    # -- inside -----------------------------------------------------------------------------------

    async def _fill(self) -> None:
        """Have the table follow Zenoh's reports of tokens, from now on."""
        session = self._open("")
        settling = Settling(lambda key, there: self.presence.count(key, there=there))
        inbox = SampleInbox[tuple[str, bool]](self._turns, lambda item: settling.change(*item))

        def take(sample: zenoh.Sample) -> None:
            inbox.put((str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT))

        def declare() -> zenoh.Subscriber:
            # never with the default handler: it blocks for ever once 256 tokens are there
            return session.liveliness().declare_subscriber("**", _direct(take), history=True)

        await self._declare(declare, zenoh.Subscriber.undeclare)
        # history comes bit by bit, and nothing says where it ends; a query of the same does end
        await settling.hear_of(await self._tokens("**"), HISTORY)

    async def _tokens(self, pattern: str) -> list[str]:
        """Ask for the tokens under a pattern."""
        session = self._open(pattern)
        keys: set[str] = set()
        complete = self._loop.create_future()

        def take(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                keys.add(str(reply.ok.key_expr))

        def finish() -> None:
            if not complete.done():
                complete.set_result(None)

        def ask() -> None:
            done = partial(self._turns.put, finish, urgent=True)
            session.liveliness().get(pattern, _direct(take, done), timeout=LEASE)

        await self.in_thread(ask)
        await complete
        return sorted(keys)

    async def in_thread(self, action: Callable[[], _R]) -> _R:
        """Do what may block."""
        return await self._loop.run_in_executor(self._pool, action)

    async def _declare(
        self,
        declare: Callable[[], _R],
        undeclare: Callable[[_R], None],
        undo: Callable[[], None] = lambda: None,
    ) -> _Declared:
        """Declare something in a thread. For who is cancelled meanwhile it is taken back.

        Otherwise nobody could, and others would take this process for one that is present and hangs.
        """

        def take_back(declared: _R) -> None:
            with contextlib.suppress(zenoh.ZError):  # the session closes at this moment
                undeclare(declared)

        try:
            return _Declared(self, partial(undeclare, await made(self._pool, declare, take_back)), undo)
        except BaseException:
            undo()
            raise

    async def _close(self) -> None:
        for replies in list(self._asking):
            replies.shut()
        tasks = self._tasks - {asyncio.current_task()}
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        # not on the loop's thread: it waits for callbacks that are running
        await self.in_thread(self.session.close)
        self._pool.shutdown(wait=False)

    def _open(self, key: str) -> zenoh.Session:
        session = self.session.zenoh
        if session is None or self._closing is not None:
            raise TransportClosed(key=key)
        return session

    async def _send(self, send: Callable[[], object], replies: Replies) -> None:
        try:
            await self.in_thread(send)
        except zenoh.ZError:  # the session has closed meanwhile
            self._asked(replies)

    def _asked(self, replies: Replies) -> None:
        replies.end()
        self._asking.discard(replies)

    def _spawn(self, work: Coroutine[None, None, None]) -> None:
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _answer(self, key: str, query: zenoh.Query, body: bytes) -> None:
        handler = self._served.get(key)
        if handler is None or self._closing is not None:
            query.drop()
        else:
            self._spawn(self._answer_there(handler, query, body))

    async def _answer_here(self, handler: RequestHandler, body: bytes, replies: Replies) -> None:
        try:
            await _handle(handler, body, replies.feed, replies.key)
        finally:
            self._asked(replies)

    async def _answer_there(self, handler: RequestHandler, query: zenoh.Query, body: bytes) -> None:
        key = str(query.key_expr)
        large: list[bytes] = []

        def reply(packed: bytes) -> None:
            with contextlib.suppress(zenoh.ZError):  # the session has closed meanwhile
                query.reply(key, packed)

        def respond(packed: bytes) -> None:
            if large or len(packed) >= LARGE:
                large.append(bytes(packed))
            else:
                reply(bytes(packed))

        try:
            await _handle(handler, body, respond, key)
            for packed in large:
                await self.in_thread(partial(reply, packed))
        finally:
            query.drop()


async def _handle(handler: RequestHandler, body: bytes, respond: Respond, key: str) -> None:
    try:
        if (rest := handler(body, respond)) is not None:
            await rest
    except Exception:  # noqa: BLE001 # the contract: logged, and the reply ends
        _log.exception("the handler of %s raised", key)


def _direct(
    callback: Callable[[_R], None], drop: Callable[[], object] | None = None
) -> zenoh.handlers.Callback[_R]:
    """Have a callback called in the network's own thread; otherwise each request costs a new thread."""
    return zenoh.handlers.Callback(callback, drop, indirect=False)


class _Nothing:
    """A registration of nothing."""

    async def close(self) -> None:
        pass


class _Declared:
    """Something declared in a session."""

    def __init__(
        self, transport: ZenohTransport, undeclare: Callable[[], None], undo: Callable[[], None] | None = None
    ) -> None:
        self._transport, self._undeclare, self._undo = transport, undeclare, undo
        transport.declared.add(self)

    async def close(self) -> None:
        if self not in self._transport.declared:
            return
        self._transport.declared.discard(self)
        if self._undo is not None:
            self._undo()
        if not self._transport.closed:
            with contextlib.suppress(zenoh.ZError):  # the session closes at this moment
                await self._transport.in_thread(self._undeclare)
