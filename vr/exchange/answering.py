"""The serving side of agents: requests read, replies packed, errors sent to the asker."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable

from robotree.vr.envelope import opened
from robotree.vr.errors import Garbled, VrError
from robotree.vr.requests import Raised, Reply, Request, encode
from robotree.vr.transport import RequestHandler, Respond

_log = logging.getLogger(__name__)

Say = Callable[[Reply], None]
"""Sends one reply; may be called any number of times until the request is answered."""

Converse = Callable[[Request, Say], Awaitable[None]]
"""Answers one request with any number of replies; a `VrError` that it raises is the last of them."""

Answer = Callable[[Request], Awaitable[Reply]]
"""Answers one request; a `VrError` that it raises travels to the asker."""


def conversing(converse: Converse, who: str) -> RequestHandler:
    """Make a request handler of what answers with any number of replies; `who` answers, for people."""

    async def handle(body: bytes, respond: Respond) -> None:
        def say(reply: Reply) -> None:
            respond(encode(reply))

        try:
            await converse(opened(body, who, asyncio.get_running_loop().time()).request, say)
        except VrError as error:
            say(Raised.of(error))
        except Exception as error:  # noqa: BLE001 # the error boundary: the asker gets an answer
            _log.exception("%s: an answer failed", who)
            say(Raised.of(VrError(detail=f"{who}: internal error: {error!r}")))

    return handle


def answering(answer: Answer, who: str) -> RequestHandler:
    """Make a request handler of what answers with one reply; `who` answers, for people."""

    async def converse(request: Request, say: Say) -> None:
        say(await answer(request))

    return conversing(converse, who)


def not_for(role: str, request: Request) -> Garbled:
    """Return the error for a request that an agent of this role does not answer."""
    return Garbled(key="a caller", detail=f"a {role} does not answer {type(request).__name__}")
