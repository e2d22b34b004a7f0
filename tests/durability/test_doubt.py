"""A step of which nobody knows: the controller is asked, then the page, then a person; none is repeated."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest

from robotree.client.joining import joined
from robotree.vr.base.errors import CommandInDoubt, EndedInDoubt
from tests.durability.stage import HERE, PATIENCE, Program, Stage
from tests.ports import free_port

pytestmark = pytest.mark.e2e
DRIVERS = HERE / "drivers.py"
LEG = 0.1


class Road(Stage):
    """A rover with its controller and its proxy, and a host with a driver: processes that can be killed."""

    controller: Program
    proxy: Program
    driver: Program

    async def build(self, page: str, kill: str = "", **settings: Any) -> None:
        url = f"tcp:127.0.0.1:{free_port()}"
        memory = self.folder / "controller.state"
        words = ("-m", "robotree.tui")
        self.controller = self.program(
            "controller", *words, "sim", "rover", "--listen", url, "--open", "--state", memory
        )
        self.proxy = self.program("proxy", *words, "proxy", "rover", "rover-1", "--connect", url, "--open")
        self.driver = self.host()
        self.driver.environment = {"RETURNS": "120"}  # a busy machine starts three processes slowly
        await self.controller.start()
        await self.proxy.start()
        await self.driver.start(KILL=kill, WORD="move")
        await self.presence("host", self.driver.name)
        await self.realm_client.create(str(DRIVERS), "driver", self.driver.name, page, settings=settings)
        await self.presence("robot", "rover-1")
        await self.online()
        await self.realm_client.enslave("driver", "rover", "rover-1")

    async def online(self) -> None:
        async with asyncio.timeout(PATIENCE):
            while not (await self.realm_client.describe("rover-1")).online:  # noqa: ASYNC110 # of another process
                await asyncio.sleep(0.02)

    async def where(self) -> float:
        return float((await self.realm_client.describe("rover-1")).readings["x"])

    async def at_rest(self, x: float) -> None:
        """Wait until the rover has come to a place, and stands there."""
        async with asyncio.timeout(PATIENCE):
            while abs(await self.where() - x) > 0.003:  # noqa: ASYNC110 # of another process
                await asyncio.sleep(0.05)
        await asyncio.sleep(0.3)
        assert await self.where() == pytest.approx(x, abs=0.005)

    async def again(self, *programs: Program) -> None:
        """Kill those that still run, and start all again, in this order."""
        for program in programs:
            if program.runs:
                await program.kill()
        for program in programs:
            if program is self.driver:  # it may call the rover at once
                await self.presence("robot", "rover-1")
                await self.online()
            await program.start()

    async def question(self) -> str:
        """Wait until a person is asked; return the question."""
        async with asyncio.timeout(PATIENCE):
            while not (asks := (await self.realm_client.describe("driver")).asks):  # noqa: ASYNC110 # of another process
                await asyncio.sleep(0.05)
        return asks

    async def kept(self, name: str) -> Any:
        return (await self.realm_client.describe("driver")).kept[name]

    def call(self, command: str = "drive", **arguments: Any) -> asyncio.Task[Any]:
        return asyncio.ensure_future(self.realm_client.call("driver", command, arguments, deadline=240.0))


@pytest.fixture
async def road(place: Path, tmp_path: Path) -> AsyncIterator[Road]:
    """A realm of this test alone."""
    del place  # the runtime folder
    road = Road(tmp_path, "doubt")
    try:
        async with joined("doubt") as realm_client:
            road.realm_client = realm_client
            yield road
    finally:
        for program in reversed(road.programs):
            if program.lives:
                await program.kill()


async def lost(
    road: Road, page: str, *, moment: str = "after send 1", command: str = "drive", **options: Any
) -> asyncio.Task[Any]:
    """Have a driver lose the result of its first leg, by its own end."""
    await road.build(page, moment, **options)
    call = road.call(command, **({"legs": 2} if command == "drive" else {}))
    async with asyncio.timeout(PATIENCE):
        await road.driver.process.wait()
    if moment.startswith("after"):
        await road.at_rest(LEG)
    return call


async def test_the_controller_tells_a_new_proxy_that_it_was_done(road: Road) -> None:
    call = await lost(road, "Driver")
    await road.again(road.proxy, road.driver)
    assert await call == 2
    await road.at_rest(2 * LEG)
    road.expect_silence()


async def test_what_the_controller_never_got_is_done_once(road: Road) -> None:
    call = await lost(road, "Driver", moment="before send 1")
    await road.again(road.proxy, road.driver)
    assert await call == 2
    await road.at_rest(2 * LEG)
    road.expect_silence()


async def test_a_controller_that_was_started_again_does_not_know_so_a_person_is_asked(road: Road) -> None:
    call = await lost(road, "Driver")
    await road.again(road.controller, road.proxy, road.driver)
    asked = await road.question()
    assert asked.startswith("rover-1.move(x=0.1, y=0.0) may have been carried out or not")
    assert "rover-1 reads x " in asked
    assert "s ago" in asked
    assert not call.done()
    await road.realm_client.decide("driver", "done")
    assert await call == 2
    await road.at_rest(LEG)  # it began anew at 0, and has driven the second leg
    assert not (await road.realm_client.describe("driver")).asks
    road.expect_silence()


async def test_a_person_has_it_done_again_once(road: Road) -> None:
    call = await lost(road, "Driver")
    await road.again(road.controller, road.proxy, road.driver)
    await road.question()
    await road.realm_client.decide("driver", "again")
    assert await call == 2
    await road.at_rest(2 * LEG)


async def test_a_person_ends_it(road: Road) -> None:
    call = await lost(road, "Driver")
    await road.again(road.controller, road.proxy, road.driver)
    await road.question()
    await road.realm_client.decide("driver", "abort")
    with pytest.raises(EndedInDoubt, match="a person has ended"):
        await call
    await road.at_rest(0.0)


async def test_the_question_is_asked_again_after_another_crash_of_the_host(road: Road) -> None:
    call = await lost(road, "Driver")
    await road.again(road.controller, road.proxy, road.driver)
    await road.question()
    await road.again(road.driver)
    await road.question()
    await road.realm_client.decide("driver", "done")
    assert await call == 2
    await road.at_rest(LEG)


async def test_what_is_done_again_is_known_after_another_crash(road: Road) -> None:
    call = await lost(road, "Driver")
    await road.again(road.controller, road.proxy, road.driver)
    await road.question()
    await road.realm_client.decide("driver", "again")
    async with asyncio.timeout(PATIENCE):
        while await road.where() < LEG / 3:  # noqa: ASYNC110 # of another process
            await asyncio.sleep(0.01)
    await road.again(road.driver)
    assert await call == 2, "the proxy knows the second attempt"
    await road.at_rest(2 * LEG)


@pytest.mark.parametrize(("verdict", "driven"), [("done", LEG), ("not done", 2 * LEG)])
async def test_the_page_verifies_and_nobody_is_asked(road: Road, verdict: str, driven: float) -> None:
    call = await lost(road, "Verifier", verdict=verdict)
    await road.again(road.controller, road.proxy, road.driver)
    assert await call == 2
    await road.at_rest(driven)
    assert await road.kept("asked") == ["rover.move x=0.1 at 0.0"]
    road.expect_silence()


@pytest.mark.parametrize("verdict", ["unknown", "fails"])
async def test_a_page_that_cannot_tell_leaves_it_to_a_person(road: Road, verdict: str) -> None:
    call = await lost(road, "Verifier", verdict=verdict)
    await road.again(road.controller, road.proxy, road.driver)
    await road.question()
    await road.realm_client.decide("driver", "done")
    assert await call == 2
    await road.at_rest(LEG)


async def test_a_page_that_catches_it_gets_it(road: Road) -> None:
    call = await lost(road, "Catcher")
    await road.again(road.controller, road.proxy, road.driver)
    assert await call == 2
    assert "rover-1.move may have been carried out or not" in await road.kept("caught")
    await road.at_rest(LEG)
    road.expect_silence()


async def test_a_part_of_a_group_is_asked_about_too(road: Road) -> None:
    call = await lost(road, "Driver", command="both")
    await road.again(road.controller, road.proxy, road.driver)
    await road.question()
    await road.realm_client.decide("driver", "done")
    assert await call == 2


async def test_without_a_crash_of_the_host_a_controller_that_restarts_leaves_it_in_doubt(road: Road) -> None:
    await road.build("Driver")
    call = road.call(legs=1)
    async with asyncio.timeout(PATIENCE):
        while await road.where() < LEG / 3:  # noqa: ASYNC110 # of another process
            await asyncio.sleep(0.005)
    await road.again(road.controller)
    await road.question()
    await road.realm_client.decide("driver", "again")
    assert await call == 1
    await road.at_rest(LEG)


async def test_a_cancelled_command_asks_no_longer(road: Road) -> None:
    call = await lost(road, "Driver")
    await road.again(road.controller, road.proxy, road.driver)
    await road.question()
    await road.realm_client.cancel("driver")
    with pytest.raises(Exception, match="cancel"):
        await asyncio.wait_for(call, PATIENCE)
    assert not (await road.realm_client.describe("driver")).asks
    assert issubclass(EndedInDoubt, CommandInDoubt)


async def test_again_without_a_child_keeps_the_question(road: Road) -> None:
    call = await lost(road, "Driver")
    await road.again(road.controller, road.proxy, road.driver)
    await road.question()
    await road.realm_client.release("driver", "rover")
    await road.realm_client.decide("driver", "again")
    async with asyncio.timeout(PATIENCE):
        while "nothing was done" not in await road.question():
            assert not call.done()
            await asyncio.sleep(0.05)
    await road.realm_client.enslave("driver", "rover", "rover-1")
    await road.realm_client.decide("driver", "again")
    assert await call == 2
    await road.at_rest(2 * LEG)
