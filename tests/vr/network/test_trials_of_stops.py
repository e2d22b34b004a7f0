"""Accidents aimed at the way of a stop, many times: every robot that lives and is awake is reached.

Each of them has once kept stops from robots that lived: a freeze for as long as it takes to be given up and
greeted again, a newcomer stopped in the middle of coming, a folder removed.
"""

from __future__ import annotations

import asyncio
import os
import random
import signal
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

from robotree.vr.base.errors import NotConfirmed
from robotree.vr.network.local import LocalTransport
from robotree.vr.supervision.realm_client import RealmClient
from tests.vr.network.processes import Start, remove, start_all

pytestmark = [pytest.mark.soak, pytest.mark.timeout(900)]

Join = Callable[[], Awaitable[LocalTransport]]


NAMES = [f"r{number}" for number in range(6)]
AWAKE_AGAIN = 1.0
"""[s] after which a process that woke up is whole again."""
ROUNDS = 25


@pytest.fixture
async def crew(start: Start) -> list[Any]:
    return await start_all(start, *(("robot", name) for name in NAMES))


@pytest.fixture
async def supervisor(crew: list[Any], join_realm: Join) -> AsyncIterator[RealmClient]:
    """A supervisor that was there before."""
    assert crew
    realm_client = RealmClient(await join_realm())
    await realm_client.start()
    yield realm_client
    await realm_client.close()


async def stopped(join_realm: Join, name: str | None = None) -> tuple[list[str], dict[str, str]]:
    """Stop as a newcomer; return who has confirmed it, and why the others have not."""
    transport = await join_realm()
    try:
        return sorted(await RealmClient(transport).stop(name)), {}
    except NotConfirmed as error:
        return error.data["told"], dict(error.data["untold"])
    finally:
        await transport.close()


async def test_no_freeze_of_three_and_a_half_seconds_keeps_a_stop_out(
    crew: list[Any], supervisor: RealmClient, join_realm: Join
) -> None:
    """150 freezes around 3.5 s: the moment in which links over Zenoh were split for ever (decision 0015)."""
    chance = random.Random(1)
    for _ in range(ROUNDS):

        async def freeze(member: Any) -> None:
            member.signal(signal.SIGSTOP)
            await asyncio.sleep(chance.uniform(3.45, 3.55))
            member.signal(signal.SIGCONT)

        await asyncio.gather(*map(freeze, crew))
        await asyncio.sleep(AWAKE_AGAIN)
        assert sorted(await supervisor.stop(None)) == NAMES
        assert await stopped(join_realm) == (NAMES, {})
        assert sorted(await supervisor.resume(None)) == NAMES


@pytest.mark.usefixtures("crew")
async def test_no_newcomer_that_is_paused_anywhere_keeps_a_stop_out(start: Start, join_realm: Join) -> None:
    chance, folder = random.Random(2), Path(os.environ["XDG_RUNTIME_DIR"]) / "robotree" / "test"
    known = set(NAMES)
    for number in range(ROUNDS):
        name = f"new-{number}"
        paused = await start("robot", name)
        if chance.random() < 0.5:  # from the first sign of it on, or at any moment before
            while not list(folder.glob(f"*{paused.process.pid}-*")):  # noqa: ASYNC110 # the condition
                await asyncio.sleep(0)
        await asyncio.sleep(chance.uniform(0, 0.1))
        paused.signal(signal.SIGSTOP)
        began = time.monotonic()
        told, untold = await stopped(join_realm)
        assert known - {name} <= set(told)
        assert untold.keys() <= {name, f"process {paused.process.pid}"}
        assert time.monotonic() - began < 2.0, "half of it for a busy machine"
        paused.signal(signal.SIGCONT)
        await paused.ready()
        assert await stopped(join_realm, name) == ([name], {})
        paused.signal(signal.SIGKILL)
        await paused.process.wait()


async def test_no_removed_folder_keeps_a_stop_out(
    crew: list[Any], supervisor: RealmClient, join_realm: Join
) -> None:
    chance, folder = random.Random(3), Path(os.environ["XDG_RUNTIME_DIR"]) / "robotree" / "test"
    for _ in range(ROUNDS):
        frozen = chance.choice(crew)
        remove(folder)
        assert await stopped(join_realm) == (NAMES, {})
        frozen.signal(signal.SIGSTOP)
        remove(folder)
        told, untold = await stopped(join_realm)
        assert len(told) == len(NAMES) - 1
        # under load it may have gone on for a moment, and have taken a name again
        (missed,) = untold
        assert missed in {f"process {frozen.process.pid}", NAMES[crew.index(frozen)]}
        frozen.signal(signal.SIGCONT)
        assert sorted(await supervisor.stop(None)) == NAMES
