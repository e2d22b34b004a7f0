"""What the examples promise, kept."""

from __future__ import annotations

import asyncio
import inspect
from pathlib import Path
from typing import Any

import pytest

from robotree.examples.pick_and_place import PickAndPlace
from robotree.kinds import Arm
from robotree.testing import Fake, cell, rehearse, rehearse_seeds
from robotree.testing.team import Team
from robotree.tui.session.script import Do, read
from robotree.vr import BadArgument, CommandCancelled, DeadlineExceeded, Failed
from robotree.vr.author.command import commands_of
from robotree.vr.author.virtual_robot import exposures_of, slots_of
from robotree.vr.base.errors import (
    CommandFailed,
    NobodyAttends,
    SlotEmpty,
    Stopped,
)
from robotree.vr.bundle import Bundle
from robotree.vr.exchange.attendance import Attendance
from robotree.vr.exchange.client import HostClient
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.testing import until
from tests.vr.moving.conftest import Stage, played

Workshop = Any
PAGE = 90
"""Lines."""

PROMISES = {
    "teleop.py": ("TeleOp", {"arm": "Arm"}, {"jog", "twist"}, {"go_to", "get_info", "grip", "halt", "hold"}),
    "move_to.py": ("MoveTo", {"arm": "Arm"}, {"move"}, {"go_to", "get_info", "grip"}),
    "open_close_lever.py": ("OpenCloseLever", {"mover": "MoveTo"}, {"open", "close"}, set[str]()),
    "swing_held.py": ("HeldMove", {"arm": "Arm"}, {"swing"}, set[str]()),
    "move_square.py": ("MoveSquare", {"rover": "Rover"}, {"move_square"}, {"move"}),
    "pick_and_place.py": ("PickAndPlace", {"arm": "Arm"}, {"pick_and_place"}, set[str]()),
    "patrol.py": ("Patrol", {"near": "Rover", "far": "Rover"}, {"patrol", "set"}, set[str]()),
    "smooth_move.py": ("SmoothMove", {"arm": "Arm"}, {"sweep"}, set[str]()),
    "two_arms.py": ("TwoArms", {"left": "Arm", "right": "Arm"}, {"lift", "grip"}, set[str]()),
}


def test_every_example_is_promised(examples: Path) -> None:
    pages = {file.name for file in examples.glob("[!_]*.py") if not file.name.endswith(".panel.py")}
    assert pages == set(PROMISES)


@pytest.mark.parametrize("file", PROMISES)
def test_an_example_is_one_page_that_loads_and_its_first_words_say_how_to_use_it(
    file: str, examples: Path
) -> None:
    kind, slots, commands, exposed = PROMISES[file]
    bundle = Bundle.read(examples / file)
    assert len(bundle.source.splitlines()) <= PAGE
    robot = bundle.load()
    assert robot.__name__ == kind
    assert {name: slot.kind for name, slot in slots_of(robot).items()} == slots
    assert set(commands_of(robot)) == commands
    assert set(exposures_of(robot)) == exposed
    assert all(command.spec.doc for command in commands_of(robot).values())
    text = inspect.getdoc(inspect.getmodule(robot)) or ""
    assert text.startswith(f"{robot.__name__}: ")
    assert f"robotree create examples/{file} as " in text
    assert "robotree enslave " in text
    assert "robotree call " in text


def test_the_session_is_understood_and_creates_what_is_there(examples: Path) -> None:
    script = read((examples / "close_lever.session").read_text(), "close_lever.session")
    created = [
        step.deed.line.text("FILE")
        for step in script.steps
        if isinstance(step.deed, Do) and step.deed.line.verb == "create"
    ]
    assert created == ["teleop.py", "move_to.py", "open_close_lever.py"]
    assert all((examples / file).exists() for file in created)


# -- at work ---------------------------------------------------------------------------------------


async def test_teleop_moves_an_arm_step_by_step(workshop: Workshop) -> None:
    await workshop.proxy("arm", "arm-1")
    teleop = await workshop.create("teleop.py", "teleop", arm="arm-1")
    before = await teleop.call("get_info", {})
    for axis, distance in (("x", 0.08), ("y", "5 cm"), ("z", -0.08)):
        await teleop.call("jog", {"axis": axis, "distance": distance})
    await teleop.call("twist", {"angle": 0.4})
    after = await teleop.call("get_info", {})
    moved = [after[name] - before[name] for name in ("x", "y", "z", "twist")]
    assert moved == pytest.approx([0.08, 0.05, -0.08, 0.4], abs=0.01)
    with pytest.raises(BadArgument, match=r"from -0\.1 to 0\.1"):
        await teleop.call("jog", {"axis": "x", "distance": 2.0})
    await teleop.call("grip", {"action": "close"})
    assert (await teleop.call("get_info", {}))["width"] < 0.002


