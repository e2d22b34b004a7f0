"""Virtual robots at work: they wait, tell, start, let through, pass down deadlines, cancels and stops."""

from __future__ import annotations

import asyncio
import itertools
import math
import threading
from typing import Annotated, Any

import msgspec
import pytest

from robotree.vr import (
    CallFuture,
    Child,
    CommandCancelled,
    DeadlineExceeded,
    Range,
    Robot,
    SlotEmpty,
    Unit,
    VirtualRobot,
    VrError,
    command,
)
from robotree.vr.errors import (
    BadArgument,
    CommandFailed,
    NoSuchCommand,
    NotConfirmed,
    NotInControl,
    Stopped,
)
from robotree.vr.mailbox import LONGEST_QUEUE
from robotree.vr.running.execution import ChildCall

Metres = Annotated[float, Unit("m"), Range(-5, 5), "ahead"]


class Where(msgspec.Struct):
    x: Annotated[float, Unit("m")]
    moves: int


class Rover(Robot):
    """A rover."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.x = 0.0
        self.keys: list[str] = []
        self.epochs: list[int] = []
        self.deadlines: list[float] = []
        self.stops: list[str] = []

    @command(effect="once")
    def move(self, x: Metres, y: float = 0.0) -> None:  # noqa: ARG002 # a straight rover
        """Drive."""
        self.keys.append(self.context.key)
        self.epochs.append(self.context.epoch)
        self.deadlines.append(self.context.deadline_at)
        for _ in range(10):
            self.sleep(abs(x) / 10)
            self.x += x / 10
            self.progress(0.5)

    @command(effect="read")
    def get_info(self) -> Where:
        return Where(self.x, len(self.keys))

    @command
    def fall(self) -> None:
        raise ValueError("over")

    def safe_stop(self, reason: str) -> None:
        self.stops.append(reason)

    def resume(self) -> None:
        self.stops.append("resumed")


class Driver(VirtualRobot):
    """Drives two rovers."""

    left = Child("Rover")
    right = Child("Rover")

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.saw: list[Any] = []

    @command
    def square(self, length: float) -> Any:
        for x, y in ((length, 0), (0, length), (-length, 0), (0, -length)):
            self.left.move(x, y=y)
        return self.left.get_info().moves

    @command
    def both(self, length: float) -> None:
        first, second = self.left.move.start(x=length), self.right.move.start(x=length)
        self.saw += [first.done, math.isnan(first.progress)]
        first.result()
        second.result()
        self.saw += [first.done, first.progress]

    @command
    def impatient(self) -> None:
        future = self.left.move.start(x=5)
        with pytest.raises(TimeoutError):
            future.result(timeout=0.0)
        future.cancel()
        with pytest.raises(CommandCancelled):
            future.result()

    @command
    def fire_and_forget(self) -> None:
        self.left.move.tell(x=4)

    @command
    def clumsy(self, how: str) -> None:
        match how:
            case "fall":
                self.left.fall()
            case "unknown":
                self.left.fly()
            case "wrong":
                self.left.move(x="3 kg")
            case "many":
                self.left.move(1, 2, 3)
            case "twice":
                self.left.move(1, x=1)
            case "part":
                _ = self.left.get_info().colour
            case "empty":
                self.right.move(1)
            case _:
                self.left._private()

    @command
    def catch(self) -> str:
        try:
            self.left.fall()
        except CommandFailed as error:
            return str(error)
        return ""

    @command
    def half(self) -> None:
        self.left.move.start(x=5)
        self.right.fall()

    @command
    def stubborn(self) -> None:
        while True:
            try:
                self.left.move(x=1)
            except VrError:
                self.saw.append("again")

    drive = left.exposed("move")
    get_info = left.exposed()


class Top(VirtualRobot):
    """On top of a driver."""

    driver = Child("Driver")
    go = driver.exposed("drive")

    @command
    def tour(self) -> None:
        self.driver.square(length=1)


async def crew(realm: Any, *slots: str) -> tuple[Any, ...]:
    driver = await realm.start(Driver("driver"))
    rovers = []
    for slot in slots or ("left",):
        rovers.append(await realm.start(Rover(f"rover-{slot}")))
        await realm.client(driver).enslave(slot, rovers[-1].address)
    return (driver, *rovers)


# -- three ways to call ----------------------------------------------------------------------------


async def test_sequential_code_commands_the_child_step_by_step(realm: Any) -> None:
    driver, rover = await crew(realm)
    assert await realm.client(driver).call("square", {"length": 1}, key="k") == 4
    assert rover.robot.keys == ["k/1", "k/2", "k/3", "k/4"]
    assert rover.robot.epochs == [rover.description().epoch] * 4


async def test_a_robot_that_commands_two_at_once(realm: Any) -> None:
    driver, left, right = await crew(realm, "left", "right")
    loop = asyncio.get_running_loop()
    began = loop.time()
    await realm.client(driver).call("both", {"length": 5}, key="k")
    assert loop.time() - began < 6.0
    assert (left.robot.keys, right.robot.keys) == (["k/1"], ["k/2"])
    assert driver.robot.saw == [False, True, True, 0.5]


async def test_a_future_can_be_asked_later_or_cancelled(realm: Any) -> None:
    driver, rover = await crew(realm)
    await realm.client(driver).call("impatient", {})
    await realm.until(lambda: rover.description().busy == "", within=2.0)
    assert rover.robot.x < 1


async def test_one_way_goes_on_after_its_caller_has_ended(realm: Any) -> None:
    driver, rover = await crew(realm)
    await realm.client(driver).call("fire_and_forget", {})
    assert rover.robot.x < 4
    await realm.until(lambda: rover.robot.x == pytest.approx(4))


async def test_what_a_failed_command_has_started_does_not_go_on_alone(realm: Any) -> None:
    driver, left, _ = await crew(realm, "left", "right")
    with pytest.raises(CommandFailed):
        await realm.client(driver).call("half", {})
    await realm.until(lambda: left.description().busy == "", within=1.0)
    assert left.robot.x < 1


@pytest.mark.parametrize(
    ("how", "error", "sentence"),
    [
        ("fall", CommandFailed, "rover-left.fall failed: ValueError: over (test_agent_children.py, line "),
        ("unknown", NoSuchCommand, "rover-left has no command 'fly'; it has: move, get_info, fall"),
        ("wrong", BadArgument, "rover-left.move: x: kg cannot be turned into m; give it in m"),
        ("many", BadArgument, "left.move: value 3: too many; it takes 2 (x, y)"),
        ("twice", BadArgument, "left.move: x: is given twice"),
        (
            "part",
            CommandFailed,
            "driver.clumsy failed: AttributeError: the result has no 'colour'; it has: x, moves",
        ),
        (
            "empty",
            SlotEmpty,
            "driver.right is empty (no child was bound to it); enslave a robot of kind Rover",
        ),
        ("private", CommandFailed, "driver.clumsy failed: AttributeError: _private"),
    ],
)
async def test_the_fault_is_named_where_it_is(
    realm: Any, how: str, error: type[VrError], sentence: str
) -> None:
    driver, _ = await crew(realm)
    with pytest.raises(error) as raised:
        await realm.client(driver).call("clumsy", {"how": how})
    assert str(raised.value).startswith(sentence)


async def test_an_author_can_catch_what_a_child_raises(realm: Any) -> None:
    driver, _ = await crew(realm)
    assert (await realm.client(driver).call("catch", {})).startswith("rover-left.fall failed: ValueError")


# -- what is passed down ---------------------------------------------------------------------------


async def test_a_deadline_is_inherited_down_the_tree(realm: Any) -> None:
    driver, rover = await crew(realm)
    loop = asyncio.get_running_loop()
    began = loop.time()
    with pytest.raises(DeadlineExceeded):
        await realm.client(driver).call("square", {"length": 4}, deadline=6.0)
    assert loop.time() - began == pytest.approx(6.0, abs=0.2)
    assert all(moment <= began + 6.1 for moment in rover.robot.deadlines)
    await realm.until(lambda: rover.description().busy == "", within=1.0)


async def test_a_cancel_goes_down_to_the_leaves(realm: Any) -> None:
    driver, rover = await crew(realm)
    top = await realm.start(Top("top"))
    await realm.client(top).enslave("driver", driver.address)
    touring = asyncio.create_task(realm.client(top).call("tour", {}, key="k"))
    await realm.until(lambda: rover.description().busy == "move")
    assert rover.robot.keys == ["k/1/1"]
    await realm.client(top).cancel("k")
    with pytest.raises(CommandCancelled, match=r"top.tour was cancelled"):
        await touring
    await realm.until(lambda: rover.description().busy == "", within=1.0)
    assert driver.description().busy == ""


async def test_code_that_swallows_its_cancel_cannot_command_any_more(realm: Any) -> None:
    driver, rover = await crew(realm)
    with pytest.raises(DeadlineExceeded):
        await realm.client(driver).call("stubborn", {}, deadline=2.5)
    moves = len(rover.robot.keys)
    assert moves == 3
    await realm.client(driver).call("fire_and_forget", {})
    assert len(rover.robot.keys) == moves + 1


# -- exposed commands ------------------------------------------------------------------------------


async def test_an_exposed_command_looks_as_the_child_says(realm: Any) -> None:
    driver, rover = await crew(realm)
    drive = driver.description().command("drive")
    move = rover.description().command("move")
    assert drive.through == "left.move"
    assert (drive.parameters, drive.doc, drive.effect) == (move.parameters, move.doc, move.effect)


async def test_without_a_child_it_is_there_but_cannot_be_called(realm: Any) -> None:
    driver = await realm.start(Driver("driver"))
    drive = driver.description().command("drive")
    assert (drive.through, drive.available) == ("left.move", False)
    await realm.until(lambda: realm.listed() == ["driver"])
    assert "drive" not in realm.listings()[0].commands
    with pytest.raises(SlotEmpty):
        await realm.client(driver).call("drive", {"x": 1})
    rover = await realm.start(Rover("rover"))
    await realm.client(driver).enslave("left", rover.address)
    await realm.until(lambda: "drive" in realm.listings()[0].commands, within=1.0)


async def test_it_goes_through_with_progress_checks_and_the_queue(realm: Any) -> None:
    driver, rover = await crew(realm)
    heard: list[float] = []
    client = realm.client(driver)
    await client.call(
        "drive", {"x": "50 cm"}, key="k", on_progress=lambda fraction, _: heard.append(fraction)
    )
    assert rover.robot.x == pytest.approx(0.5)
    assert rover.robot.keys == ["k/1"]
    assert heard
    assert set(heard) == {0.5}
    with pytest.raises(BadArgument, match=r"driver.drive: x: 6 m is out of range"):
        await client.call("drive", {"x": 6})
    driving = asyncio.create_task(client.call("drive", {"x": 4}))
    await realm.until(lambda: driver.description().busy == "drive")
    squaring = asyncio.create_task(client.call("square", {"length": 1}))
    await realm.until(lambda: driver.description().waiting == 1)
    assert (await client.call("get_info", {}))["moves"] == 2  # one that reads passes beside
    driving.cancel()
    assert await squaring == 6
    assert driver.description().calls == {"drive": 2, "square": 1, "get_info": 1}


async def test_it_ends_at_the_callers_deadline(realm: Any) -> None:
    driver, rover = await crew(realm)
    with pytest.raises(DeadlineExceeded):
        await realm.client(driver).call("drive", {"x": 5}, deadline=1.0)
    await realm.until(lambda: rover.description().busy == "", within=1.0)


async def test_what_a_grandchild_offers_is_seen_at_the_top_soon_after_it_came(realm: Any) -> None:
    driver, top = await realm.start(Driver("driver")), await realm.start(Top("top"))
    await realm.client(top).enslave("driver", driver.address)
    assert not top.description().command("go").available
    rover = await realm.start(Rover("rover"))
    await realm.client(driver).enslave("left", rover.address)
    await realm.client(top).call("go", {"x": 1})  # at once when it is used
    move = rover.description().command("move")
    await realm.until(lambda: top.description().command("go").parameters == move.parameters, within=0.1)
    realm.kill(rover)
    await realm.until(lambda: not top.description().command("go").available, within=2.5)


# -- protective stop -------------------------------------------------------------------------------


async def test_a_stop_goes_ahead_of_everything_and_down_to_the_hardware(realm: Any) -> None:
    driver, left, right = await crew(realm, "left", "right")
    client = realm.client(driver)
    calls = [asyncio.create_task(client.call("both", {"length": 5})) for _ in range(LONGEST_QUEUE + 1)]
    await realm.until(lambda: left.description().busy == right.description().busy == "move")
    await realm.until(lambda: driver.description().waiting == LONGEST_QUEUE)
    loop = asyncio.get_running_loop()
    began = loop.time()
    await client.safe_stop("a hand in the cell")
    assert loop.time() - began < 0.2
    assert left.robot.stops == right.robot.stops == ["a hand in the cell"]
    results = await asyncio.gather(*calls, return_exceptions=True)
    assert {type(result) for result in results} == {CommandCancelled}
    assert "a hand in the cell" in str(results[0])
    assert left.robot.x < 0.5


async def test_a_stopped_robot_refuses_commands_until_it_is_released(realm: Any) -> None:
    driver, rover = await crew(realm)
    client = realm.client(driver)
    await client.safe_stop("a hand")
    for agent, commander in ((driver, "driver"), (rover, "driver")):
        epoch = None if agent is driver else agent.description().epoch
        name = "drive" if agent is driver else "move"
        with pytest.raises(Stopped, match=rf"is stopped \(a hand\); .*`robotree resume {commander}`"):
            await realm.client(agent).call(name, {"x": 1}, epoch=epoch)
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
    class Over(VirtualRobot):
        below = Child("Robot")

    top, *others = [await realm.start(Over(f"level-{number}")) for number in range(4)]
    rover = await realm.start(Rover("rover"))
    for parent, child in itertools.pairwise([top, *others, rover]):
        await realm.client(parent).enslave("below", child.address)
    realm.network.lease = 1000.0
    realm.network.freeze(rover.transport)
    loop = asyncio.get_running_loop()
    for order, who in (
        (realm.client(top).safe_stop, "level-0, level-1, level-2, level-3"),
        (realm.client(top).resume, "nobody"),  # each waits for those below it
    ):
        began = loop.time()
        with pytest.raises(NotConfirmed, match=rf"by {who} but NOT by rover \(it did not answer\)"):
            await order(timeout=1.0)
        assert loop.time() - began < 1.0
    realm.network.thaw(rover.transport)


async def test_an_author_who_blocks_a_hook_does_not_block_the_stop(realm: Any) -> None:
    release = threading.Event()

    class Deaf(Driver):
        def safe_stop(self, reason: str) -> None:  # noqa: ARG002 # deaf
            release.wait()

        def readings(self) -> dict[str, float]:
            release.wait()
            return {}

    driver = await realm.start(Deaf("deaf"))
    rover = await realm.start(Rover("rover"))
    await realm.client(driver).enslave("left", rover.address)
    await asyncio.sleep(3.0)
    await realm.client(driver).safe_stop("now")
    assert rover.robot.stops == ["now"]
    release.set()


def test_a_future_is_what_the_contract_says() -> None:
    contract = {name for name in vars(CallFuture) if not name.startswith("_")}
    assert contract <= set(dir(ChildCall))
