"""An author edits a page: the robot goes on with it, and nothing of what it is to the others changes."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

import pytest

from robotree.vr.agents.host import Host
from robotree.vr.base.errors import (
    BadArgument,
    BrokenSource,
    CommandCancelled,
    NoSuchCommand,
    OtherKind,
    ReloadWaits,
    SlotHeld,
)
from robotree.vr.bundle import Bundle
from robotree.vr.exchange.client import HostClient, RobotClient
from robotree.vr.world.network import MemoryNetwork
from robotree.vr.world.testing import until

PAGE = """
from typing import Annotated
from robotree.vr import Child, Range, VirtualRobot, command, state

class Team(VirtualRobot):
    speed: Annotated[float, Range(0, 1)] = 0.1
    picked: int = state(0)
    rover = Child("Rover")

    @command
    def pick(self) -> str:
        self.picked += 1
        return "first"

    @command
    def wait(self, seconds: float) -> str:
        self.sleep(seconds)
        return "first"
"""
ROVER = """
from robotree.vr import VirtualRobot, command

class Rover(VirtualRobot):
    @command
    def move(self) -> None:
        pass
"""
SECOND = PAGE.replace('"first"', '"second"')


class Stage:
    """A host with a team that commands a rover."""

    def __init__(self) -> None:
        self.network = MemoryNetwork()
        self.operator = self.network.join("operator")
        self.host = Host(self.network.join("host-1"), "host-1")
        self.client = HostClient(self.operator, self.host.address)

    async def begin(self) -> None:
        await self.host.start()
        rover = await self.client.create(Bundle(ROVER, "rover.py"), "rover-1")
        team = await self.client.create(Bundle(PAGE, "team.py"), "team", {"speed": 0.5})
        self.team = RobotClient(self.operator, team.address)
        await self.team.enslave("rover", rover.address)

    async def reload(self, source: str, *, now: bool = False, within: float = 5.0) -> tuple[str, ...]:
        bundle = Bundle(source, "team.py")
        return (await self.client.reload(bundle, "team", now=now, within=within)).notes


@pytest.fixture
async def stage() -> AsyncIterator[Stage]:
    stage = Stage()
    await stage.begin()
    yield stage
    await stage.host.close()


async def test_bonds_settings_and_state_stay(stage: Stage) -> None:
    await stage.team.call("pick", {})
    before = await stage.team.describe()
    assert await stage.reload(SECOND) == ()
    assert await stage.team.call("pick", {}) == "second"
    after = await stage.team.describe()
    assert (after.address, after.slots, after.epoch) == (before.address, before.slots, before.epoch)
    assert after.kept == {"picked": 2}
    spec = after.command("set")
    assert spec is not None
    assert spec.parameters[0].default == 0.5


async def test_a_running_command_ends_as_it_began_and_the_next_one_is_the_new_page_s(stage: Stage) -> None:
    first = asyncio.ensure_future(stage.team.call("wait", {"seconds": 0.2}))
    await until(lambda: bool(stage.host.agents["team"].runtime.core.state.calls.running), "it runs")
    waiting = asyncio.ensure_future(stage.team.call("pick", {}))
    await until(lambda: bool(stage.host.agents["team"].runtime.core.state.calls.waiting), "another one waits")
    await stage.reload((RENAMED + THAW).replace('"first"', '"second"'))
    assert (await first, await waiting) == ("first", "second")
    assert (await stage.team.describe()).kept == {"done": ["x"]}, "its state is that of the boundary"


async def test_a_reload_that_waits_too_long_says_so_and_the_old_page_goes_on(stage: Stage) -> None:
    running = asyncio.ensure_future(stage.team.call("wait", {"seconds": 0.5}))
    await until(lambda: bool(stage.host.agents["team"].runtime.core.state.calls.running), "it runs")
    with pytest.raises(ReloadWaits, match=r"team\.wait has not ended within 0\.05 s, so the old page"):
        await stage.reload(SECOND, within=0.05)
    assert await running == "first"
    assert await stage.team.call("pick", {}) == "first"


async def test_a_reload_at_once_cancels_what_runs(stage: Stage) -> None:
    running = asyncio.ensure_future(stage.team.call("wait", {"seconds": 60.0}))
    await until(lambda: bool(stage.host.agents["team"].runtime.core.state.calls.running), "it runs")
    await stage.reload(SECOND, now=True)
    with pytest.raises(CommandCancelled, match="the page of team is reloaded"):
        await running
    assert await stage.team.call("pick", {}) == "second"


@pytest.mark.parametrize(
    ("source", "error", "says"),
    [
        (SECOND.replace("def pick(self)", "def pick(self"), BrokenSource, "team.py cannot be loaded: line"),
        (SECOND + "\n1 / 0\n", BrokenSource, "line 20: ZeroDivisionError"),
        (
            SECOND.replace("class Team", "class Other"),
            OtherKind,
            "team.py defines the kind Other, and team is of kind Team",
        ),
        (SECOND.replace('rover = Child("Rover")', ""), SlotHeld, "team.rover holds rover-1"),
        (SECOND.replace('Child("Rover")', 'Child("Arm")'), SlotHeld, "team.rover holds rover-1"),
        (SECOND.replace("= 0.1", "= 7.0"), BrokenSource, "speed: 7 is out of range"),
    ],
)
async def test_a_page_with_a_mistake_leaves_the_old_one_running(
    stage: Stage, source: str, error: type[Exception], says: str
) -> None:
    with pytest.raises(error) as refused:
        await stage.reload(source)
    assert says in str(refused.value)
    assert await stage.team.call("pick", {}) == "first"
    assert (await stage.team.describe()).slots[0].child is not None


async def test_what_has_disappeared_or_changed_its_type_is_told(stage: Stage) -> None:
    await stage.team.call("pick", {})
    source = SECOND.replace("speed: Annotated[float, Range(0, 1)] = 0.1", "pace: int = 3")
    source = source.replace("picked: int = state(0)", 'picked: str = state("none")\n    spare = Child("Arm")')
    source = source.replace("self.picked += 1", "")
    assert await stage.reload(source) == (
        "pace is new and begins with 3",
        "picked cannot be 1 any more: it is 'none'",
        "speed is gone, with its value 0.5",
    )
    described = await stage.team.describe()
    assert [slot.name for slot in described.slots] == ["spare", "rover"]
    assert described.kept == {"picked": "none"}
    assert await stage.reload(SECOND) == (
        "the slot spare is gone",
        "pace is gone, with its value 3",
        "picked cannot be 'none' any more: it is 0",
        "speed is new and begins with 0.1",
    )


async def test_what_waits_and_fits_the_new_page_no_more_is_refused(stage: Stage) -> None:
    first = asyncio.ensure_future(stage.team.call("wait", {"seconds": 0.2}))
    await until(lambda: bool(stage.host.agents["team"].runtime.core.state.calls.running), "it runs")
    gone = asyncio.ensure_future(stage.team.call("pick", {}))
    await until(lambda: len(stage.host.agents["team"].runtime.core.state.calls.waiting) == 1, "one waits")
    other = asyncio.ensure_future(stage.team.call("wait", {"seconds": 0.0}))
    await until(lambda: len(stage.host.agents["team"].runtime.core.state.calls.waiting) == 2, "two wait")
    await stage.reload(SECOND.replace("def pick", "def take").replace("seconds: float", "minutes: float"))
    assert await first == "first"
    with pytest.raises(NoSuchCommand):
        await gone
    with pytest.raises(BadArgument):
        await other


async def test_the_parent_of_a_reloaded_robot_sees_its_new_commands(stage: Stage) -> None:
    source = ROVER.replace("def move(self)", "def drive(self)")
    await stage.client.reload(Bundle(source, "rover.py"), "rover-1")
    slots = stage.host.agents["team"].runtime.core.state.slots

    def seen() -> list[str]:
        return [command.name for command in slots.require("rover").description.commands]

    await until(lambda: seen() == ["drive"], "the parent knows")


# -- thaw ------------------------------------------------------------------------------------------

RENAMED = PAGE.replace("picked: int = state(0)", "done: list[str] = state([])").replace(
    "self.picked += 1", "self.done.append('x')"
)
THAW = """
    version = "2"

    def thaw(self, state, from_version):
        assert from_version == "", from_version
        count = state.pop("picked")
        return {**state, "done": ["old"] * count}
