"""A stand-by host has the robots of one that is away, never while that one may still act."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import Iterator

import pytest

from robotree.vr.base.errors import StandsBy
from tests.durability.stage import HERE, PAGES, PATIENCE, Program, Stage
from tests.vr.space.postgres import Server, server

pytestmark = pytest.mark.e2e

AFTER = 2.5


def standby(stage: Stage, name: str, of: str = "h1") -> Program:
    """A host that stands by for another one: on this machine both use the same log."""
    return stage.program(name, HERE / "host.py", name, stage.folder / f"{of}.journal")


async def stand_by(stage: Stage, *names: str) -> list[Program]:
    hosts = [standby(stage, name) for name in names]
    for host in hosts:
        await host.start(STANDBY_FOR="h1", AFTER=str(AFTER))
        await stage.presence("host", host.name)
    return hosts


async def homes(stage: Stage) -> dict[str, list[str]]:
    """The robots of each host that answers, by name."""
    return {
        host.address.name: [robot.name for robot in host.robots] for host in await stage.realm_client.hosts()
    }


async def ended(program: Program) -> str:
    """Wait until a program has ended by itself; returns what it has said."""
    async with asyncio.timeout(PATIENCE):
        await program.process.wait()
    return program.complaints


async def test_exactly_one_takes_over_and_who_wakes_ends_or_stands_by_for_it(stage: Stage) -> None:
    """The host hangs first, and wakes; then the one that has its robots is killed."""
    h1 = stage.host()
    await stage.furnish(h1)
    hosts = await stand_by(stage, "h2", "h3")
    with pytest.raises(StandsBy, match="host h2 stands by for h1 and takes no robots"):
        await stage.realm_client.create(str(PAGES), "third", "h2", "Tourist")
    before = (await stage.realm_client.describe("arm-1")).bond
    call = stage.begin("tour", steps=12, pause=0.3)
    await stage.until_effects(3)
    h1.process.send_signal(signal.SIGSTOP)
    await stage.until_effects(len(stage.ended) + 3)  # by another one
    after = (await stage.realm_client.describe("arm-1")).bond
    assert before is not None
    assert after is not None
    assert after.epoch > before.epoch, "whatever h1 has left to send is refused"
    h1.process.send_signal(signal.SIGCONT)
    assert "has taken over the robots of" in await ended(h1)
    assert h1.process.returncode == 1
    assert await asyncio.wait_for(call, PATIENCE) == [12.0, 12.0]
    stage.expect_once(*range(12))

    assert any("h1 was not heard" in host.complaints for host in hosts)
    found = await stage.realm_client.hosts()
    assert sorted((len(host.robots), bool(host.stands_by)) for host in found) == [(0, True), (2, False)]
    first = next(host.address.name for host in found if host.robots)
    waits = next(host for host in found if host.stands_by)
    assert waits.stands_by == first
    await h1.start(AFTER=str(AFTER))
    assert f"{first} has the robots; h1 stands by for it" in h1.complaints
    made = await stage.realm_client.create(str(PAGES), "third", wanted="Tourist")
    assert made.host == first, "who stands by is not chosen"

    call = stage.begin("tour", steps=10, pause=0.2)  # its numbers come once more: only keys are compared
    await stage.until_effects(15)
    await next(host for host in hosts if host.name == first).kill()
    await asyncio.wait_for(call, PATIENCE)
    assert not [key for key in stage.twice() if not key.isdecimal()]
    assert sorted((await homes(stage)).values()) == [[], ["helper", "third", "tourist"]]


# -- across machines: PostgreSQL -----------------------------------------------------------------------


@pytest.fixture(scope="module")
def database() -> Iterator[Server]:
    """A server that keeps what it has confirmed when it is killed; its machine lives on."""
    with server("fsync=off", "full_page_writes=off") as running:
        yield running


async def furnished(stage: Stage, database: Server) -> tuple[Program, Program]:
    """h1 with its robots, and h2 that stands by; they share a database and no file."""
    log = f"h1-{stage.folder.name}"
    h1 = stage.host()
    h2 = stage.program("h2", HERE / "host.py", "h2", stage.folder / "h2.journal")
    os.environ["JOURNAL"] = database.url
    try:
        await stage.furnish(h1, LOG=log)
        await h2.start(STANDBY_FOR="h1", AFTER=str(AFTER), LOG=log)
    finally:
        del os.environ["JOURNAL"]
    await stage.presence("host", "h2")
    assert not list(stage.folder.glob("*.journal/*.log"))
    return h1, h2


async def test_across_machines_a_host_goes_on_without_its_database_for_a_while_and_then_another_one_does(
    stage: Stage, database: Server
) -> None:
    """The database crashes and is back; the host is killed; the next one is cut off from it for good."""
    h1, h2 = await furnished(stage, database)
    call = stage.begin("tour", steps=2000, pause=0.1)  # more than it gets to take
    for _ in range(2):
        await stage.until_effects(len(stage.ended) + 3)
        database.stop()
        await asyncio.sleep(0.3)
        database.start()  # a thread that ends would end it, too (pdeathsig)
    await stage.until_effects(len(stage.ended) + 1)
    assert h1.runs
    assert await homes(stage) == {"h1": ["helper", "tourist"], "h2": []}
    await h1.kill()
    await stage.until_effects(len(stage.ended) + 3)
    assert await homes(stage) == {"h2": ["helper", "tourist"]}
    stage.expect_silence()

    database.stop()
    await asyncio.sleep(0.2)
    done = stage.ended
    assert "was not reached for" in await ended(h2)
    assert stage.ended == done
    database.start()
    await h2.start(LOG=f"h1-{stage.folder.name}", JOURNAL=database.url)
    call.cancel()
    await asyncio.gather(call, return_exceptions=True)
    assert stage.twice() == []
    assert stage.ended == list(range(len(stage.ended))), "nothing is left out"
