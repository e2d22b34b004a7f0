"""A transport from which nothing leaves before the journal has written what has caused it."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable, Sequence

from robotree.vr.base.policy import PolicyGate
from robotree.vr.base.presence import Presence
from robotree.vr.base.principal import Credentials
from robotree.vr.base.transport import (
    Incoming,
    OnReply,
    Registration,
    RequestHandler,
    TakeRequest,
    Transport,
)


class Outlet:
    """Another transport, behind a barrier: see `journal.HostJournal.barrier`."""

    def __init__(self, transport: Transport, barrier: Callable[[], None]) -> None:
        """Take the transport, and what is to be called before anything leaves."""
        self._transport, self._barrier = transport, barrier
        self.presence: Presence = transport.presence
        self.identity: Credentials = transport.identity
        self.gate: PolicyGate = transport.gate
        self.after_reading, self.listeners = transport.after_reading, transport.listeners
        self.subscribe, self.settle = transport.subscribe, transport.settle
        self.watch_itself = transport.watch_itself

    async def serve(self, key: str, take: TakeRequest, *, rank: int = 0) -> Registration:
        return await self._transport.serve(key, lambda incoming: take(self._guarded(incoming)), rank=rank)

    def _guarded(self, incoming: Incoming) -> Incoming:
        barrier = self._barrier

        def reply(body: bytes) -> None:
            barrier()
            incoming.reply(body)

        def end(body: bytes | None) -> None:
            barrier()
            incoming.end(body)

        def on_loop(handler: RequestHandler) -> None:
            def answer(body: bytes, respond: Callable[[bytes], None]) -> object:
                def guarded(reply: bytes) -> None:
                    barrier()
                    respond(reply)

                return handler(body, guarded)

            incoming.answer_on_loop(answer)  # type: ignore[arg-type] # it returns what the handler does

        return Incoming(incoming.body, incoming.credentials, reply, end, on_loop)

    def request(
        self, key: str, body: bytes, *, timeout: float, urgent: bool = False, void_at: float = 0.0
    ) -> AsyncIterator[bytes]:
        self._barrier()
        return self._transport.request(key, body, timeout=timeout, urgent=urgent, void_at=void_at)

    def ask(
        self, key: str, body: bytes, *, void_at: float = 0.0, urgent: bool = False, on_reply: OnReply
    ) -> None:
        self._barrier()
        self._transport.ask(key, body, void_at=void_at, urgent=urgent, on_reply=on_reply)

    def publish(self, key: str, body: bytes) -> None:
        self._barrier()
        self._transport.publish(key, body)

    async def announce(self, key: str, *, unless: Sequence[str] = ()) -> Registration:
        self._barrier()
        return await self._transport.announce(key, unless=unless)

    async def close(self) -> None:
        self._barrier()
        await self._transport.close()
