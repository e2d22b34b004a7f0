"""The promises of a transport about requests and replies, as checks."""

from __future__ import annotations

import asyncio

from robotree.vr.base.errors import NoAnswer, Unreachable
from robotree.vr.base.transport import Respond
from robotree.vr.world.promises import Join, close_all, patience, promise, replies_of, served

SILENCES = (1.0, 8.0, 64.0)
"""[s] given to one who does not answer; a longer one where a busy machine took all of it for a reply."""


async def replies_keep_their_order(join: Join) -> None:
    """Any number of replies, whole, in order, and then an end; for far and near callers."""
    server, caller = await join(), await join()
    large = bytes(range(256)) * 4096

    async def handler(body: bytes, respond: Respond) -> None:
        for reply in (body, b"", large, b"last"):
            respond(reply)

    await served(server, caller, handler)
    for who in (caller, server):
        got = await replies_of(who.request("robot/a/1", large[1:], timeout=patience()))
        promise(got == ([large[1:], b"", large, b"last"], None), "replies arrive whole and in their order")
    got = await replies_of(caller.request("robot/a/1", b"", timeout=patience(), urgent=True))
    promise(got == ([b"", b"", large, b"last"], None), "an urgent request is answered like any other")
    await close_all(server, caller)


async def replies_stream(join: Join) -> None:
    """A reply arrives when it is sent, not when the last one is."""
    server, caller = await join(), await join()
    go_on = asyncio.Event()

    async def handler(_: bytes, respond: Respond) -> None:
        respond(b"first")
        await go_on.wait()
        respond(b"second")

    await served(server, caller, handler)
    replies = caller.request("robot/a/1", b"", timeout=patience())
    promise(await anext(replies) == b"first", "a reply arrives while the handler goes on")
    go_on.set()
    promise(await anext(replies) == b"second", "so does the next one")
    promise(await anext(replies, None) is None, "after the handler returns there are no more")
    await close_all(server, caller)


async def nobody_is_unreachable_at_once(join: Join) -> None:
    """Who asks nobody, or one that has just stopped serving, need not wait."""
    server, caller = await join(), await join()

    async def handler(_: bytes, respond: Respond) -> None:
        respond(b"here")

    for _ in range(2):  # a key can be served again
        got = await replies_of(caller.request("robot/a/1", b"", timeout=patience()))
        promise(not got[0] and isinstance(got[1], Unreachable), "nobody there is Unreachable")
        registration = await served(server, caller, handler)
        got = await replies_of(caller.request("robot/a/1", b"", timeout=patience()))
        promise(got == ([b"here"], None), "what is served can be asked as soon as it is seen")
        await registration.close()
        await registration.close()
    await close_all(server, caller)


async def a_handler_that_raises_ends_the_reply(join: Join) -> None:
    """Nothing said is Unreachable; something said stands."""
    server, caller = await join(), await join()

    async def handler(body: bytes, respond: Respond) -> None:
        if body:
            respond(body)
        raise RuntimeError("on purpose")

    await served(server, caller, handler)
    for who in (caller, server):
        got = await replies_of(who.request("robot/a/1", b"", timeout=patience()))
        promise(isinstance(got[1], Unreachable), "a handler that raises before it replies is Unreachable")
        got = await replies_of(who.request("robot/a/1", b"said", timeout=patience()))
        promise(got == ([b"said"], None), "what was replied before a handler raised is delivered")
    await close_all(server, caller)


async def silence_is_no_answer_in_time(join: Join) -> None:
    """The time given is for the whole exchange, and what came in it is delivered."""
    server, caller = await join(), await join()

    async def handler(_: bytes, respond: Respond) -> None:
        respond(b"wait")
        await asyncio.Event().wait()

    await served(server, caller, handler)
    loop = asyncio.get_running_loop()
    for who in (caller, server):
        said = list[bytes]()
        for silence in SILENCES:
            begin = loop.time()
            said, error = await replies_of(who.request("robot/a/1", b"", timeout=silence))
            promise(isinstance(error, NoAnswer), "silence is NoAnswer")
            promise(
                -0.05 < loop.time() - begin - silence < patience(), "NoAnswer comes when the time is over"
            )
            if said:
                break
        promise(said == [b"wait"], "what was said before a silence is delivered")
    await close_all(server, caller)


async def requests_run_beside_each_other(join: Join) -> None:
    """One that takes long does not keep others waiting."""
    server, caller = await join(), await join()
    together = asyncio.Event()
    inside: list[bytes] = []

    async def handler(body: bytes, respond: Respond) -> None:
        inside.append(body)
        if len(inside) == 64:
            together.set()
        await together.wait()
        respond(body)

    await served(server, caller, handler)
    bodies = [b"%d" % number for number in range(64)]
    results = await asyncio.gather(
        *(replies_of(caller.request("robot/a/1", body, timeout=patience())) for body in bodies)
    )
    promise(results == [([body], None) for body in bodies], "64 requests are answered beside each other")
    await close_all(server, caller)