async def test_move_to_arrives_in_small_steps(workshop: Workshop) -> None:
    await workshop.proxy("arm", "arm-1")
    mover = await workshop.create("move_to.py", "mover", arm="arm-1")
    told: list[str] = []
    goal = {"x": 0.35, "y": 0.1, "z": 0.35, "twist": 0.5}
    await mover.call("move", goal, on_progress=lambda _, text: told.append(text))
    here = await mover.call("get_info", {})
    assert [here[name] for name in goal] == pytest.approx(list(goal.values()), abs=0.005)
    calls = (await workshop.client("arm-1").describe()).calls
    assert calls["go_to"] >= 3
    assert told
    assert all(text.endswith("cm to go") for text in told)


async def test_the_lever_closes_and_nothing_is_pressed_hard(workshop: Workshop) -> None:
    arm = await workshop.proxy("arm", "arm-1")
    await workshop.create("move_to.py", "mover", arm="arm-1")
    lever = await workshop.create("open_close_lever.py", "lever", mover="mover")
    assert arm.readings()["lever"] < -0.75
    assert 0 < await lever.call("close", {}, deadline=300.0) < 35
    assert arm.readings()["lever"] > 0.75
    with pytest.raises(CommandFailed, match=r"the handle is not at -0\.785 rad; is the lever there already"):
        await lever.call("close", {}, deadline=300.0)
    assert 0 < arm.readings()["peak_force"] < 35


async def test_a_rover_drives_a_square_and_ends_where_it_began(workshop: Workshop) -> None:
    rover = await workshop.proxy("rover", "rover-1")
    square = await workshop.create("move_square.py", "square", rover="rover-1")
    before = rover.readings()
    await square.call("move_square", {"length": "12 in"})
    after = rover.readings()
    assert [after["x"] - before["x"], after["y"] - before["y"]] == pytest.approx([0, 0], abs=0.01)
    assert (await workshop.client("rover-1").describe()).calls["move"] == 4
    await square.call("move", {"x": 0.3, "y": -0.2})
    assert [rover.readings()[axis] - after[axis] for axis in "xy"] == pytest.approx([0.3, -0.2], abs=0.01)


async def test_two_arms_move_at_the_same_time(workshop: Workshop) -> None:
    for name in ("arm-1", "arm-2"):
        await workshop.proxy("arm", name)
    pair = await workshop.create("two_arms.py", "pair", left="arm-1", right="arm-2")
    before = [proxy.readings()["z"] for proxy in workshop.proxies.values()]
    assert await pair.call("lift", {"height": -0.1}) < 0.01
    after = [proxy.readings()["z"] for proxy in workshop.proxies.values()]
    assert [new - old for old, new in zip(before, after, strict=True)] == pytest.approx([-0.1] * 2, abs=0.01)
    await pair.call("grip", {"action": "close"})


async def test_an_arm_swings_while_a_key_is_held_and_stands_when_none_is(workshop: Workshop) -> None:
    arm = await workshop.proxy("arm", "arm-1")
    held = await workshop.create("swing_held.py", "held", arm="arm-1")
    with pytest.raises(NobodyAttends):
        await held.call("swing", {})
    person = RealmClient(workshop.network.join("screen"))
    await person.start()
    keys, told = Attendance(), list[str]()

    async def hold() -> None:
        while True:
            keys.press()
            await asyncio.sleep(0.2)

    swinging = asyncio.create_task(
        person.call("held", "swing", {}, on_progress=lambda _, text: told.append(text), attendance=keys)
    )
    holding = asyncio.create_task(hold())
    await until(lambda: any("2 times" in text for text in told), "it swings")
    holding.cancel()
    with pytest.raises(CommandCancelled, match="nobody has held a key for 2 s"):
        await swinging
    await person.close()
    seen = [arm.readings()["y"]]
    for _ in range(10):
        await asyncio.sleep(0.1)
        seen.append(arm.readings()["y"])
    assert max(seen) - min(seen) < 0.01, "the arm stands; swinging it goes 10 cm in this time"


async def test_a_robot_without_its_child_says_what_to_do(workshop: Workshop) -> None:
    lever = await workshop.create("open_close_lever.py", "lever")
    with pytest.raises(SlotEmpty, match=r"`robotree enslave lever\.mover NAME`"):
        await lever.call("close", {})


EXAMPLES = Path(__file__).parents[2] / "examples"
DRIVER = """
class Rover(VirtualRobot):
    legs: int = state(0)

    @command
    def move(self, x: float, y: float) -> None:
        self.sleep(0.01)
        self.legs = self.legs + 1
"""


