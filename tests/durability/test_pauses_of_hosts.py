"""A paused command is still paused after its host, or that of a child, was killed, and takes single steps."""

from __future__ import annotations

import asyncio

import pytest

from robotree.vr.base.errors import CommandCancelled, NothingHeld, VrError
from tests.durability.stage import PAGES, PATIENCE, Program, Stage

pytestmark = pytest.mark.e2e

STEPS = 6


@pytest.fixture
async def host(stage: Stage) -> Program:
    """A host with both pages."""
    host = stage.host()
    await stage.furnish(host)
    return host


async def paused(stage: Stage) -> tuple[asyncio.Task[object], str]:
    """Begin a tour, pause it in the middle; return it, and the step before which it is."""
    tour = begin(stage)
    await stage.until_effects(1)
    await stage.realm_client.pause("tourist")
    return tour, await held(stage, "tourist")


def begin(stage: Stage) -> asyncio.Task[object]:
    arguments = {"steps": STEPS, "pause": 0.05}
    return asyncio.create_task(stage.realm_client.call("tourist", "tour", arguments, deadline=240.0))


async def held(stage: Stage, name: str) -> str:
    """Wait until a robot is before a step; return it in words."""
    async with asyncio.timeout(PATIENCE):
        while True:
            try:
                robot = await stage.realm_client.describe(name)
            except VrError:  # its host is being started
                await asyncio.sleep(0.01)
                continue
            if robot.held:
                assert robot.paused
                return robot.held
            await asyncio.sleep(0.01)


async def test_a_killed_host_comes_back_paused_before_the_same_step(stage: Stage, host: Program) -> None:
    tour, before = await paused(stage)
    done = stage.effects
    for _ in range(2):
        await host.kill()
        await host.start()
        assert await held(stage, "tourist") == before
    assert stage.effects == done
    assert f"tourist takes {before}" == await stage.realm_client.step("tourist")
    await stage.realm_client.where_held("tourist", within=PATIENCE)
    assert len(stage.effects) <= len(done) + 2, "one step at most, that began and ended"
    await stage.realm_client.go_on("tourist")
    assert await tour == [STEPS, STEPS]
    stage.expect_once(*range(STEPS))


async def test_the_line_of_the_page_is_shown(stage: Stage, host: Program) -> None:
    del host
    tour, step = await paused(stage)
    line = int(step.rpartition(", line ")[2])
    words = step.partition(": ")[2].partition(" ")[0].partition("(")[0]
    text = PAGES.read_text().splitlines()[line - 1]
    assert words.partition(".")[2] in text or words in text
    await stage.realm_client.go_on("tourist")
    await tour


async def test_a_cancel_of_a_paused_command_is_obeyed_after_a_kill(stage: Stage, host: Program) -> None:
    tour, _ = await paused(stage)
    done = stage.effects
    await host.kill()
    await host.start()
    await held(stage, "tourist")
    await stage.realm_client.cancel("tourist")
    with pytest.raises(CommandCancelled):
        await tour
    assert stage.effects == done
    stage.expect_silence()


async def test_a_command_of_a_child_in_another_process_is_paused_and_outlives_both(stage: Stage) -> None:
    """The helper lives on a host of its own; each of both hosts is killed while it is before its step."""
    child, parent = stage.host("h2"), stage.host()
    await child.start()
    await stage.presence("host", "h2")
    await stage.furnish(parent, other="h2")
    await stage.realm_client.pause("tourist")
    tour = begin(stage)
    while "helper.act" not in (await held(stage, "tourist")):
        await stage.realm_client.step("tourist")
        await stage.realm_client.where_held("tourist", within=PATIENCE)
    await stage.realm_client.step("tourist")
    before, done = await held(stage, "helper"), stage.effects
    for host in (child, parent):
        await host.kill()
        await host.start()
        assert await held(stage, "helper") == before
    assert stage.effects == done
    async with asyncio.timeout(PATIENCE):  # the parent's next process holds the child again, and asks it
        while True:
            try:
                assert await stage.realm_client.step("tourist") == f"helper takes {before}"
                break
            except NothingHeld:
                await asyncio.sleep(0.01)
    await stage.until_effects(len(done) // 2 + 1)
    await stage.realm_client.go_on("tourist")
    assert await tour == [STEPS, STEPS]
    stage.expect_once(*range(STEPS))
