"""Everything that the contract of a transport promises, as checks for any implementation of it."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

from robotree.vr.base.errors import NoAnswer, TransportClosed, Unreachable, VrError
from robotree.vr.base.transport import Occupied, Registration, Respond, Transport, on_loop
from robotree.vr.world.promises import (
    Join,
    close_all,
    patience,
    promise,
    replies_of,
    served,
    settled_subscription,
    until,
    until_present,
)

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


async def who_has_moved_further_is_asked(join: Join) -> None:
    """Of two that serve a key the higher rank answers, to a newcomer, too, and whoever came last."""
    source, destination, caller = await join(), await join(), await join()

    async def stale(_: bytes, respond: Respond) -> None:
        respond(b"source")

    async def moved(_: bytes, respond: Respond) -> None:
        respond(b"destination")

    first = await served(source, caller, stale)
    later = await served(destination, caller, moved, rank=1)
    await first.close()
    await served(source, caller, stale)  # it hung, and wakes
    newcomer = await join()
    news = [await source.announce("news/s"), await destination.announce("news/d")]
    await until_present(newcomer, "news/*", ["news/d", "news/s"])
    for who in (caller, newcomer):
        got = await replies_of(who.request("robot/a/1", b"", timeout=patience()))
        promise(got == ([b"destination"], None), "who has moved further is asked")
    await later.close()
    await news[1].close()
    await until_present(newcomer, "news/*", ["news/s"])
    got = await replies_of(newcomer.request("robot/a/1", b"", timeout=patience()))
    promise(got == ([b"source"], None), "and the other one when that has gone")
    await close_all(source, destination, caller, newcomer)


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


SETTLE = 0.1
"""[s] that two who come at the same time wait at most until they know of each other."""


async def samples_reach_whoever_subscribed(join: Join) -> None:
    """In order, under the pattern, own ones too, and none after the end."""
    teller, listener = await join(), await join()
    heard: list[tuple[str, bytes]] = []
    at_home: list[tuple[str, bytes]] = []
    subscription = await listener.subscribe("robot/*/*/state", lambda key, body: heard.append((key, body)))
    await teller.subscribe("robot/**", lambda key, body: at_home.append((key, body)))
    await settled_subscription(teller, listener)
    published = [("robot/a/1/state", b"%d" % number) for number in range(100)]
    for key, body in published:
        teller.publish(key, body)
    teller.publish("robot/a/1/other", b"not asked for")
    await until(lambda: len(heard) >= 100 and len(at_home) >= 101, "samples arrive, own ones too")
    promise(heard == published, "samples arrive in their order, only those under the pattern")
    await subscription.close()
    teller.publish("robot/a/1/state", b"too late")
    await until(lambda: len(at_home) >= 102, "others go on hearing")
    await asyncio.sleep(0.02)
    promise(len(heard) == 100, "a closed subscription hears nothing")
    await close_all(teller, listener)


async def a_subscriber_that_raises_still_hears(join: Join) -> None:
    """One bad sample does not end a subscription."""
    member = await join()
    heard: list[bytes] = []

    def handler(_: str, body: bytes) -> None:
        heard.append(body)
        if body == b"bad":
            raise RuntimeError("on purpose")

    await member.subscribe("robot/*", handler)
    for body in (b"bad", b"good"):
        member.publish("robot/a", body)
    await until(lambda: heard == [b"bad", b"good"], "a handler that raises is called again")
    await close_all(member)


async def presence_is_seen_by_early_and_late(join: Join) -> None:
    """First what is there, then each change, for those who watch before and after."""
    member, early, late = await join(), await join(), await join()
    seen: list[tuple[str, bool]] = []
    early.presence.watch("robot/*/*", lambda key, there: seen.append((key, there)))
    one = await member.announce("robot/a/1")
    await member.announce("view/a/1")
    await until(lambda: seen == [("robot/a/1", True)], "an arrival is told once, if the pattern matches")
    promise(early.presence.there("robot/a/1"), "what was reported can be queried")
    await until_present(late, "*/a/*", ["robot/a/1", "view/a/1"])
    first: list[tuple[str, bool]] = []
    watching = late.presence.watch("robot/*/*", lambda key, there: first.append((key, there)))
    promise(first == [("robot/a/1", True)], "what is there already is told before `watch` returns")
    watching()
    await one.close()
    await one.close()
    await until(lambda: seen[1:] == [("robot/a/1", False)], "a departure is told once")
    await until_present(late, "robot/*/*", [])
    promise(len(first) == 1, "a closed watch reports nothing")
    await close_all(member, early, late)


async def presence_ends_with_the_last_holder(join: Join) -> None:
    """A key is present as long as anybody holds it; closing a transport lets go of all."""
    one, other, watcher = await join(), await join(), await join()
    seen: list[tuple[str, bool]] = []
    watcher.presence.watch("robot/**", lambda key, there: seen.append((key, there)))
    await one.announce("robot/a/1")
    await other.announce("robot/a/1")
    await until(lambda: seen == [("robot/a/1", True)], "two holders are one presence")
    await one.close()
    await asyncio.sleep(0.1)
    promise(seen == [("robot/a/1", True)], "a key stays present while somebody holds it")
    await other.close()
    await until(lambda: seen[1:] == [("robot/a/1", False)], "a closed transport holds nothing")
    await close_all(watcher)


async def who_is_seen_can_be_asked(join: Join) -> None:
    """A request from within the news of an arrival finds the server, if it served before it announced."""
    server, caller = await join(), await join()
    answers: list[asyncio.Task[tuple[list[bytes], VrError | None]]] = []

    async def handler(_: bytes, respond: Respond) -> None:
        respond(b"here")

    def greet(key: str, there: bool) -> None:  # noqa: FBT001 # as the contract has it
        if there:
            asking = caller.request(key, b"", timeout=patience())
            answers.append(asyncio.ensure_future(replies_of(asking)))

    caller.presence.watch("robot/*/*", greet)
    for number in range(20):
        await server.serve(f"robot/a/{number}", on_loop(handler))
        await server.announce(f"robot/a/{number}")
    await until(lambda: len(answers) == 20, "all arrivals are seen")
    results = await asyncio.gather(*answers)
    promise(all(result == ([b"here"], None) for result in results), "who is seen can be asked at once")
    await close_all(server, caller)


async def many_are_present(join: Join) -> None:
    """Hundreds of tokens are as visible as one."""
    member, watcher = await join(), await join()
    keys = {f"robot/r{number}/1" for number in range(400)}
    for key in keys:
        await member.announce(key)
    seen: set[str] = set()
    watching = watcher.presence.watch("robot/*/*", lambda key, _: seen.add(key))
    await until(lambda: seen == keys, "all are seen")
    watching()
    await until_present(watcher, "robot/*/*", sorted(keys))
    await close_all(member, watcher)


async def who_is_seen_does_not_hang(join: Join) -> None:
    """What is present here and there hangs nowhere; what was taken back does not either."""
    one, other = await join(), await join()
    tokens = [await one.announce(f"robot/a/{number}") for number in range(3)]
    await until_present(other, "robot/a/*", [f"robot/a/{number}" for number in range(3)])
    promise(await other.presence.hanging("robot/**") == [], "who is seen does not hang")
    for token in tokens:
        await token.close()
    await until_present(other, "robot/a/*", [])
    promise(await other.presence.hanging("**") == [], "who has left does not hang")
    await close_all(one, other)


async def two_that_announce_at_once_know_of_each_other(join: Join) -> None:
    """After both have settled; or one was refused."""
    one, other = await join(), await join()
    for number, member in enumerate((one, other)):
        await member.announce(f"linked/{number}")
    for member in (one, other):
        await until_present(member, "linked/*", ["linked/0", "linked/1"])

    async def come(member: Transport, key: str) -> Registration | None:
        try:
            token = await member.announce(key, unless=[f"{key.rpartition('/')[0]}/*"])
        except Occupied as refusal:
            promise(refusal.keys != (), "who is refused learns because of what")
            return None
        await member.settle(SETTLE)
        return token

    for number in range(20):
        keys = [f"robot/{number}/1", f"robot/{number}/2"]
        tokens = await asyncio.gather(*map(come, (one, other), keys))
        there = [key for key, token in zip(keys, tokens, strict=True) if token is not None]
        promise(there != [], "of two one may come")
        for member, token in zip((one, other), tokens, strict=True):
            seen = sorted(member.presence.keys(f"robot/{number}/*"))
            promise(token is None or seen == there, "who has settled knows all who came at the same time")
    await close_all(one, other)


async def a_closed_transport_says_so(join: Join) -> None:
    """Everything asked of it afterwards raises, what waits ends, and closing again does nothing."""
    server, caller = await join(), await join()

    async def handler(_: bytes, respond: Respond) -> None:
        respond(b"wait")
        await asyncio.Event().wait()

    registration = await served(server, caller, handler)
    token = await server.announce("robot/a/1")
    waiting = caller.request("robot/a/1", b"", timeout=patience())
    await anext(waiting)
    asked = server.request("robot/a/1", b"", timeout=patience())
    await anext(asked)
    await server.close()
    await server.close()
    promise(isinstance((await replies_of(asked))[1], TransportClosed), "what waits here ends TransportClosed")
    promise((await replies_of(waiting)) == ([], None), "what waits there just ends")
    await registration.close()
    await token.close()
    attempts: tuple[Callable[[], Awaitable[object]], ...] = (
        lambda: server.serve("robot/a/1", on_loop(handler)),
        lambda: replies_of(server.request("robot/a/1", b"", timeout=1)),
        lambda: server.subscribe("robot/a", lambda _key, _body: None),
        lambda: server.announce("robot/a/1"),
        lambda: server.presence.until("robot/a", there=True, within=1),
        lambda: server.presence.hanging("robot/a"),
    )
    for attempt in attempts:
        try:
            await attempt()
        except TransportClosed:
            continue
        promise(False, "a closed transport refuses everything")
    await close_all(caller)


async def a_handler_may_close_its_transport(join: Join) -> None:
    """The caller of a request that ends the process gets an error soon."""
    server, caller = await join(), await join()

    async def handler(_: bytes, respond: Respond) -> None:
        respond(b"bye")
        await server.close()

    await served(server, caller, handler)
    got = await replies_of(caller.request("robot/a/1", b"", timeout=patience()))
    promise(got == ([b"bye"], None), "a handler may close its transport")
    await close_all(caller, server)


TRANSPORT_CHECKS: tuple[Callable[[Join], Awaitable[None]], ...] = (
    replies_keep_their_order,
    replies_stream,
    nobody_is_unreachable_at_once,
    who_has_moved_further_is_asked,
    a_handler_that_raises_ends_the_reply,
    silence_is_no_answer_in_time,
    requests_run_beside_each_other,
    samples_reach_whoever_subscribed,
    a_subscriber_that_raises_still_hears,
    presence_is_seen_by_early_and_late,
    presence_ends_with_the_last_holder,
    who_is_seen_can_be_asked,
    many_are_present,
    who_is_seen_does_not_hang,
    two_that_announce_at_once_know_of_each_other,
    a_closed_transport_says_so,
    a_handler_may_close_its_transport,
)


async def check_transport(join: Join) -> None:
    """Examine a transport.

    Args:
        join: returns the transport of a new member of one and the same network.

    Raises:
        AssertionError: a promise is broken.
    """
    for check in TRANSPORT_CHECKS:
        await check(join)
