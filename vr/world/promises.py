"""The parts of examinations of transports: promises, and the time to see them kept."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable

from robotree.vr.base.errors import VrError
from robotree.vr.base.transport import Registration, RequestHandler, Transport, on_loop
from robotree.vr.world.virtual_loop import VirtualLoop

Join = Callable[[], Awaitable[Transport]]
"""Enters one more member into the network under examination."""

IN_VIRTUAL_TIME, IN_REAL_TIME = 5.0, 60.0
"""[s] for anything that must happen but has no promised time. A busy machine may take the second one."""


def patience() -> float:
    """Return how long to wait for what must happen [s], by the clock of the running loop."""
    virtual = isinstance(asyncio.get_running_loop(), VirtualLoop)
    return IN_VIRTUAL_TIME if virtual else IN_REAL_TIME


def promise(kept: bool, sentence: str) -> None:  # noqa: FBT001 # reads as a sentence
    """Complain if a promise is not kept.

    Raises:
        AssertionError: it is not.
    """
    if not kept:
        raise AssertionError(f"broken: {sentence}")


async def until(condition: Callable[[], bool | Awaitable[bool]], sentence: str = "it comes about") -> None:
    """Wait for something that must happen.

    Args:
        condition: what to wait for; a coroutine function asks somebody.
        sentence: says it.

    Raises:
        AssertionError: it did not, within `patience()`.
    """
    loop = asyncio.get_running_loop()
    deadline = loop.time() + patience()
    while not (holds := await _answer(condition)) and loop.time() < deadline:  # noqa: ASYNC110 # any condition at all
        await asyncio.sleep(0.005)
    promise(holds, sentence)


async def _answer(condition: Callable[[], bool | Awaitable[bool]]) -> bool:
    answer = condition()
    return await answer if isinstance(answer, Awaitable) else answer


async def replies_of(asking: AsyncIterator[bytes]) -> tuple[list[bytes], VrError | None]:
    """Return what a request brought, and how it ended."""
    bodies: list[bytes] = []
    try:
        async for body in asking:
            bodies.append(body)  # noqa: PERF401 # what came before an error counts
    except VrError as error:
        return bodies, error
    return bodies, None


async def served(
    server: Transport, caller: Transport, handler: RequestHandler, rank: int = 0
) -> Registration:
    """Serve, and wait until the caller can know of it."""
    registration = await server.serve("robot/a/1", on_loop(handler), rank=rank)
    token = await server.announce("served")
    await until_present(caller, "served", ["served"])
    await token.close()
    await until_present(caller, "served", [])
    return registration


async def until_present(who: Transport, pattern: str, keys: list[str]) -> None:
    """News travels: what is present here becomes present there."""
    async with asyncio.timeout(patience()):
        while who.presence.keys(pattern) != keys:  # noqa: ASYNC110 # the question is the thing examined
            await asyncio.sleep(0.005)


async def settled_subscription(teller: Transport, listener: Transport) -> None:
    """Wait until the teller knows of the listener: from then on it knows of all declared before."""
    arrived = asyncio.Event()
    probe = await listener.subscribe("probe", lambda _key, _body: arrived.set())
    async with asyncio.timeout(patience()):
        while not arrived.is_set():
            teller.publish("probe", b"")
            await asyncio.sleep(0.002)
    await probe.close()


async def close_all(*transports: Transport) -> None:
    """Close transports, one after the other."""
    for transport in transports:
        await transport.close()
