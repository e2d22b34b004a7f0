"""One question, one answer: the exchange that all but calls are made of."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from robotree.vr.errors import Garbled, Unreachable
from robotree.vr.exchange.timely import Question
from robotree.vr.requests import Accepted, Raised, Reply, Request, decode_reply
from robotree.vr.transport import Transport

_R = TypeVar("_R", bound=Reply)


async def ask(
    transport: Transport,
    key: str,
    request: Request,
    answer: type[_R],
    *,
    timeout: float,
    urgent: bool = False,
    heard: Callable[[], None] = lambda: None,
) -> _R:
    """Ask the agent that serves a key, and return its answer.

    Args:
        transport: the way there.
        key: as served.
        request: the question.
        answer: the kind of reply that answers it.
        timeout: [s] to wait.
        urgent: ahead of everything else.
        heard: told when the agent says that it has the request and that its answer may take a while.

    Raises:
        TransportError: there is no answer, or one that cannot be read.
        VrError: the refusal of the agent asked.
    """
    question = Question(request, within=timeout)
    async with question.outlived(transport, key):
        async for body in transport.request(key, question.body, timeout=timeout, urgent=urgent):
            reply = decode_reply(body, key=key)
            if isinstance(reply, Raised):
                raise reply.revive()
            if isinstance(reply, Accepted):
                heard()
                continue
            if not isinstance(reply, answer):
                what = f"{type(reply).__name__} is no answer to {type(request).__name__}"
                raise Garbled(key=key, detail=what)
            return reply
        raise Unreachable(key=key)
