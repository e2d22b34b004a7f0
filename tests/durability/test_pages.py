"""What pages do beside plain calls goes on after a kill, too: groups, races, clean-ups, waits, refusals."""

from __future__ import annotations

import asyncio
import contextlib
import signal

import pytest

from robotree.vr.base.errors import CommandInDoubt, NotConfirmed, VrError
from tests.durability.stage import PAGES, Program, Stage

pytestmark = pytest.mark.e2e


async def test_parts_that_are_called_at_once(stage: Stage) -> None:
    host = stage.host()
    await stage.furnish(host, "after write 9")
    assert await stage.play(host, "pairs", ["reply came 2"], steps=12) == [2 * n for n in range(12)]
    assert host.lives == 3
    stage.expect_once(*range(12))


async def test_functions_of_the_page_at_once(stage: Stage) -> None:
    host = stage.host()
    await stage.furnish(host, "reply came 7")
    assert await stage.play(host, "parts", ["before write 6"], steps=8) == 2 * sum(range(16))
    assert host.lives == 3
    stage.expect_once(*range(16))


async def test_a_race_has_the_winner_that_it_had(stage: Stage) -> None:
    host = stage.host()
    await stage.furnish(host, "after write 8")
    assert await stage.play(host, "races", ["after step 5"], steps=8) == await stage.realm_client.call(
        "tourist", "winners", {}
    )
    assert host.lives == 3
    assert stage.twice() == []
    stage.expect_silence()


@pytest.mark.parametrize("acted", [2, 4])
async def test_a_command_that_was_cancelled_ends_by_its_clean_up(stage: Stage, acted: int) -> None:
    """The kill comes after the cancel: before the clean-up has begun, or in the middle of it."""
    host = stage.host()
    await stage.furnish(host)
    call = asyncio.ensure_future(stage.realm_client.call("tourist", "careful", {"steps": 200}))
    await stage.until_effects(2)
    await stage.realm_client.cancel("tourist")
    await stage.until_effects(acted)
    await host.kill()
    await host.start()
    with pytest.raises(VrError, match="cancel"):
        await call
    assert [n for n in stage.ended if n >= 100] == [100, 101, 102, 103]
    assert stage.twice() == []
    stage.expect_silence()


async def test_readings_and_what_is_waited_for(stage: Stage) -> None:
    host = stage.host()
    await stage.furnish(host, "after write 5")
    assert await stage.play(host, "watch", ["after step 3"], steps=4) == [1.0, 2.0, 3.0, 4.0]
    assert host.lives == 3
    stage.expect_once(*range(4))


async def test_what_was_told_or_detached_goes_on_by_itself(stage: Stage) -> None:
    host = stage.host()
    await stage.furnish(host, "after write 7")
    assert await stage.play(host, "telling", ["after send 3"], steps=6) == 6
    await stage.until_effects(12)
    stage.expect_once(*range(6), *range(100, 106))


async def test_a_setting_that_is_changed_in_the_middle_is_read_as_it_was(stage: Stage) -> None:
    host = stage.host()
    await stage.furnish(host)
    call = asyncio.ensure_future(stage.realm_client.call("tourist", "paced", {"steps": 8}))
    await stage.until_effects(3)
    await stage.realm_client.call("tourist", "set", {"pace": 0.5})
    await stage.until_effects(5)
    await host.kill()
    await host.start()
    paces = await call
    assert sorted(paces) == paces
    assert set(paces) == {0.0, 0.5}
    assert 3 <= paces.count(0.0) <= 4, "each reads what it read before the kill"
    stage.expect_once(*range(8))


async def test_a_refusal_that_the_page_has_caught_is_caught_again(stage: Stage) -> None:
    host = stage.host()
    await stage.furnish(host, "after step 9")
    words = await stage.play(host, "mending", ["new step 2"], steps=5)
    assert len(words) == 5
    assert len(set(words)) == 1
    stage.expect_once(*range(5))


async def test_after_a_checkpoint_no_earlier_step_is_needed(stage: Stage) -> None:
    host = stage.host()
    await stage.furnish(host, "after send 9")
    assert await stage.play(host, "rounds", ["reply came 5", "after write 6"], steps=12) == 12
    stage.expect_once(*range(12), *range(100, 112))


@pytest.mark.parametrize("kill", ["after send 2", "after write 12"])
async def test_after_a_checkpoint_no_step_since_it_is_taken_twice(stage: Stage, kill: str) -> None:
    """The step under way at the crash, and the one before the first checkpoint, are taken once, too."""
    host = await on_patrol(stage, kill)
    result = await stage.play(host, "rounds", ["reply came 3", "after send 2"], robot="patrol", steps=8)
    assert result == list(range(8)), "what it has changed in place is kept at each checkpoint"
    assert host.lives >= 3
    stage.expect_once(1000, *range(16))


async def test_checkpoints_within_rounds_of_others(stage: Stage) -> None:
    host = await on_patrol(stage, "reply came 6")
    assert await stage.play(host, "nested", ["after send 3", "reply came 4"], robot="patrol", steps=3) == 9
    stage.expect_once(*range(9), *range(1000, 1003))


