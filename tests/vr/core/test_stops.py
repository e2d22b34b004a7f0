"""Stops and their ends among agents: a later stop stays in force, and only what has happened is reported."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Awaitable
from typing import Any

import pytest

from robotree.vr import Child, VirtualRobot, VrError
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.agents.stops import Stops
from robotree.vr.base.errors import CommandCancelled, CommandFailed, NotConfirmed, NotInControl, Stopped
from robotree.vr.core.machine import LONGEST_QUEUE, decode_state, encode_state
from robotree.vr.exchange.client import RobotClient
from robotree.vr.supervision.realm_client import RealmClient
from tests.vr.core.crew import Driver, Rover, crew
from tests.vr.core.gate import Gate, held_back


class Carrier(VirtualRobot):
    """Carries."""

    rover = Child("Rover")


class Above(VirtualRobot):
    """Has one child of any kind."""

    below = Child("Robot")


@pytest.fixture
async def rover(realm: Any) -> Any:
    return await realm.start(Rover("rover"))


async def pair(realm: Any) -> tuple[RobotAgent, RobotAgent]:
    carrier = await realm.team(Carrier("carrier"), rover=Rover("rover"))
    return carrier, carrier.rover


def stopped(*agents: RobotAgent) -> list[bool]:
    return [agent.description().stopped for agent in agents]


# -- what came later stays -------------------------------------------------------------------------


async def test_a_stop_that_comes_while_a_release_waits_for_the_children_stays(realm: Any) -> None:
    carrier, rover = await pair(realm)
    client = realm.client(carrier)
    await client.safe_stop("first")
    realm.network.delay = 0.1
    resuming = asyncio.create_task(client.resume())
    await asyncio.sleep(0.15)  # the carrier has been told, and waits for the rover
    await client.safe_stop("second")
    with pytest.raises(NotConfirmed, match=r"by rover but NOT by carrier \(it was stopped again after that"):
        await resuming
    assert stopped(carrier, rover) == [True, True]
    await client.resume()
    assert stopped(carrier, rover) == [False, False]


async def test_a_release_ends_no_stop_that_whoever_asked_for_it_had_not_seen(realm: Any, rover: Any) -> None:
    client = realm.client(rover)
    await client.safe_stop("first")
    seen = {rover.address.key: rover.description().stops}
    await client.safe_stop("second")
    for older in (seen, {}):
        with pytest.raises(NotConfirmed, match=r"NOT by rover \(it was stopped again after that had been"):
            await client.resume(seen=older)
    assert stopped(rover) == [True]
    assert rover.robot.stops == ["first", "second"]
    assert await client.resume(seen={rover.address.key: rover.description().stops}) == ("rover",)
    assert stopped(rover) == [False]
    assert await client.resume(seen=seen) == ("rover",), "there is nothing to end any more"


async def test_a_release_on_its_way_through_the_parent_ends_no_later_stop_of_the_child(
    realm: Any, realm_client: RealmClient
) -> None:
    carrier, rover = await pair(realm)
    await realm_client.stop(None)
    realm.network.delay = 0.3
    for name in (None, "carrier"):
        resuming = asyncio.create_task(realm_client.resume(name))
        await asyncio.sleep(0.1)
        assert await realm_client.stop("rover") == ["rover"]
        with pytest.raises(NotConfirmed, match=r"nobody but NOT by rover \(it was stopped again .*; carrier"):
            await resuming
        assert stopped(carrier, rover) == [True, True], "nor does the carrier command what is stopped"
    assert await realm_client.resume(None) == ["carrier", "rover"]
    assert stopped(carrier, rover) == [False, False]


async def test_whoever_comes_after_the_stop_ends_it_at_once(realm: Any, realm_client: RealmClient) -> None:
    carrier, rover = await pair(realm)
    await realm_client.stop("rover")
    newcomer = RealmClient(realm.network.join("newcomer"))
    await newcomer.start()
    assert await newcomer.resume("carrier") == ["rover"], "the carrier was in no stop"
    assert stopped(carrier, rover) == [False, False]
    await newcomer.close()


@pytest.mark.parametrize("gap", [1.0 + number * 0.0037 for number in range(4, 10)])
async def test_who_wakes_up_is_not_released_after_a_stop_by_an_older_release(
    realm: Any, realm_client: RealmClient, gap: float
) -> None:
    realm.network.delay = 0.01
    await realm.start(Rover("awake"))
    hanging = await realm.start(Rover("hanging"))
    await asyncio.sleep(1)
    realm.network.freeze(hanging.transport)
    await asyncio.sleep(5)
    resuming = asyncio.create_task(realm_client.resume(None))
    await asyncio.sleep(gap)
    stopping = asyncio.create_task(realm_client.stop(None))
    await asyncio.sleep(0.5)
    realm.network.thaw(hanging.transport)
    assert "hanging" in await stopping
    with pytest.raises(NotConfirmed, match="hanging"):
        await resuming
    await asyncio.sleep(1)
    assert stopped(hanging) == [True]


async def test_who_wakes_up_while_it_is_being_looked_for_is_not_released(
    realm: Any, realm_client: RealmClient, rover: Any
) -> None:
    """What it has been told of meanwhile nobody has seen."""
    await realm_client.stop("rover")
    realm.network.freeze(rover.transport)
    await asyncio.sleep(5)
    with pytest.raises(NotConfirmed, match=r"NOT by rover \(in rover, which hangs"):
        await realm_client.resume("rover")
    realm.network.thaw(rover.transport)  # the news of it is on its way
    with pytest.raises(NotConfirmed, match=r"NOT by rover \(it came to sight only after that had been"):
        await realm_client.resume("rover")
    assert stopped(rover) == [True]
    await realm.until(lambda: bool(realm_client.directory.present("robot")))
    assert await realm_client.resume("rover") == ["rover"]


async def test_who_lost_the_right_while_it_waited_for_the_children_releases_nothing(realm: Any) -> None:
    carrier, rover = await pair(realm)
    above = await realm.start(Above("above"))
    client = realm.client(carrier)
    await client.safe_stop("so")
    realm.network.delay = 0.3
    resuming = asyncio.create_task(client.resume())
    await asyncio.sleep(0.4)  # the carrier has been told, and waits for the rover
    realm.network.delay = 0.001
    await realm.client(above).enslave("below", carrier.address)
    with pytest.raises(NotInControl):
        await resuming
    assert stopped(carrier, rover) == [True, False]


async def test_a_call_that_came_before_a_stop_does_not_begin_after_its_end(
    realm: Any, monkeypatch: pytest.MonkeyPatch, rover: Any
) -> None:
    client, go_on = realm.client(rover), held_back(monkeypatch)
    call = asyncio.create_task(client.call("move", {"x": "1"}))
    await asyncio.sleep(0.1)
    await client.safe_stop("a hand")
    await client.resume()
    go_on.set()
    with pytest.raises(CommandCancelled, match="a hand"):
        await call
    assert rover.robot.keys == []
    await client.call("move", {"x": "1"})
    assert len(rover.robot.keys) == 1


# -- told is what has happened ---------------------------------------------------------------------


async def test_a_release_names_nobody_whom_no_one_has_released(realm: Any, realm_client: RealmClient) -> None:
    """The carrier has let the rover go, the rover has not heard of it: nobody tells it."""
    carrier, rover = await pair(realm)
    await realm_client.stop(None)
    realm.network.cut(carrier.transport, rover.transport)
    freeing = asyncio.create_task(realm_client.release("carrier", "rover"))
    await asyncio.sleep(0.1)
    with pytest.raises(NotConfirmed, match=r"by carrier but NOT by rover .*rover is commanded by carrier"):
        await realm_client.resume(None)
    assert stopped(carrier, rover) == [False, True]
    await freeing
    await realm.until(lambda: rover.description().bond is None)
    assert await realm_client.resume(None) == ["rover"]


async def test_a_stop_is_told_when_the_hardware_has_confirmed_it(
    realm: Any, realm_client: RealmClient, rover: Any
) -> None:
    rover.robot.silent = True
    stopping = asyncio.create_task(realm_client.stop(None))
    await realm.until(lambda: len(rover.robot.answers) == 1, within=0.1)
    await asyncio.sleep(1)
    assert not stopping.done()
    assert stopped(rover) == [True], "it is seen at once"
    rover.robot.answers[0].set_result(None)
    assert await stopping == ["rover"]


async def test_a_stop_that_the_hardware_does_not_confirm_is_no_success(
    realm: Any, realm_client: RealmClient
) -> None:
    carrier, rover = await pair(realm)
    rover.robot.silent = True
    who = r"by carrier but NOT by rover \(its controller has not confirmed it\); press the emergency stop"
    with pytest.raises(NotConfirmed, match=who):
        await realm_client.stop(None)
    assert [wait.cancelled() for wait in rover.robot.answers] == [True], (
        "asked once, and nobody waits any more"
    )
    assert stopped(carrier, rover) == [True, True]


async def test_a_release_that_the_hardware_does_not_confirm_leaves_the_robot_stopped(
    realm_client: RealmClient, rover: Any
) -> None:
    await realm_client.stop(None)
    rover.robot.silent = True
    with pytest.raises(NotConfirmed, match=r"NOT by rover \(its controller has not confirmed it\); look at"):
        await realm_client.resume(None)
    assert stopped(rover) == [True]
    rover.robot.silent = False
    assert await realm_client.resume(None) == ["rover"]
    assert stopped(rover) == [False]


async def test_what_the_hardware_refuses_for_good_is_the_answer(realm: Any, rover: Any) -> None:
    client = realm.client(rover)
    await client.safe_stop("so")
    rover.robot.silent = True
    resuming = asyncio.create_task(client.resume())
    await realm.until(lambda: len(rover.robot.answers) == 1)
    refusal = CommandFailed(robot="rover", command="resume", detail="held by another")
    rover.robot.answers[0].set_exception(refusal)
    with pytest.raises(CommandFailed, match="held by another"):
        await resuming
    assert stopped(rover) == [True]


@pytest.mark.parametrize("where", ["at once", "later"])
async def test_a_hook_that_fails_has_confirmed_nothing(
    realm: Any, where: str, caplog: pytest.LogCaptureFixture
) -> None:
    class Broken(Rover):
        def safe_stop(self, reason: str) -> Awaitable[None] | None:
            if where == "at once":
                raise ZeroDivisionError(reason)
            return self.fail()

        async def fail(self) -> None:
            raise ZeroDivisionError

    rover = await realm.start(Broken("rover"))
    with pytest.raises(NotConfirmed, match=r"NOT by rover \(its controller has not confirmed it\)"):
        await realm.client(rover).safe_stop("so")
    assert stopped(rover) == [True]
    assert "rover.safe_stop failed" in caplog.text


async def test_a_stop_that_comes_while_the_hardware_is_being_released_stays(realm: Any, rover: Any) -> None:
    client = realm.client(rover)
    await client.safe_stop("first")
    rover.robot.silent = True
    resuming = asyncio.create_task(client.resume())
    await realm.until(lambda: len(rover.robot.answers) == 1)
    rover.robot.silent = False
    await client.safe_stop("second")
    rover.robot.answers[0].set_result(None)
    with pytest.raises(NotConfirmed, match="it was stopped again"):
        await resuming
    assert stopped(rover) == [True]


async def test_a_stop_goes_on_with_a_decoded_state_and_somebody_else_who_asks(realm: Any, rover: Any) -> None:
    rover.robot.silent = True
    asking = asyncio.create_task(realm.client(rover).safe_stop("a hand", order="one"))
    await asyncio.sleep(0.1)
    runtime = rover.runtime
    runtime.core.state = decode_state(encode_state(runtime.core.state))
    rover._stops = Stops(runtime, rover._hooks, None)
    copy = asyncio.create_task(realm.client(rover).safe_stop("a hand", order="one"))
    await asyncio.sleep(0.1)
    assert rover.robot.stops == ["a hand", "a hand"], "what has not answered is asked again"
    rover.robot.answers[-1].set_result(None)
    assert await copy == ("rover",)
    assert runtime.core.state.stop.generation == 1
    asking.cancel()


# -- stops that a robot reports itself, since its controller was stopped directly, count as ordered


HELD = "its controller is in safe stop"


def tell(rover: RobotAgent, halted: str) -> None:
    rover.robot.halted = halted
    rover.notify()


async def test_a_release_ends_no_stop_that_the_controller_told_of_after_it_was_asked_for(
    realm: Any, realm_client: RealmClient, rover: Any
) -> None:
    rover.robot.silent = True
    realm.network.delay = 0.3
    resuming = asyncio.create_task(realm_client.resume("rover"))
    await asyncio.sleep(0.7)
    tell(rover, HELD)
    with pytest.raises(NotConfirmed, match=r"NOT by rover \(it was stopped again after that had been asked"):
        await resuming
    assert rover.robot.stops == [], "the controller hears of none"
    resuming = asyncio.create_task(realm_client.resume("rover"))
    await realm.until(lambda: bool(rover.robot.answers))
    tell(rover, "")
    rover.robot.answers[0].set_result(None)
    assert await resuming == ["rover"]


async def test_a_stop_counts_once_however_often_it_is_told(rover: Any) -> None:
    for halted in (HELD, f"{HELD}: somebody asked for it", HELD):
        tell(rover, halted)
        await asyncio.sleep(0)
    assert rover.description().stops == 1
    tell(rover, "")
    tell(rover, HELD)
    await asyncio.sleep(0)
    assert rover.description().stops == 2, "it has ended and begun within one turn of the loop"


async def test_a_resume_does_not_wait_for_who_is_offline_and_was_never_stopped(
    realm: Any, realm_client: RealmClient
) -> None:
    near, far = await realm.start(Rover("near")), await realm.start(Rover("far"))
    far.robot.online = False
    await realm_client.stop("near")
    near.robot.silent = True
    resuming = asyncio.create_task(realm_client.resume(None))
    await realm.until(lambda: bool(near.robot.answers))
    near.robot.answers[0].set_result(None)
    assert await resuming == ["near"]
    assert far.robot.stops == []


async def test_a_resume_names_who_is_offline_and_stays_stopped(realm_client: RealmClient, rover: Any) -> None:
    await realm_client.stop(None)
    rover.robot.online, rover.robot.silent = False, True
    with pytest.raises(NotConfirmed, match=r"NOT by rover \(it is offline, and its controller has not"):
        await realm_client.resume(None)


async def test_a_resume_that_meets_another_one_under_way_waits_as_well(realm: Any, rover: Any) -> None:
    """What is being released tells no stop any more, and is not confirmed yet."""
    rover.robot.silent = True
    tell(rover, HELD)
    first = asyncio.create_task(realm.client(rover).resume())
    await realm.until(lambda: len(rover.robot.answers) == 1)
    tell(rover, "")
    second = asyncio.create_task(realm.client(rover).resume())
    await realm.until(lambda: len(rover.robot.answers) == 2)
    for release in rover.robot.answers:
        release.set_result(None)
    assert await first == await second == ("rover",)


# -- they go down the tree, ahead of everything; who did not answer is named at the top ------------


async def test_a_stop_goes_ahead_of_everything_and_down_to_the_hardware(realm: Any) -> None:
    driver, left, right = await crew(realm, "left", "right")
    client = realm.client(driver)
    calls = [asyncio.create_task(client.call("both", {"length": 5})) for _ in range(LONGEST_QUEUE + 1)]
    await realm.until(lambda: left.description().busy == right.description().busy == "move")
    await realm.until(lambda: driver.description().waiting == LONGEST_QUEUE)
    began = realm.runner.now()
    await client.safe_stop("a hand in the cell")
    assert realm.runner.now() - began < 0.2
    assert left.robot.stops == right.robot.stops == ["a hand in the cell"]
    results = await asyncio.gather(*calls, return_exceptions=True)
    assert {type(result) for result in results} == {CommandCancelled}
    assert "a hand in the cell" in str(results[0])
    assert left.robot.x < 0.5


async def test_a_stopped_robot_refuses_commands_until_it_is_released(realm: Any) -> None:
    driver, rover = await crew(realm)
    client = realm.client(driver)
    await client.safe_stop("a hand")
    parent = RobotClient(driver.transport, rover.address, sender=driver.address.key)
    for asker, name, epoch in ((client, "drive", None), (parent, "move", rover.description().epoch)):
        with pytest.raises(Stopped, match=r"is stopped \(a hand\); .*`robotree resume driver`"):
            await asker.call(name, {"x": 1}, epoch=epoch)
    assert (await client.call("get_info", {}))["moves"] == 0  # what only reads is no danger
    with pytest.raises(NotInControl):
        await realm.client(rover).resume()
    await client.resume()
    assert rover.robot.stops == ["a hand", "resumed"]
    await client.call("drive", {"x": 1})


async def test_a_stop_that_does_not_reach_a_child_says_so_but_reaches_the_others(realm: Any) -> None:
    driver, left, right = await crew(realm, "left", "right")
    realm.network.lease = 1000.0
    realm.network.freeze(left.transport)
    with pytest.raises(VrError, match=r"by driver, rover-right but NOT by rover-left \(it did not"):
        await realm.client(driver).safe_stop("look out")
    assert right.robot.stops == ["look out"]
    realm.network.thaw(left.transport)


async def test_in_a_deep_tree_the_error_names_the_robot_that_did_not_answer(realm: Any) -> None:
    realm.network.delay = 0.06
    top, *_, rover = await tower(realm, 4)
    realm.network.lease = 1000.0
    realm.network.freeze(rover.transport)
    for order, who in (
        (realm.client(top).safe_stop, "level-0, level-1, level-2, level-3"),
        (realm.client(top).resume, "nobody"),  # each waits for those below it
    ):
        began = realm.runner.now()
        with pytest.raises(NotConfirmed, match=rf"by {who} but NOT by rover \(it did not answer\)"):
            await order(timeout=1.0)
        assert realm.runner.now() - began < 1.0
    realm.network.thaw(rover.transport)


async def tower(realm: Any, levels: int) -> list[Any]:
    """Return a chain of robots, the topmost first; the rover at its foot moves."""
    agents = [await realm.start(Above(f"level-{number}")) for number in range(levels)]
    agents.append(await realm.start(Rover("rover")))
    for parent, child in reversed(list(itertools.pairwise(agents))):
        await realm.client(parent).enslave("below", child.address)
    return agents


async def test_of_thirty_levels_on_a_slow_way_each_one_that_has_stopped_is_said_to_have_stopped(
    realm: Any,
) -> None:
    realm.network.delay = 0.03
    agents = await tower(realm, 30)
    realm_client = RealmClient(realm.network.join("supervisor"))
    await realm_client.start()
    names = sorted(agent.address.name for agent in agents)
    assert sorted(await realm_client.stop("level-0")) == names
    assert sorted(await realm_client.resume("level-0")) == names
    before = [agent.description().stops for agent in agents]
    assert sorted(await realm_client.stop(None)) == names
    assert sorted(await realm_client.resume(None)) == names
    assert [agent.description().stops for agent in agents] == [stops + 1 for stops in before], (
        "one order is one stop, by however many ways it comes"
    )
    await realm_client.close()


async def test_nothing_is_released_while_a_robot_still_stops_whatever_hook_its_author_blocks(
    realm: Any,
) -> None:
    ended = Gate()

    class Slow(Driver):
        def safe_stop(self, reason: str) -> None:  # noqa: ARG002 # slow
            ended.wait()

        def readings(self) -> dict[str, float]:
            ended.wait()
            return {}

    driver = await realm.start(Slow("slow"))
    rover = await realm.start(Rover("rover"))
    client = realm.client(driver)
    await client.enslave("left", rover.address)
    await asyncio.sleep(3.0)  # its readings are asked for meanwhile
    with pytest.raises(NotConfirmed, match=r"by rover but NOT by slow \(its safe_stop has not ended\)"):
        await client.safe_stop("a hand", timeout=0.5)
    with pytest.raises(NotConfirmed, match=r"NOT by slow \(its safe_stop has not ended\)"):
        await client.resume(timeout=0.5)
    with pytest.raises(Stopped):
        await client.call("drive", {"x": 1})
    assert rover.robot.stops == ["a hand"], "nor those below it"
    ended.set()
    await client.resume()
    await client.call("drive", {"x": 1})
