"""Chapter 3.2 of the thesis, "Tolerating Virtual Robot's failures": figures 3.1 to 3.4.

VR1, VR2 and VR3 live on a host each; VR3 has an arm. VR2 crashes twice: first as it is today, where the tree
comes back and the command goes on, and then as the thesis tells it, where it is lost.
"""

from __future__ import annotations

import asyncio
import shutil
import time
from collections.abc import Callable

import pytest

from robotree.vr.base.description import RobotDescription
from robotree.vr.base.errors import SlotEmpty
from robotree.vr.core.bonds import DEFAULT_TERM
from tests.durability.stage import PAGES, PATIENCE, Program, Stage

pytestmark = [pytest.mark.e2e]


class Tree:
    """VR1 > VR2 > VR3 > arm-1, and the hosts of the three."""

    def __init__(self, stage: Stage) -> None:
        self.stage, self.hosts = stage, dict[str, Program]()

    async def start_hosts(self) -> None:
        """Start a lookup service, and a host for each robot."""
        await self.stage.program("lookup", "-m", "robotree.tui", "lookup", "lookup-1").start()
        for robot in ("vr1", "vr2", "vr3"):
            self.hosts[robot] = self.stage.host(f"host-of-{robot}")
            await self.start(robot)

    async def start(self, robot: str) -> None:
        """Start the host of a robot, and make the robot there."""
        host = self.hosts[robot]
        await host.start()
        await self.stage.presence("host", host.name)
        await self.stage.realm_client.create(str(PAGES), robot, host.name, "Helper")
        await self.stage.presence("robot", robot)

    async def enslave(self, parent: str, child: str) -> None:
        await self.stage.realm_client.enslave(parent, "arm", child)

    async def look(self, robot: str) -> RobotDescription:
        return await self.stage.realm_client.describe(robot)

    async def until(self, robot: str, condition: Callable[[RobotDescription], bool]) -> RobotDescription:
        """Ask a robot who it is until something is so."""
        async with asyncio.timeout(PATIENCE):
            while not condition(found := await self.look(robot)):  # noqa: ASYNC110 # an answer has no event
                await asyncio.sleep(0.02)
        return found

    async def until_renewed(self, child: str) -> None:
        """Ask a robot until its lease ends later than at first, however long the answers take."""
        end = remaining(await self.look(child)) + time.monotonic()
        async with asyncio.timeout(PATIENCE):
            asked = time.monotonic()
            while asked + remaining(await self.look(child)) <= end:
                await asyncio.sleep(0.02)  # an answer has no event
                asked = time.monotonic()

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


def remaining(robot: RobotDescription) -> float:
    return 0.0 if robot.bond is None else robot.bond.remaining


async def test_the_figures_of_leases_and_of_a_crash_in_the_middle_of_the_tree(tree: Tree) -> None:
    await tree.start_hosts()
    await tree.until_listed("vr1", "vr2", "vr3")
    for parent, child in (("vr3", "arm-1"), ("vr2", "vr3"), ("vr1", "vr2")):
        await tree.enslave(parent, child)
    await tree.until_listed("vr1")
    epochs: list[int] = []
    for child, parent in (("vr2", "vr1"), ("vr3", "vr2"), ("arm-1", "vr3")):  # figures 3.1 and 3.2
        found = await tree.look(child)
        assert parent_of(found) == parent
        assert 0.0 < remaining(found) <= DEFAULT_TERM
        await tree.until_renewed(child)
        epochs.append(found.epoch)
    assert [(await tree.look(robot)).epoch for robot in ("vr2", "vr3", "arm-1")] == epochs

    call = asyncio.ensure_future(
        tree.stage.realm_client.call("vr1", "act", {"n": 1, "seconds": 1.0}, deadline=240.0)
    )
    await tree.stage.until_effects(1, "begin")
    await tree.hosts["vr2"].kill()  # figures 3.3 and 3.4: both neighbours wait for it
    waiting = await tree.until("vr3", lambda found: found.away is not None)
    assert parent_of(waiting) == "vr2"
    await tree.hosts["vr2"].start(RETURNS="2")  # that long it is awaited when it is killed for good
    assert await call == 2
    await tree.until("vr3", lambda found: found.away is None)
    assert [parent_of(await tree.look(robot)) for robot in ("vr2", "vr3", "arm-1")] == ["vr1", "vr2", "vr3"]
    assert (await tree.look("vr3")).epoch >= epochs[1]
    await tree.until_listed("vr1")
    assert await tree.act(2) == 4

    for parent, child in (("vr2", "vr3"), ("vr1", "vr2")):  # a new bond has the time of VR2's new life
        await tree.stage.realm_client.release(parent, "arm")
        await tree.enslave(parent, child)

    # nobody mends it: VR3 registers again, VR1's pointer is NULL, and a new VR2 takes both places
    await tree.hosts["vr2"].kill()
    await tree.until_listed("vr1", "vr3")
    await tree.until("vr1", lambda found: [slot.child for slot in found.slots] == [None])
    assert parent_of(await tree.look("vr3")) == ""
    assert parent_of(await tree.look("arm-1")) == "vr3", "the rest of the tree is not lost"
    with pytest.raises(SlotEmpty):
        await tree.act(3)
    shutil.rmtree(tree.stage.folder / "host-of-vr2.journal")
    await tree.start("vr2")
    await tree.enslave("vr2", "vr3")
    await tree.enslave("vr1", "vr2")
    assert await tree.act(3) == 6
    tree.stage.expect_once(1, 2, 3)
