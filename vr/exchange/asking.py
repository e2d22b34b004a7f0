"""The asking side of every agent: each request is sealed here, and its replies are read here.

`send_request` may be used in any thread and waits for nothing; `ReplyStream` and `ask` belong to an event
loop.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Self, TypeVar

from robotree.vr.base.chance import token
from robotree.vr.base.envelope import seal
from robotree.vr.base.errors import Garbled, Unreachable, VrError
from robotree.vr.base.permissions import Permissions
from robotree.vr.base.requests import Accepted, AnyRequest, Raised, Reply, decode_reply
from robotree.vr.base.transport import Transport

TakeReply = Callable[[Reply | None], None]
"""Takes one reply, in any thread; None: there are no more. Must not block."""

_R = TypeVar("_R", bound=Reply)


def fresh_key() -> str:
    """Return the key of a new command that is nobody's step."""
    return token()


def send_request(  # noqa: PLR0913 # what is asked, of whom and how
    transport: Transport,
    key: str,
    request: AnyRequest,
    on_reply: TakeReply,
    *,
    now: float,
    within: float,
    sender: str = "",
    urgent: bool = False,
    may: Permissions | None = None,
    count: Callable[[int], object] | None = None,
) -> None:
    """Ask the agent that serves a key without waiting. In any thread.

    Args:
        transport: the way there.
        key: as served.
        request: the question.
        on_reply: takes the replies; one that cannot be read comes as the error which says so.
        now: [s] on the machine's monotonic clock.
        within: [s] for which the asker waits for the first answer.
        sender: key under which the asker is present.
        urgent: ahead of everything else.
        may: what the page of the asker may do; None: it is not limited.
        count: told the size [bytes] of the request and of each reply.
    """

    def read(body: bytes | None) -> None:
        reply: Reply | None = None
        if body is not None:
            if count is not None:
                count(len(body))
            try:
                reply = decode_reply(body, key=key)
            except VrError as error:
                reply = Raised.of(error)
        on_reply(reply)

    sealed = seal(request, now=now, within=within, sender=sender, may=may)
    if count is not None:
        count(len(sealed.body))
    transport.ask(key, sealed.body, void_at=sealed.void_at, urgent=urgent, on_reply=read)


class ReplyStream:
    """The replies to a request that is sent now, on the event loop. May be abandoned at any time."""

    def __init__(
        self,
        transport: Transport,
        key: str,
        request: AnyRequest,
        *,
        within: float,
        timeout: float,
        urgent: bool = False,
        sender: str = "",
    ) -> None:
        """Ask.

        Args:
            transport: the way there.
            key: as served.
            request: the question.
            within: [s] for which the asker waits for the first answer.
            timeout: [s] for the whole exchange.
            urgent: ahead of everything else.
            sender: key under which the asker is present.
        """
        now = asyncio.get_running_loop().time()
        sealed = seal(request, now=now, within=within, sender=sender)
        self._key = key
        self._bodies = transport.request(
            key, sealed.body, timeout=timeout, urgent=urgent, void_at=sealed.void_at
        )

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Reply:
        """Return the next reply; a refusal is one of them.

        Raises:
            TransportError: there is none, see `Transport.request`, or it cannot be read.
        """
        return decode_reply(await anext(self._bodies), key=self._key)


async def ask(
    transport: Transport,
    key: str,
    request: AnyRequest,
    answer: type[_R],
    *,
    timeout: float,
    urgent: bool = False,
    accepted: Callable[[], None] = lambda: None,
    sender: str = "",
) -> _R:
    """Ask the agent that serves a key, and return its answer.

    Args:
        transport: the way there.
        key: as served.
        request: the question.
        answer: the kind of reply that answers it.
        timeout: [s] to wait.
        urgent: ahead of everything else.
        accepted: called when the agent says that it has the request and that its answer may take a while.
        sender: key under which the asker is present.

    Raises:
        TransportError: there is no answer, or one that cannot be read.
        VrError: the refusal of the agent asked.
    """
    replies = ReplyStream(
        transport, key, request, within=timeout, timeout=timeout, urgent=urgent, sender=sender
    )
    async for reply in replies:
        if isinstance(reply, Raised):
            raise reply.revive()
        if isinstance(reply, Accepted):
            accepted()
        elif isinstance(reply, answer):
            return reply
        else:
            unfit = f"{type(reply).__name__} is no answer to {type(request).__name__}"
            raise Garbled(key=key, detail=unfit)
    raise Unreachable(key=key)