async def on_patrol(stage: Stage, kill: str) -> Program:
    host = stage.host()
    await host.start(KILL=kill)
    await stage.presence("host", host.name)
    await stage.realm_client.create(str(PAGES), "patrol", host.name, "Patrol")
    await stage.presence("robot", "arm-1")
    await stage.realm_client.enslave("patrol", "arm", "arm-1")
    return host


async def test_a_thread_of_the_pages_own_leaves_the_command_in_doubt(stage: Stage) -> None:
    host = stage.host()
    await stage.furnish(host, "reply came 3")
    with pytest.raises(CommandInDoubt, match="thread of its page's own"):
        await stage.play(host, "threading", [], steps=6)
    assert stage.twice() == []
    stage.expect_silence()


async def test_a_page_that_was_reloaded_is_the_one_that_comes_back(stage: Stage) -> None:
    host = stage.host()
    await stage.furnish(host)
    await stage.realm_client.call("tourist", "tour", {"steps": 2})
    other = stage.folder / "other.py"
    other.write_text(PAGES.read_text().replace("steps: int, pause", "steps: int = 4, pause"))
    await stage.realm_client.reload("tourist", str(other), "Tourist")
    other.unlink()
    await host.kill()
    await host.start()
    stage.effects_file.write_text("")
    assert await stage.realm_client.call("tourist", "tour", {}) == [6.0, 6.0]  # two of them before
    stage.expect_once(*range(4))


async def test_a_robot_that_was_deleted_stays_away(stage: Stage) -> None:
    host = stage.host()
    await stage.furnish(host)
    await stage.realm_client.delete("tourist")
    await host.kill()
    await host.start()
    assert [robot.name for robot in (await stage.realm_client.hosts())[0].robots] == ["helper"]
    stage.expect_silence()


async def test_a_host_that_is_ended_in_order_ends_its_commands_and_keeps_its_robots(stage: Stage) -> None:
    host = stage.host()
    await stage.furnish(host)
    call = asyncio.ensure_future(stage.realm_client.call("tourist", "tour", {"steps": 1000, "pause": 0.01}))
    await stage.until_effects(5)
    await host.kill(signal.SIGTERM)
    with pytest.raises(VrError):
        await call
    acted = len(stage.ended)
    await host.start()
    await asyncio.sleep(0.3)
    assert len(stage.ended) <= acted + 1
    stage.effects_file.write_text("")
    assert await stage.realm_client.call("tourist", "pairs", {"steps": 2}) == [0, 2]
    stage.expect_once(0, 1)


async def test_a_host_that_forgets_has_no_robots(stage: Stage) -> None:
    host = stage.host()
    await stage.furnish(host, FORGET="yes")
    await host.kill()
    await host.start(FORGET="yes")
    assert [hosts.robots for hosts in await stage.realm_client.hosts()] == [()]
    stage.expect_silence()


async def test_a_stop_while_the_host_is_away_ends_the_command(stage: Stage) -> None:
    host = stage.host()
    await stage.furnish(host)
    call = asyncio.ensure_future(stage.realm_client.call("tourist", "tour", {"steps": 1000, "pause": 0.01}))
    await stage.until_effects(5)
    await host.kill()
    with contextlib.suppress(NotConfirmed):  # it names those who are away, if it has asked them
        await stage.realm_client.stop(None)
    acted = len(stage.ended)
    await host.start()
    with pytest.raises(VrError):
        await call
    await stage.realm_client.resume(None)
    await asyncio.sleep(0.3)
    assert len(stage.ended) <= acted + 1
    assert stage.twice() == []
    stage.expect_silence()


async def test_an_order_to_the_parent_is_obeyed_when_its_host_is_back(stage: Stage) -> None:
    host = stage.host()
    await stage.furnish(host)
    call = asyncio.ensure_future(stage.realm_client.call("tourist", "tour", {"steps": 1000, "pause": 0.01}))
    await stage.until_effects(5)
    await host.kill()
    await host.start()
    await stage.realm_client.cancel("tourist")
    with pytest.raises(VrError):
        await call
    assert stage.twice() == []
    stage.expect_silence()


async def test_the_command_of_a_person_who_has_gone_meanwhile_ends(stage: Stage) -> None:
    host = stage.host()
    await stage.furnish(host)
    words = ("-m", "robotree.tui", "call", "tourist.tour", "steps=2000", "pause=0.01", "--within", "60 s")
    caller = stage.program("caller", *words)
    starting = asyncio.ensure_future(caller.start())
    await stage.until_effects(5)
    await host.kill()
    await caller.kill()
    await asyncio.gather(starting, return_exceptions=True)
    acted = len(stage.ended)
    await host.start()
    await asyncio.sleep(1.5)
    assert len(stage.ended) <= acted + 1, "only the step that was under way may end: nobody waits for more"
    assert stage.twice() == []
    assert "Traceback" not in host.complaints
