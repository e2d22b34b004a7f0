"""The serving side of agents that answer each request with one reply."""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable

from robotree.vr.errors import Garbled, VrError
from robotree.vr.requests import Failed, Reply, Request, decode_request, encode
from robotree.vr.transport import RequestHandler, Respond

_log = logging.getLogger(__name__)

Answer = Callable[[Request], Awaitable[Reply]]
"""Answers one request; a `VrError` that it raises travels to the asker."""


def answering(answer: Answer) -> RequestHandler:
    """Make a request handler of it."""

    async def handle(body: bytes, respond: Respond) -> None:
        try:
            reply = await answer(decode_request(body))
        except VrError as error:
            reply = Failed.of(error)
        except Exception as error:  # noqa: BLE001 # the last fence: whoever asks gets an answer
            _log.exception("an answer failed")
            reply = Failed.of(VrError(detail=f"internal error of the agent asked: {error!r}"))
        respond(encode(reply))

    return handle


def not_for(role: str, request: Request) -> Garbled:
    """Return the error for a request that an agent of this role does not answer."""
    return Garbled(key="a caller", detail=f"a {role} does not answer {type(request).__name__}")
