"""Chapter 3.2 of the thesis, "Tolerating Virtual Robot's failures": figures 3.1 to 3.4.

VR1, VR2 and VR3 live on a host each; VR3 has an arm. They are played twice: as the thesis tells it, with a
host that keeps nothing, and as it is today, where the tree comes back and the command goes on.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

import pytest

from robotree.vr.base.description import RobotDescription
from robotree.vr.base.errors import SlotEmpty, VrError
from robotree.vr.core.bonds import DEFAULT_TERM
from tests.durability.stage import PAGES, PATIENCE, Program, Stage

pytestmark = [pytest.mark.e2e]


class Tree:
    """VR1 > VR2 > VR3 > arm-1, and the hosts of the three."""

    def __init__(self, stage: Stage) -> None:
        self.stage, self.hosts = stage, dict[str, Program]()

    async def start_hosts(self, *forgetful: str) -> None:
        """Start a lookup service, and a host for each robot; some of them keep nothing."""
        await self.stage.program("lookup", "-m", "robotree.tui", "lookup", "lookup-1").start()
        for robot in ("vr1", "vr2", "vr3"):
            name = f"host-of-{robot}"
            words = ("--forget",) if robot in forgetful else ()
            host = self.hosts[robot] = self.stage.program(name, "-m", "robotree.tui", "host", name, *words)
            await host.start()
            await self.stage.presence("host", name)
            await self.create(robot)

    async def create(self, robot: str) -> None:
        await self.stage.realm_client.create(str(PAGES), robot, f"host-of-{robot}", "Helper")
        await self.stage.presence("robot", robot)

    async def build(self) -> None:
        """Have each enslave the next."""
        for parent, child in (("vr3", "arm-1"), ("vr2", "vr3"), ("vr1", "vr2")):
            await self.stage.realm_client.enslave(parent, "arm", child)

    async def look(self, robot: str) -> RobotDescription:
        return await self.stage.realm_client.describe(robot)

    async def until(self, robot: str, condition: Callable[[RobotDescription], bool]) -> RobotDescription:
        """Ask a robot who it is until something is so."""
        async with asyncio.timeout(PATIENCE):
            while not condition(found := await self.look(robot)):  # noqa: ASYNC110 # an answer has no event
                await asyncio.sleep(0.02)
        return found

    @property
    def listed(self) -> set[str]:
        """Names of the robots that the lookup service lists."""
        return {each.name for each in self.stage.realm_client.directory.listings}

    async def until_listed(self, *names: str) -> None:
        async with asyncio.timeout(PATIENCE):
            while self.listed & {"vr1", "vr2", "vr3"} != set(names):  # noqa: ASYNC110 # a table tells nobody
                await asyncio.sleep(0.02)

    async def act(self, number: int) -> int:
        return int(await self.stage.realm_client.call("vr1", "act", {"n": number}, deadline=240.0))


@pytest.fixture
def tree(stage: Stage) -> Tree:
    return Tree(stage)


def parent_of(robot: RobotDescription) -> str:
    return "" if robot.bond is None else robot.bond.parent.name


async def test_figures_3_3_and_3_4_as_the_thesis_has_them(tree: Tree) -> None:
    """VR2 crashes and is lost: VR3 registers again, VR1's pointer is NULL; a new VR2 takes both places."""
    await tree.start_hosts("vr2")
    await tree.build()
    await tree.hosts["vr2"].kill()
    with pytest.raises(SlotEmpty):
        await tree.act(1)
    await tree.until_listed("vr1", "vr3")
    assert parent_of(await tree.look("vr3")) == ""
    assert [slot.child for slot in (await tree.look("vr1")).slots] == [None]
    assert parent_of(await tree.look("arm-1")) == "vr3", "the rest of the tree is not lost"

    await tree.hosts["vr2"].start()
    await tree.stage.presence("host", "host-of-vr2")
    await tree.create("vr2")
    await tree.stage.realm_client.enslave("vr2", "arm", "vr3")
    await tree.stage.realm_client.enslave("vr1", "arm", "vr2")
    assert await tree.act(2) == 4
    assert tree.stage.twice() == []


async def test_the_figures_with_hosts_that_keep_their_robots(tree: Tree) -> None:
    """A child grants a lease, its parent renews it; VR2 crashes and comes back, and crashes for good."""
    await tree.start_hosts()
    await tree.until_listed("vr1", "vr2", "vr3")
    await tree.build()
    await tree.until_listed("vr1")
    epochs = [(await tree.look(robot)).epoch for robot in ("vr2", "vr3", "arm-1")]
    began = time.monotonic()
    while time.monotonic() < began + DEFAULT_TERM + 1.0:  # figures 3.1 and 3.2
        for child, parent in (("vr2", "vr1"), ("vr3", "vr2"), ("arm-1", "vr3")):
            found = await tree.look(child)
            assert parent_of(found) == parent
            assert found.bond is not None
            assert 0.0 < found.bond.remaining <= DEFAULT_TERM
        await asyncio.sleep(0.2)
    assert [(await tree.look(robot)).epoch for robot in ("vr2", "vr3", "arm-1")] == epochs

    call = asyncio.ensure_future(
        tree.stage.realm_client.call("vr1", "act", {"n": 1, "seconds": 1.0}, deadline=240.0)
    )
    await tree.stage.until_effects(1, "begin")
    await tree.hosts["vr2"].kill()  # figures 3.3 and 3.4: both neighbours wait for it
    waiting = await tree.until("vr3", lambda found: found.away is not None)
    assert parent_of(waiting) == "vr2"
    await tree.hosts["vr2"].start()
    assert await call == 2
    await tree.until("vr3", lambda found: found.away is None)
    assert [parent_of(await tree.look(robot)) for robot in ("vr2", "vr3", "arm-1")] == ["vr1", "vr2", "vr3"]
    assert (await tree.look("vr3")).epoch >= epochs[1]
    await tree.until_listed("vr1")
    assert await tree.act(2) == 4

    await tree.hosts["vr2"].kill()  # nobody mends it: who has waited in vain is free again
    await tree.until_listed("vr1", "vr3")
    assert parent_of(await tree.look("vr3")) == ""
    with pytest.raises(VrError):
        await tree.act(3)
    tree.stage.expect_once(1, 2)
