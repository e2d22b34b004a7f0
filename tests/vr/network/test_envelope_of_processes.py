"""A real process that hangs and wakes: requests that expired meanwhile do not begin."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from robotree.vr.base.address import Address
from robotree.vr.base.errors import NoAnswer, Unreachable
from robotree.vr.base.requests import Raised, decode_reply
from robotree.vr.exchange.client import RobotClient
from robotree.vr.network.local import LocalTransport
from tests.vr.recorder import Recorder


async def test_a_call_that_was_given_up_is_refused_by_the_process_that_wakes(
    start: Callable[[str, str], Awaitable[Any]], join_realm: Callable[[], Awaitable[LocalTransport]]
) -> None:
    rover = await start("robot", "rover")
    await rover.ready()
    transport = await join_realm()
    (key,) = transport.presence.keys("robot/rover/*")
    address = Address.parse(key)
    assert address is not None
    recorder: Any = Recorder(transport)
    client = RobotClient(recorder, address)
    await rover.freeze()  # all of it: a thread that runs on would carry the call out
    with pytest.raises((Unreachable, NoAnswer)):
        await client.call("move", {"x": 1.0})
    rover.signal(signal.SIGCONT)
    async with asyncio.timeout(60):
        while not transport.presence.keys(key):  # noqa: ASYNC110 # the presence itself is asked for
            await asyncio.sleep(0.01)
    replies = transport.request(key, recorder.sent[0], timeout=30)
    (answer,) = [decode_reply(body, key=key) async for body in replies]
    assert isinstance(answer, Raised)
    assert isinstance(answer.revive(), NoAnswer), "it is not even in the queue, and never was"
    assert await client.call("move", {"x": 2.0}) == 2.0
