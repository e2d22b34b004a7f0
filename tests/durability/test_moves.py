"""A robot moves between hosts that are killed at each boundary: nothing twice, exactly one owner."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

from robotree.vr.base.errors import VrError
from robotree.vr.base.permissions import Isolation
from tests.durability.campaign import DESTINATION, SOURCE
from tests.durability.stage import PATIENCE, Program, Stage

pytestmark = pytest.mark.e2e


async def owners(stage: Stage) -> list[str]:
    """Return the hosts that have the tourist."""
    hosts = await stage.realm_client.hosts()
    return [host.address.name for host in hosts if "tourist" in {robot.name for robot in host.robots}]


async def furnished(
    stage: Stage, source: str = "", destination: str = "", *, level: Isolation = "none", **environment: str
) -> list[Program]:
    """Start h1 with the tourist, h2 to which it moves, and h3 with its helper."""
    h1, h2, h3 = stage.host("h1"), stage.host("h2"), stage.host("h3")
    (stage.folder / "h2.journal").mkdir()  # so that its moments count from the start
    if level != "none":  # its commands do not stand in the journal of its host, and begin no count there
        (stage.folder / "h1.journal").mkdir()
    await h2.start(KILL=destination, **(environment if destination else {}))
    await h3.start()
    for name in ("h2", "h3"):
        await stage.presence("host", name)
    await stage.furnish(h1, source, other="h3", level=level, **(environment if source else {}))
    return [h1, h2, h3]


async def until_moved(stage: Stage, hosts: list[Program], name: str, killed: Program | None) -> None:
    """Have the tourist move; who is killed is started again, and whoever has asked does not ask again."""
    asking = asyncio.ensure_future(stage.realm_client.migrate("tourist", name))
    if killed is not None:
        async with asyncio.timeout(PATIENCE):
            await killed.process.wait()
        await killed.start(KILL="")
    with contextlib.suppress(VrError):
        await asking
    latest = time.monotonic() + PATIENCE
    while time.monotonic() < latest:
        for host in hosts:
            if not host.runs:
                assert host.process.returncode == -signal.SIGKILL, host.complaints
                await host.start(KILL="")
        found = await owners(stage)
        if len(found) == 1 and not (await stage.realm_client.describe("tourist")).on_way:
            return
        await asyncio.sleep(0.05)
    raise AssertionError(f"{await owners(stage)}\n{stage.told()}")


def most_at_night(places: Iterable[str], now: str = "") -> list[Any]:
    """Return one place for each run of the tests, or none, the others for `make soak`.

    The family *moves* of the World plays all of them under seeds, and breaks a law without each safeguard.
    """
    return [pytest.param(place, marks=() if place == now else pytest.mark.soak) for place in places]


async def play(
    stage: Stage, hosts: list[Program], killed: Program | None = None, steps: int = 14
) -> list[str]:
    """Have the tourist move in the middle of a tour; returns who has it then."""
    call = stage.begin("tour", steps=steps, pause=0.02)
    await stage.until_effects(3)
    await until_moved(stage, hosts, "h2", killed)
    await asyncio.wait([call], timeout=PATIENCE)
    assert call.done(), f"{await owners(stage)} {stage.effects[-3:]}\n{stage.told()}"
    async with asyncio.timeout(3 * PATIENCE):
        assert await call == [float(steps), float(steps)]
    stage.expect_once(*range(steps))
    return await owners(stage)


async def furnished_at(
    stage: Stage, place: str, level: Isolation = "none", **environment: str
) -> tuple[list[Program], Program]:
    """Return the hosts, and the one that ends at a place: `S` or `D` for source or destination, and where."""
    who, where = place.split()
    kill = f"move {where} 1"
    source, destination = (kill, "") if who == "S" else ("", kill)
    hosts = await furnished(stage, source, destination, level=level, **environment)
    return hosts, hosts[who == "D"]


async def expect_one_owner(stage: Stage, place: str, level: Isolation = "none") -> None:
    hosts, killed = await furnished_at(stage, place, level)
    assert len(await play(stage, hosts, killed)) == 1
    assert killed.lives == 2


BOUNDARIES = [*(f"S {place}" for place in SOURCE), *(f"D {place}" for place in DESTINATION)]


@pytest.mark.parametrize("place", most_at_night(BOUNDARIES, "S out"))
async def test_source_or_destination_is_killed_at_a_boundary(stage: Stage, place: str) -> None:
    await expect_one_owner(stage, place)


@pytest.mark.parametrize("place", most_at_night(["S out", "D logged"], "D logged"))
async def test_a_host_of_a_robot_apart_is_killed_at_a_boundary(stage: Stage, place: str) -> None:
    await expect_one_owner(stage, place, "process")


def is_stopped(stat: Path) -> bool:
    return stat.read_text().rpartition(")")[2].split()[0] == "T"


async def wake_later(program: Program, seconds: float) -> None:
    """Wait until a process has stopped itself, and have it go on after a while."""
    stat = Path(f"/proc/{program.process.pid}/stat")
    async with asyncio.timeout(PATIENCE):
        while not is_stopped(stat):  # noqa: ASYNC110 # a file of the kernel, which tells nobody
            await asyncio.sleep(0.01)
    await asyncio.sleep(seconds)
    program.process.send_signal(signal.SIGCONT)


@pytest.mark.parametrize("place", most_at_night(["S out", "S answered", "D got", "D logged"], "S out"))
async def test_one_of_both_hangs_at_a_boundary_and_wakes(stage: Stage, place: str) -> None:
    """It sleeps longer than it takes to be noticed, and shorter than the children wait."""
    hosts, hanging = await furnished_at(stage, place, HANGS="1")
    waking = asyncio.ensure_future(wake_later(hanging, 2.5))
    assert len(await play(stage, hosts)) == 1
    await waking


async def test_both_are_killed_while_it_is_on_its_way(stage: Stage) -> None:
    hosts = await furnished(stage, "move answered 1", "move logged 1")
    call = stage.begin("tour", steps=14, pause=0.02)
    await stage.until_effects(3)
    asking = asyncio.ensure_future(stage.realm_client.migrate("tourist", "h2"))
    async with asyncio.timeout(PATIENCE):
        await asyncio.gather(*(host.process.wait() for host in hosts[:2]))
    await hosts[0].start(KILL="")  # it knows nothing, asks, and keeps the children meanwhile
    await asyncio.sleep(1.0)
    assert (await stage.realm_client.describe("tourist")).in_doubt
    await hosts[1].start(KILL="")
    async with asyncio.timeout(3 * PATIENCE):
        assert await call == [14.0, 14.0]
    await asyncio.gather(asking, return_exceptions=True)
    assert await owners(stage) == ["h2"]
    stage.expect_once(*range(14))
