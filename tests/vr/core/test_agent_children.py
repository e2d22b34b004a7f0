"""Commands of virtual robots: ways to call, exposed commands, deadlines, cancels, progress."""

from __future__ import annotations

import asyncio
import math
from typing import Annotated, Any

import msgspec
import pytest

from robotree.vr import (
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
from robotree.vr.base.errors import BadArgument, CommandFailed, NoSuchCommand
from tests.vr.core.crew import Driver, Rover, Top, crew

pytestmark = pytest.mark.usefixtures("homes")


# -- three ways to call ----------------------------------------------------------------------------


async def test_sequential_code_commands_the_child_step_by_step(realm: Any) -> None:
    driver, rover = await crew(realm)
    assert await realm.client(driver).call("square", {"length": 1}, key="k") == 4
    assert rover.robot.keys == ["k/1", "k/2", "k/3", "k/4"]
    assert rover.robot.epochs == [rover.description().epoch] * 4


async def test_a_robot_that_commands_two_at_once(realm: Any) -> None:
    driver, left, right = await crew(realm, "left", "right")
    began = realm.runner.now()
    await realm.client(driver).call("both", {"length": 5}, key="k")
    assert realm.runner.now() - began < 6.0
    assert (left.robot.keys, right.robot.keys) == (["k/1"], ["k/2"])
    assert driver.robot.saw == [False, True, True, 0.5]


async def test_a_future_can_be_asked_later_or_cancelled(realm: Any) -> None:
    driver, rover = await crew(realm)
    await realm.client(driver).call("impatient", {})
    await realm.until(lambda: rover.description().busy == "", within=2.0)
    assert rover.robot.x < 1


@pytest.mark.parametrize(
    ("how", "error", "sentence"),
    [
        ("fall", CommandFailed, "rover-left.fall failed: ValueError: over (crew.py, line "),
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


# -- what is passed down ---------------------------------------------------------------------------


async def test_a_deadline_is_inherited_down_the_tree(realm: Any) -> None:
    driver, rover = await crew(realm)
    began = realm.runner.now()
    with pytest.raises(DeadlineExceeded):
        await realm.client(driver).call("square", {"length": 4}, deadline=6.0)
    assert realm.runner.now() - began == pytest.approx(6.0, abs=0.2)
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
    await realm.until(lambda: len(rover.robot.keys) == moves + 1)


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


# -- exposed commands in other units ---------------------------------------------------------------


class Place(msgspec.Struct):
    x: Annotated[float, Unit("m")]
    turns: int


class Arm(Robot):
    """In metres."""

    x = 0.25

    @command
    def go_to(self, x: Annotated[float, Unit("m"), Range(-1, 1)], n: int = 1) -> Annotated[float, Unit("m")]:
        self.x = x * n
        return self.x

    @command(effect="read")
    def get_info(self) -> Place:
        return Place(self.x, 3)

    @command
    def pick(self) -> None:
        for step in range(1, 4):
            self.progress(step / 3, f"{step} of 3")
            self.sleep(1)


class Workshop(VirtualRobot):
    """In millimetres; says how far it is."""

    arm = Child("Arm")
    move = arm.exposed("go_to", x=Unit("mm"), result=Unit("cm"))
    where = arm.exposed("get_info", x=Unit("mm"))
    go_to = arm.exposed()
    heavy = arm.exposed("go_to", x=Unit("kg"))
    odd = arm.exposed("go_to", y=Unit("mm"))

    @command
    def silent(self) -> None:
        self.arm.pick()

    @command
    def talks(self) -> None:
        self.progress(0.5, "second box")
        self.arm.pick()
        self.progress(1.0, "done")

    @command
    def quick(self) -> None:
        for step in range(1, 7):
            self.progress(step / 6, f"{step} of 6")

    @command
    def floods(self) -> None:
        for step in range(1, 1001):
            self.progress(step / 1000, f"{step} of 1000")


@pytest.fixture
async def workshop(homes: Any) -> Any:
    return await homes.team(Workshop("workshop"), arm=Arm("arm-1"))


async def test_arguments_and_results_are_converted_on_the_way(realm: Any, workshop: Any) -> None:
    client = realm.client(workshop)
    assert await client.call("move", {"x": 300}) == pytest.approx(30)
    assert workshop.arm.robot.x == pytest.approx(0.3)
    assert await client.call("move", {"x": "10 cm", "n": 2}) == pytest.approx(20)
    assert await client.call("where", {}) == {"x": pytest.approx(200), "turns": 3}
    assert await client.call("go_to", {"x": 0.5}) == 0.5, "without units it is the child's own"


async def test_callers_see_their_units_and_limits(realm: Any, workshop: Any) -> None:
    spec = (await realm.client(workshop).describe()).command("move")
    x = spec.parameters[0]
    assert (x.unit, x.lower, x.upper, spec.result[0].unit) == ("mm", -1000, 1000, "cm")
    with pytest.raises(BadArgument, match=r"2000 mm is out of range; give a number in mm from -1000 to 1000"):
        await realm.client(workshop).call("move", {"x": 2000})


async def test_units_that_do_not_fit_say_so(realm: Any, workshop: Any) -> None:
    with pytest.raises(BadArgument, match="kg cannot be turned into m"):
        await realm.client(workshop).call("heavy", {"x": 1})
    with pytest.raises(BadArgument, match=r"arm.go_to has no 'y' with a unit"):
        await realm.client(workshop).call("odd", {"x": 1})
    assert not (await realm.client(workshop).describe()).command("odd").available


# -- how far a command is, as its callers and everybody else see it --------------------------------


async def heard(realm: Any, workshop: Any, command: str) -> list[tuple[float, str]]:
    """Return what a caller hears of a command's progress."""
    found: list[tuple[float, str]] = []
    await realm.client(workshop).call(
        command, {}, on_progress=lambda share, text: found.append((share, text))
    )
    return found


async def test_what_a_child_says_is_shown_while_its_parent_waits(realm: Any, workshop: Any) -> None:
    told = await heard(realm, workshop, "silent")
    assert [text for _, text in told] == [f"arm-1: {step} of 3" for step in (1, 2, 3)]
    assert all(math.isnan(share) for share, _ in told), "how far the child is, is not how far its parent is"


async def test_it_stands_behind_what_the_parent_itself_says(realm: Any, workshop: Any) -> None:
    assert await heard(realm, workshop, "talks") == [
        (0.5, "second box"),
        *((0.5, f"second box; arm-1: {step} of 3") for step in (1, 2, 3)),
        (1.0, "done"),
    ]
    assert not workshop.runtime.runs
    assert not workshop.runtime.frames


async def test_each_of_six_quick_steps_is_told(realm: Any, workshop: Any) -> None:
    assert [text for _, text in await heard(realm, workshop, "quick")] == [f"{n} of 6" for n in range(1, 7)]


async def test_of_a_flood_of_progress_the_last_is_told(realm: Any, workshop: Any) -> None:
    told = await heard(realm, workshop, "floods")
    assert told[-1] == (1.0, "1000 of 1000")
    assert len(told) < 100
