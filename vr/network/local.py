"""The transport between the processes of one machine: `Mesh`, brought to an event loop."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable, Iterable, Sequence
from functools import partial
from pathlib import Path

from robotree.files.forks import expect_parent
from robotree.vr.base.errors import TransportClosed
from robotree.vr.base.policy import OPEN, PolicyGate
from robotree.vr.base.principal import Credentials
from robotree.vr.base.system import THIS_SYSTEM, system_of
from robotree.vr.base.transport import (
    ELSEWHERE,
    CutOffHandler,
    End,
    Incoming,
    OnReply,
    Registration,
    RequestHandler,
    Respond,
    SampleHandler,
    TakeRequest,
)
from robotree.vr.network.mesh import GREETING, Mesh, TakeFrame
from robotree.vr.network.on_loop import LoopTurns, Replies, SampleInbox, answered
from robotree.vr.network.rendezvous import Rendezvous, realm_name
from robotree.vr.network.shared import policy_of, sees_sample

WAITING_SAMPLES = 4096
"""Samples that may wait for one subscriber before the oldest are lost."""


async def join(
    realm: str | None = None,
    *,
    root: Path | None = None,
    greeting: float = GREETING,
    listed: bool = True,
) -> LocalTransport:
    """Enter a realm.

    Args:
        realm: its name; None: `$ROBOTREE_REALM`, else `default`.
        root: where realms lie; None: `$XDG_RUNTIME_DIR/robotree` or a private directory for temporary files.
        greeting: [s] to wait at most for those who are there to say who they are: see `Mesh.open`.
        listed: whether newcomers can find this process; if not, it writes nothing: see `Rendezvous`.

    Returns:
        A transport that already knows all who are there and answer.

    Raises:
        BadName: the realm's name cannot be one.
        RealmUnusable: the realm's folder cannot be used.
    """
    loop = asyncio.get_running_loop()
    mesh = Mesh(Rendezvous(realm_name(realm), root, listed=listed, system=system_of(loop)))
    try:
        await loop.run_in_executor(None, mesh.open, greeting)
    except BaseException:
        mesh.close()
        raise
    transport = LocalTransport(mesh)
    if mesh.place.system is THIS_SYSTEM:
        transport.gate = policy_of(mesh.place.realm, root)
        transport.gate.refresh(mesh.place.system.now())
        if mesh.place.shared is not None:
            mesh.sees = partial(sees_sample, transport.gate, mesh.place.system.now)
    return transport


class LocalTransport:
    """One process's way to all others of its realm."""

    def __init__(self, mesh: Mesh) -> None:
        """Made by `join`."""
        self.mesh = mesh
        self._system = mesh.place.system
        self._loop, self._thread = asyncio.get_running_loop(), self._system.here()
        self.gate: PolicyGate = OPEN
        self._system.owns(self)
        self._turns = LoopTurns()
        news = SampleInbox[Callable[[], object]](self._turns, lambda action: action())
        self.presence, self.identity = mesh.presence, Credentials(self._system.pid(), self._system.user())
        self.presence.hand_on = news.put
        self._served: dict[str, TakeFrame] = {}
        self._tasks: set[asyncio.Future[None]] = set()
        self._asking: set[Replies] = set()
        self._closing: asyncio.Future[None] | None = None
        self._system.at_exit(mesh.close)  # else the others remove its files when they next look

    @property
    def closed(self) -> bool:
        """Whether it is closed or about to be."""
        return self._closing is not None

    @property
    def realm(self) -> str:
        """The realm's name."""
        return self.mesh.place.realm

    async def serve(self, key: str, take: TakeRequest, *, rank: int = 0) -> Registration:
        self._check(key)

        def take_frame(  # an `TakeFrame`
            body: bytes,
            sender: Credentials,
            urgent: bool,  # noqa: FBT001
            respond: Respond,
            end: End,
        ) -> None:
            def on_loop(handler: RequestHandler) -> None:
                answer = partial(self._answer, key, handler, body, respond, end)
                if not self._turns.put(answer, urgent=urgent):
                    end(None)  # the loop is closed

            take(Incoming(body, sender, respond, end, on_loop))

        self.mesh.serve(key, take_frame, rank=rank)
        self._served[key] = take_frame

        def undo() -> None:
            self._served.pop(key, None)
            self.mesh.end_serving(key)

        return _Registration(self, undo)

    def request(
        self, key: str, body: bytes, *, timeout: float, urgent: bool = False, void_at: float = 0.0
    ) -> AsyncIterator[bytes]:
        self._check(key)
        replies = Replies(key, timeout)
        self._asking.add(replies)

        def on_reply(reply: bytes | None) -> None:
            action = partial(self._done, replies) if reply is None else partial(replies.feed, reply)
            self._turns.put(action, urgent=urgent)

        self.ask(key, body, void_at=void_at, urgent=urgent, on_reply=on_reply)
        return replies

    def ask(
        self, key: str, body: bytes, *, void_at: float = 0.0, urgent: bool = False, on_reply: OnReply
    ) -> None:
        answer, body = self._served.get(key), bytes(body)
        if self._closing is not None:
            on_reply(None)
        elif answer is None:
            self.mesh.ask(key, body, void_at=void_at, urgent=urgent, on_reply=on_reply)
        else:  # of this process

            def end(last: bytes | None) -> None:
                if last is ELSEWHERE:
                    self.mesh.ask(key, body, void_at=void_at, urgent=urgent, on_reply=on_reply)
                    return
                if last is not None:
                    on_reply(last)
                on_reply(None)

            answer(body, self.identity, urgent, on_reply, end)

    def after_reading(self, job: Callable[[], bool]) -> bool:
        return self.mesh.after_reading(job)

    def publish(self, key: str, body: bytes) -> None:
        self._check(key)
        self.mesh.publish(key, bytes(body))

    def listeners(self, key: str) -> int:
        return self.mesh.listeners(key)

    async def subscribe(self, pattern: str, handler: SampleHandler) -> Registration:
        self._check(pattern)
        inbox = SampleInbox[tuple[str, bytes]](self._turns, lambda item: handler(*item), WAITING_SAMPLES)
        number = self.mesh.subscribe(pattern, lambda key, body: inbox.put((key, body)))
        return _Registration(self, lambda: self.mesh.unsubscribe(number), inbox.close)

    async def announce(self, key: str, *, unless: Sequence[str] = ()) -> Registration:
        self._check(key)
        self.mesh.announce(key, unless=unless)
        return _Registration(self, lambda: self.mesh.withdraw(key))

    async def settle(self, within: float) -> None:
        self._check("")
        settled = asyncio.Event()

        def on_settled() -> None:
            self._turns.put(settled.set, urgent=True)

        self.mesh.settle(on_settled)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(within):
                await settled.wait()

    async def watch_itself(self, handler: CutOffHandler) -> Registration:
        self._check("")

        def on_cut_off(reason: str) -> None:
            self._turns.put(partial(handler, reason), urgent=True)

        number = self.mesh.watch_itself(on_cut_off)
        return _Registration(self, lambda: self.mesh.unwatch(number))

    async def close(self) -> None:
        if self._closing is None:
            self.presence.close()
            self._closing = asyncio.ensure_future(self._close())
        await asyncio.shield(self._closing)

    def in_child(self) -> Iterable[int]:
        """See `forks.Owner`: a child that comes back into the event loop ends there."""
        if self._system.here() == self._thread:
            self._loop.call_soon(expect_parent)
        return ()

    # -- inside -----------------------------------------------------------------------------------

    async def _close(self) -> None:
        self._system.not_at_exit(self.mesh.close)
        for replies in list(self._asking):
            replies.shut()
        me = asyncio.current_task()
        tasks = [task for task in self._tasks if task is not me]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await asyncio.wrap_future(self.mesh.close())

    def _check(self, key: str) -> None:
        if self._closing is not None:
            raise TransportClosed(key=key)

    def _done(self, replies: Replies) -> None:
        replies.end()
        self._asking.discard(replies)

    def _answer(self, key: str, handler: RequestHandler, body: bytes, respond: Respond, end: End) -> None:
        if key not in self._served or self._closing is not None:
            end(None)
        else:
            task = answered(handler, body, respond, end, key)
            if task is not None:
                self._tasks.add(task)
                task.add_done_callback(self._tasks.discard)


class _Registration:
    """Something declared: `close` takes it back, once."""

    def __init__(self, transport: LocalTransport, *undo: Callable[[], object]) -> None:
        self._transport = transport
        self._undo = undo

    async def close(self) -> None:
        undo, self._undo = self._undo, ()
        for action in undo:
            if not self._transport.closed:
                action()