"""


async def test_a_page_brings_the_state_of_another_version_into_its_form(stage: Stage) -> None:
    for _ in range(3):
        await stage.team.call("pick", {})
    assert await stage.reload(RENAMED + THAW) == ()
    assert (await stage.team.describe()).kept == {"done": ["old", "old", "old"]}
    await stage.team.call("pick", {})
    assert await stage.reload(RENAMED + THAW) == (), "it is not asked about its own form"
    assert (await stage.team.describe()).kept == {"done": ["old", "old", "old", "x"]}


@pytest.mark.parametrize(
    ("thaw", "reason"),
    [
        ("raise ValueError('no way')", "no way"),
        ("return [1]", "thaw returns what cannot be kept: Expected `object`, got `array`"),
        ("return {'done': object()}", "thaw returns what cannot be kept"),
        ("while True: pass", "it did not end within 0.2 s"),
    ],
)
async def test_where_a_thaw_fails_the_old_page_goes_on(stage: Stage, thaw: str, reason: str) -> None:
    await stage.team.call("pick", {})
    page = f"{RENAMED}\n    def thaw(self, state, from_version):\n        {thaw}\n"
    with pytest.raises(BrokenSource) as error:
        await stage.reload(page)
    assert reason in str(error.value)
    assert (await stage.team.describe()).kept == {"picked": 1}
    assert await stage.team.call("pick", {}) == "first"


async def test_what_a_thaw_returns_must_fit_like_any_other_value(stage: Stage) -> None:
    page = f"{RENAMED}\n    def thaw(self, state, from_version):\n        return {{'done': 3, 'more': 1}}\n"
    notes = await stage.reload(page)
    assert "done cannot be 3 any more: it is []" in notes
    assert "more is gone, with its value 1" in notes
