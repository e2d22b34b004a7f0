"""Stops and resumes as a supervisor orders them: which robots they reach, and what is said of the others."""

from __future__ import annotations

import asyncio
import math
from typing import Any

import pytest

from robotree.vr.base.errors import NotConfirmed, Stopped
from robotree.vr.base.requests import State
from robotree.vr.base.transport import Incoming
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.supervision.stop import CONFIRM
from robotree.vr.world.testing import until
from tests.vr.supervision.world import Rover, World


def stopped(world: World, name: str) -> bool:
    rover = world.agents[name].robot
    assert isinstance(rover, Rover)
    return bool(rover.stopped)


async def test_a_stop_reaches_everybody_the_enslaved_too(world: World) -> None:
    realm_client = world.realm_client
    await world.create("carrier")
    await realm_client.enslave("carrier", "rover", "r1")
    assert sorted(await realm_client.stop(None)) == ["carrier", "r1", "r2"]
    rovers = [agent.robot for agent in world.agents.values()]
    await until(lambda: all(isinstance(r, Rover) and r.stopped for r in rovers), "the hardware was told")
    with pytest.raises(Stopped):
        await realm_client.call("r2", "move", {"x": 1.0})
    assert sorted(await realm_client.resume(None)) == ["carrier", "r1", "r2"], "the enslaved by its parent"
    assert await realm_client.call("carrier", "carry", {"far": 1.0}) == 1.0
    assert await realm_client.stop("r2") == ["r2"]
    assert await realm_client.resume("r2") == ["r2"]


async def test_a_release_for_one_that_only_its_parent_may_release_is_not_confirmed(world: World) -> None:
    realm_client = world.realm_client
    await world.create("carrier")
    await realm_client.enslave("carrier", "rover", "r1")
    await realm_client.stop(None)
    with pytest.raises(NotConfirmed, match=r"confirmed by nobody but NOT by r1 .*r1 is commanded by carrier"):
        await realm_client.resume("r1")
    assert await realm_client.resume("carrier") == ["carrier", "r1"]


async def test_a_stop_that_finds_nobody_at_home_is_not_confirmed(world: World) -> None:
    """Its presence stands, its door is shut: nobody knows what its hardware does."""
    (key,) = world.agents["r1"].transport.served  # type: ignore[attr-defined]
    world.agents["r1"].transport.served.clear()  # type: ignore[attr-defined]
    with pytest.raises(NotConfirmed, match=r"confirmed by r2 but NOT by r1 \(in r1, which runs and could"):
        await world.realm_client.stop(None)
    with pytest.raises(NotConfirmed, match="confirmed by nobody but NOT by r1"):
        await world.realm_client.stop("r1")
    assert key.startswith("robot/r1/")


async def test_who_hangs_is_known_also_when_the_question_ends_before_the_presence(world: World) -> None:
    world.network.lease = 0.2
    silenced = world.agents["r1"].transport
    silenced.served.clear()  # type: ignore[attr-defined] # its link is down already, and it is seen still
    world.network.freeze(silenced)  # type: ignore[arg-type]
    with pytest.raises(NotConfirmed, match=r"confirmed by r2 but NOT by r1 \(in r1, which hangs\)"):
        await world.realm_client.stop(None)
    world.network.thaw(silenced)  # type: ignore[arg-type]


async def test_a_stop_knows_of_those_who_were_silent_before_it_came(world: World) -> None:
    world.network.freeze(world.agents["r1"].transport)  # type: ignore[arg-type]
    newcomer = RealmClient(world.network.join("newcomer"))
    await newcomer.start()
    silent = r"NOT by r1 \(in r1, which hangs\); press the emergency stop .* then: thaw r1"
    with pytest.raises(NotConfirmed, match=f"confirmed by r2 but {silent}"):
        await newcomer.stop(None)
    assert stopped(world, "r2")
    with pytest.raises(NotConfirmed, match=f"confirmed by nobody but {silent}"):
        await newcomer.stop("r1")
    with pytest.raises(NotConfirmed, match="look at them, then resume again, then: thaw r1"):
        await newcomer.resume(None)
    world.network.thaw(world.agents["r1"].transport)  # type: ignore[arg-type]
    assert list(await newcomer.stop(None)) == ["r1", "r2"]
    await newcomer.close()


