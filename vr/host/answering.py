"""The serving side of agents that answer each request with one reply."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from robotree.vr.errors import Garbled, VrError
from robotree.vr.requests import Failed, Reply, Request, decode_request, encode
from robotree.vr.transport import RequestHandler, Respond

Answer = Callable[[Request], Awaitable[Reply]]
"""Answers one request; a `VrError` that it raises travels to the asker."""


def answering(answer: Answer) -> RequestHandler:
    """Make a request handler of it."""

    async def handle(body: bytes, respond: Respond) -> None:
        try:
            reply = await answer(decode_request(body))
        except VrError as error:
            reply = Failed.of(error)
        respond(encode(reply))

    return handle


def not_for(role: str, request: Request) -> Garbled:
    """Return the error for a request that an agent of this role does not answer."""
    return Garbled(key="a caller", detail=f"a {role} does not answer {type(request).__name__}")
