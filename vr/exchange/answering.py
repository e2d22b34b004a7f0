"""The serving side of agents: requests read, replies packed, errors sent to the asker."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from functools import partial

from robotree.vr.base.envelope import Received, opened
from robotree.vr.base.errors import Garbled, VrError
from robotree.vr.base.requests import AnyRequest, Raised, Reply, encode
from robotree.vr.base.transport import RequestHandler, Respond

_log = logging.getLogger(__name__)

SendReply = Callable[[Reply], None]
"""Sends one reply; may be called any number of times until the request is answered."""

Converse = Callable[[Received, SendReply], Callable[[], Awaitable[None]] | None]
"""Answers one request with any number of replies: at once (None), or when what it returns was called and
awaited, in a task. A `VrError` that is raised is the last of them."""

AnswerRequest = Callable[[AnyRequest], Awaitable[Reply]]
"""Answers one request; a `VrError` that it raises travels to the asker."""

AnswerAtOnce = Callable[[AnyRequest], Reply]
"""The same, where nothing is waited for."""


def conversing(converse: Converse, who: str) -> RequestHandler:
    """Make a request handler of what answers with any number of replies; `who` answers, for people."""

    def handle(body: bytes, respond: Respond) -> Awaitable[None] | None:
        def say(reply: Reply) -> None:
            respond(encode(reply))

        try:
            rest = converse(opened(body, who, asyncio.get_running_loop().time()), say)
        except Exception as error:  # noqa: BLE001 # the error boundary: the asker gets an answer
            say(_raised(error, who))
            return None
        return None if rest is None else finish(rest, say)

    async def finish(rest: Callable[[], Awaitable[None]], say: SendReply) -> None:
        try:
            await rest()
        except Exception as error:  # noqa: BLE001 # as above
            say(_raised(error, who))

    return handle


def answering(answer: AnswerRequest, who: str) -> RequestHandler:
    """Make a request handler of what answers with one reply; `who` answers, for people."""

    async def later(request: AnyRequest, say: SendReply) -> None:
        say(await answer(request))

    return conversing(lambda received, say: partial(later, received.request, say), who)


def answering_at_once(answer: AnswerAtOnce, who: str) -> RequestHandler:
    """Make a request handler of what answers with one reply and waits for nothing."""
    return conversing(lambda received, say: say(answer(received.request)), who)


def _raised(error: Exception, who: str) -> Raised:
    """Return the reply to the asker for an error."""
    if isinstance(error, VrError):
        return Raised.of(error)
    _log.error("%s: an answer failed", who, exc_info=error)
    return Raised.of(VrError(detail=f"{who}: internal error: {error!r}"))


def not_for(role: str, request: AnyRequest) -> Garbled:
    """Return the error for a request that an agent of this role does not answer."""
    return Garbled(key="a caller", detail=f"a {role} does not answer {type(request).__name__}")