def test_a_patrol_travels_to_where_its_next_robot_is(tmp_path: Path) -> None:
    async def story(stage: Stage) -> None:
        await stage.add("h1", "h2", "h3")
        await stage.create("h1", "rover-1", DRIVER)
        await stage.create("h2", "rover-2", DRIVER)
        client = HostClient(stage.operator, stage.homes["h3"].host.address)
        await client.create(await asyncio.to_thread(Bundle.read, EXAMPLES / "patrol.py"), "patrol")
        await stage.until(lambda: bool(stage.keys("robot", "patrol")))
        for slot, rover in (("near", "rover-1"), ("far", "rover-2")):
            await stage.enslave("patrol", slot, rover)
        seen: list[str] = []
        for home in stage.homes.values():
            took = home.host.settle_in

            async def settle_in(*given: Any, home: Any = home, took: Any = took) -> Any:
                if given[0].name == "patrol":
                    seen.append(home.name)
                return await took(*given)

            home.host.settle_in = settle_in  # type: ignore[method-assign] # as it is, and noted
        patrol = stage.robot("patrol")
        assert await patrol.call("patrol", {"rounds": 1}) == 4
        assert seen == ["h1", "h2"]
        await stage.migrate("rover-1", "h3")
        assert await patrol.call("patrol", {"rounds": 1}) == 8
        assert seen == ["h1", "h2", "h3", "h2"], "it asks anew where its robots are"
        assert stage.where("patrol") == ["h2"]
        assert (stage.field("rover-1", "legs"), stage.field("rover-2", "legs")) == (4, 4)

    played(tmp_path, story)


WAY = {"x": "30 cm", "y": 0, "to_x": 0.3, "to_y": "20 cm"}
BLOCK = {"x": "30 cm", "y": "-20 cm", "to_x": "30 cm", "to_y": "-30 cm"}
"""From where the block of the cell lies at first."""
HOLDING = {"holding": True}


def last(team: Team) -> str:
    return team.commanded.names[-1]


def test_it_takes_a_thing_from_here_to_there() -> None:
    team = rehearse(PickAndPlace, arm=Fake(Arm, get_info=HOLDING))
    team.call("pick_and_place", **WAY)
    assert team.commanded == [
        ("arm", "go_to", {"x": 0.3, "y": 0, "z": 0.15, "twist": 0}),
        ("arm", "go_to", {"x": 0.3, "y": 0, "z": 0.03, "twist": 0}),
        ("arm", "grip", {"action": "close"}),
        ("arm", "go_to", {"x": 0.3, "y": 0, "z": 0.15, "twist": 0}),
        ("arm", "go_to", {"x": 0.3, "y": 0.2, "z": 0.15, "twist": 0}),
        ("arm", "go_to", {"x": 0.3, "y": 0.2, "z": 0.03, "twist": 0}),
        ("arm", "grip", {"action": "open"}),
        ("arm", "go_to", {"x": 0.3, "y": 0.2, "z": 0.15, "twist": 0}),
        ("arm", "grip", {"action": "open"}),
    ]
    assert team.progress == [(0.5, "gripped")]


def test_it_moves_the_block_of_the_simulated_cell() -> None:
    arm = cell("arm")
    with rehearse(PickAndPlace, arm=arm) as team:
        team.call("pick_and_place", within=120, **BLOCK)
        assert arm.world.block_place == pytest.approx((0.30, -0.30, 0.02), abs=0.005)
        with pytest.raises(Failed, match="nothing is there"):
            team.call("pick_and_place", within=120, **BLOCK)


def test_it_says_that_nothing_is_there() -> None:
    team = rehearse(PickAndPlace, arm=Fake(Arm))
    with pytest.raises(Failed, match="nothing is there"):
        team.call("pick_and_place", **WAY)
    assert last(team) == "arm.grip"


def test_it_lets_go_when_it_is_cancelled_or_late() -> None:
    team = rehearse(PickAndPlace, arm=Fake(Arm, get_info=HOLDING).cancel(at=4, after=0.5))
    with pytest.raises(CommandCancelled):
        team.call("pick_and_place", **WAY)
    assert team.commanded[-1] == ("arm", "grip", {"action": "open"})
    with pytest.raises(DeadlineExceeded):
        team.call("pick_and_place", within=3.5, **WAY)
    assert team.commanded[-1] == ("arm", "grip", {"action": "open"})


def test_nothing_moves_after_a_stop() -> None:
    team = rehearse(PickAndPlace, arm=Fake(Arm, get_info=HOLDING).stop(at=4, after=0.5))
    with pytest.raises(CommandCancelled):
        team.call("pick_and_place", **WAY)
    team.wait(2)
    assert last(team) == "arm.go_to"
    with pytest.raises(Stopped):
        team.call("pick_and_place", **WAY)


def test_it_refuses_what_is_out_of_reach() -> None:
    team = rehearse(PickAndPlace, arm=Fake(Arm))
    with pytest.raises(BadArgument, match=r"x: 90 cm is out of range"):
        team.call("pick_and_place", **WAY | {"x": "90 cm"})


def test_it_keeps_the_laws_under_100_seeds() -> None:
    rehearse_seeds(PickAndPlace, "pick_and_place", WAY, arm=Fake(Arm, get_info=HOLDING))