async def test_a_robot_whose_process_freezes_and_then_loses_its_files_is_named_soon(world: World) -> None:
    sleeper: Any = world.agents["r1"].transport
    world.network.freeze(sleeper)
    began = asyncio.get_running_loop().time()
    stopping = asyncio.create_task(world.realm_client.stop(None))
    await until(lambda: stopped(world, "r2"), "all are told")
    world.network.unlist(sleeper)
    with pytest.raises(
        NotConfirmed, match=r"by r2 but NOT by r1 \(in r1, which hangs\); r1 \(its entry is gone\)"
    ):
        await stopping
    assert asyncio.get_running_loop().time() - began < CONFIRM / 2
    world.network.thaw(sleeper)


async def test_who_comes_to_sight_while_an_answer_is_awaited_is_told(world: World) -> None:
    served: dict[str, Any] = world.agents["r1"].transport.served  # type: ignore[attr-defined]
    ((key, answer),) = served.items()
    at_last, loop = asyncio.Event(), asyncio.get_running_loop()
    late: list[asyncio.Task[bool]] = []

    def answer_late(incoming: Incoming) -> None:
        late.append(loop.create_task(at_last.wait()))
        late[0].add_done_callback(lambda _: answer(incoming))

    served[key] = answer_late
    stopping = asyncio.create_task(world.realm_client.stop(None))
    await until(lambda: stopped(world, "r2"), "the others are told at once")
    await world.add("r3")
    await until(lambda: stopped(world, "r3"), "so is who comes now")
    assert not stopping.done()
    at_last.set()
    assert list(await stopping) == ["r1", "r2", "r3"]


async def test_a_stop_that_came_after_a_resume_was_given_stays_however_late_the_resume_is_sent(
    world: World,
) -> None:
    """A command line has to come into the realm, and to ask for the counts, before it can send anything."""
    await world.create("carrier")
    await world.realm_client.enslave("carrier", "rover", "r1")
    await world.realm_client.stop(None)
    given = asyncio.get_running_loop().time()
    await asyncio.sleep(0.01)
    assert await world.realm_client.stop("r2") == ["r2"]
    again = r"NOT by r2 \(it was stopped again after that had been asked for\)"
    with pytest.raises(NotConfirmed, match=f"confirmed by carrier, r1 but {again}"):
        await world.realm_client.resume(None, given=given)
    with pytest.raises(Stopped):
        await world.realm_client.call("r2", "move", {"x": 1.0})
    assert await world.realm_client.stop("r1") == ["r1"]
    with pytest.raises(NotConfirmed, match=r"NOT by .*r1 \(it was stopped again"):
        await world.realm_client.resume("carrier", given=given)
    assert sorted(await world.realm_client.resume(None)) == ["r1", "r2"]


async def test_a_release_ends_no_stop_that_was_not_heard_of_when_it_was_asked_for(world: World) -> None:
    """At another site the clocks tell nothing; the robots count their stops."""
    heard: dict[str, State] = {}
    watching = await world.realm_client.watch_state(None, heard.__setitem__)
    for name in ("r1", "r2"):
        world.agents[name].stop("first")
    await until(lambda: [state.stops for state in heard.values()] == [1, 1], "both stops are heard of")
    releasing = asyncio.create_task(world.realm_client.resume(None, given=math.inf))
    await asyncio.sleep(0)  # it is asked for, and nobody was reached yet
    world.agents["r2"].stop("second")
    with pytest.raises(NotConfirmed, match=r"confirmed by r1 but NOT by r2 \(it was stopped again"):
        await releasing
    await watching.close()
