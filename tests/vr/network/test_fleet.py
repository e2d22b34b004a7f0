"""The fleet as a supervisor sees it: everything by name, and every failure a sentence."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar

import pytest

from robotree.vr import Robot, command
from robotree.vr.address import Address
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.agents.host import Host
from robotree.vr.agents.view import ViewAgent
from robotree.vr.description import RobotDescription, SlotSpec
from robotree.vr.errors import (
    BadName,
    BrokenSource,
    DuplicateName,
    LeaseDenied,
    NoHost,
    NoSuchCommand,
    NoSuchFile,
    NoSuchHost,
    NoSuchRobot,
    NoSuchSlot,
    NoSuchView,
    NotConfirmed,
    NotInControl,
    NotVirtual,
    SlotEmpty,
    StillBonded,
    Stopped,
    Unreachable,
    VrError,
    WrongKind,
)
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.lookup.service import LookupService
from robotree.vr.rehearsal.memory import MemoryNetwork
from robotree.vr.requests import State
from robotree.vr.supervision.fleet import Fleet, from_the_top
from robotree.vr.testing import until

SOURCE = """
from robotree.vr import Child, VirtualRobot, command

class Carrier(VirtualRobot):
    \"\"\"Carries things.\"\"\"
    rover = Child("Rover")

    @command
    def carry(self, far: float) -> float:
        self.progress(0.5, "half way")
        return self.rover.move(x=far)

class Train(VirtualRobot):
    first = Child("Carrier")
    second = Child("Carrier")
"""


class Rover(Robot):
    """A rover without wheels."""

    stopped = ""

    @command
    def move(self, x: float) -> float:
        return x

    def safe_stop(self, reason: str) -> None:
        self.stopped = reason

    def readings(self) -> dict[str, float]:
        return {"x": 1.0}


class Window:
    cameras = ("cell",)
    reading_units: ClassVar[Mapping[str, str]] = {}

    def readings(self) -> dict[str, float]:
        return {}

    async def look(self, camera: str, width: int, height: int, quality: int) -> bytes:
        return f"{camera} {width}x{height} {quality}".encode()


class World:
    """A network with one lookup, one host, two rovers, and a fleet that sees them."""

    def __init__(self, path: Path) -> None:
        self.network = MemoryNetwork()
        self.source = path / "carrier.py"
        self.source.write_text(SOURCE)
        self.lookup = LookupService(self.network.join("lookup"), "lookup-1")
        transport = self.network.join("host")
        self.host = Host(transport, "host-1", registrar=Registrar(transport))
        self.fleet = Fleet(self.network.join("operator"))
        self.agents: dict[str, RobotAgent] = {}

    async def open(self) -> None:
        await asyncio.gather(self.lookup.start(), self.host.start(), self.fleet.start())
        await asyncio.gather(*(self.add(name) for name in ("r1", "r2")))
        await until(lambda: self.names == ["r1", "r2"], "the rovers are listed")

    async def add(self, name: str) -> None:
        transport = self.network.join(name)
        self.agents[name] = RobotAgent(Rover(name), transport, registrar=Registrar(transport))
        await self.agents[name].start()

    async def create(self, name: str, wanted: str = "Carrier", host: str = "") -> RobotDescription:
        return await self.fleet.create(str(self.source), name, host, wanted)

    @property
    def names(self) -> list[str]:
        return [listing.name for listing in self.fleet.robots()]

    async def close(self) -> None:
        for agent in self.agents.values():
            await agent.close()
        await self.host.close()
        await self.fleet.close()
        await self.lookup.close()
        for transport in list(self.network.members):
            await transport.close()


@pytest.fixture
async def world(tmp_path: Path) -> AsyncIterator[World]:
    world = World(tmp_path)
    await world.open()
    yield world
    await world.close()


async def test_the_thesis_story_by_name(world: World) -> None:
    fleet = world.fleet
    made = await world.create("carrier")
    assert (made.kind, made.host) == ("Carrier", "host-1")
    parent = await fleet.enslave("carrier", "rover", "r1")
    assert parent.slots[0].child == world.agents["r1"].address
    await until(lambda: world.names == ["carrier", "r2"], "the enslaved leaves the list")
    assert (await fleet.describe("r1")).bond is not None, "and is still found by name"
    progress: list[tuple[float, str]] = []
    result = await fleet.call(
        "carrier", "carry", {"far": 2.0}, deadline=10, on_progress=lambda *told: progress.append(told)
    )
    assert result == 2.0
    assert progress == [(0.5, "half way")]
    with pytest.raises(NotInControl, match="r1 is commanded by carrier"):
        await fleet.call("r1", "move", {"x": 1.0})
    await world.create("train", "Train")
    await fleet.enslave("train", "first", "carrier")
    with pytest.raises(StillBonded):
        await fleet.delete("carrier")
    await fleet.release("train", "first")
    assert (await fleet.release("carrier", "rover")).slots[0].child is None
    await fleet.delete("carrier")
    await until(lambda: world.names == ["r1", "r2", "train"], "all are free again")
    assert await fleet.call("r1", "move", {"x": 1.0}) == 1.0


async def test_the_tree_shows_parents_before_children_and_everybody_once(world: World) -> None:
    fleet = world.fleet
    await asyncio.gather(world.create("a"), world.create("b"), world.create("t", "Train"))
    await fleet.enslave("t", "second", "a")
    await fleet.enslave("t", "first", "b")
    await fleet.enslave("a", "rover", "r2")
    await fleet.enslave("b", "rover", "r1")
    await world.add("r0")
    assert [robot.name for robot in await fleet.tree()] == ["r0", "t", "b", "a", "r1", "r2"]
    hosts = await fleet.hosts()
    assert [(host.address.name, [robot.name for robot in host.robots]) for host in hosts] == [
        ("host-1", ["a", "b", "t"])
    ]


async def test_the_tree_leaves_out_who_hangs_or_vanishes(world: World) -> None:
    await world.create("carrier")
    await world.fleet.enslave("carrier", "rover", "r1")
    world.network.freeze(world.agents["r1"].transport)  # type: ignore[arg-type]
    assert [robot.name for robot in await world.fleet.tree()] == ["carrier", "r2"]
    world.network.kill(world.agents.pop("r1").transport)  # type: ignore[arg-type]
    assert [robot.name for robot in await world.fleet.tree()] == ["carrier", "r2"]


async def test_states_are_heard_of_one_or_of_all(world: World) -> None:
    heard: dict[str, State] = {}
    only: set[str] = set()
    one = await world.fleet.watch_state("r1", lambda name, _: only.add(name))
    everybody = await world.fleet.watch_state(None, heard.__setitem__)
    world.network.members[0].publish("robot/r1/1/state", b"nonsense")
    await until(lambda: heard.keys() == {"r1", "r2"} and bool(only), "states are heard")
    assert only == {"r1"}
    assert heard["r2"].readings == {"x": 1.0}
    await one.close()
    await everybody.close()
    with pytest.raises(BadName):
        await world.fleet.watch_state("*", heard.__setitem__)


async def test_a_stop_reaches_everybody_the_enslaved_too(world: World) -> None:
    fleet = world.fleet
    await world.create("carrier")
    await fleet.enslave("carrier", "rover", "r1")
    assert sorted(await fleet.stop(None)) == ["carrier", "r1", "r2"]
    rovers = [agent.robot for agent in world.agents.values()]
    await until(lambda: all(isinstance(r, Rover) and r.stopped for r in rovers), "the hardware was told")
    with pytest.raises(Stopped):
        await fleet.call("r2", "move", {"x": 1.0})
    assert sorted(await fleet.resume(None)) == ["carrier", "r1", "r2"], "the enslaved by its parent"
    assert await fleet.call("carrier", "carry", {"far": 1.0}) == 1.0
    assert await fleet.stop("r2") == ["r2"]
    assert await fleet.resume("r2") == ["r2"]


async def test_a_release_for_one_that_only_its_parent_may_release_is_not_confirmed(world: World) -> None:
    fleet = world.fleet
    await world.create("carrier")
    await fleet.enslave("carrier", "rover", "r1")
    await fleet.stop(None)
    with pytest.raises(NotConfirmed, match=r"confirmed by nobody but NOT by r1 .*r1 is commanded by carrier"):
        await fleet.resume("r1")
    assert await fleet.resume("carrier") == ["carrier", "r1"]


async def test_a_stop_that_one_does_not_confirm_is_no_secret_and_reaches_the_others(world: World) -> None:
    world.network.freeze(world.agents["r1"].transport)  # type: ignore[arg-type]
    with pytest.raises(NotConfirmed, match=r"confirmed by r2 but NOT by r1 \(in r1, which hangs\)"):
        await world.fleet.stop(None)
    rover = world.agents["r2"].robot
    assert isinstance(rover, Rover)
    assert rover.stopped
    world.network.thaw(world.agents["r1"].transport)  # type: ignore[arg-type]


async def test_a_stop_that_finds_nobody_at_home_is_not_confirmed(world: World) -> None:
    """Its presence stands, its door is shut: nobody knows what its hardware does."""
    (key,) = world.agents["r1"].transport.served  # type: ignore[attr-defined]
    world.agents["r1"].transport.served.clear()  # type: ignore[attr-defined]
    with pytest.raises(NotConfirmed, match=r"confirmed by r2 but NOT by r1 \(it ended or cannot be reached"):
        await world.fleet.stop(None)
    with pytest.raises(NotConfirmed, match="confirmed by nobody but NOT by r1"):
        await world.fleet.stop("r1")
    assert key.startswith("robot/r1/")


async def test_who_hangs_is_known_also_when_the_question_ends_before_the_presence(world: World) -> None:
    world.network.lease = 0.2
    silenced = world.agents["r1"].transport
    silenced.served.clear()  # type: ignore[attr-defined] # its link is down already, and it is seen still
    world.network.freeze(silenced)  # type: ignore[arg-type]
    with pytest.raises(NotConfirmed, match=r"confirmed by r2 but NOT by r1 \(in r1, which hangs\)"):
        await world.fleet.stop(None)
    world.network.thaw(silenced)  # type: ignore[arg-type]


async def test_a_stop_knows_of_those_who_were_silent_before_it_came(world: World) -> None:
    world.network.freeze(world.agents["r1"].transport)  # type: ignore[arg-type]
    newcomer = Fleet(world.network.join("newcomer"))
    await newcomer.start()
    silent = r"NOT by r1 \(in r1, which hangs\); press the emergency stop .* then: thaw r1"
    with pytest.raises(NotConfirmed, match=f"confirmed by r2 but {silent}"):
        await newcomer.stop(None)
    with pytest.raises(NotConfirmed, match=f"confirmed by nobody but {silent}"):
        await newcomer.stop("r1")
    with pytest.raises(NotConfirmed, match="look at them, then resume again, then: thaw r1"):
        await newcomer.resume(None)
    world.network.thaw(world.agents["r1"].transport)  # type: ignore[arg-type]
    assert list(await newcomer.stop(None)) == ["r1", "r2"]
    await newcomer.close()


async def test_who_comes_to_sight_while_all_are_being_told_is_told(world: World) -> None:
    world.network.freeze(world.agents["r1"].transport)  # type: ignore[arg-type]
    newcomer = Fleet(world.network.join("newcomer"))
    await newcomer.start()
    stopping = asyncio.create_task(newcomer.stop(None))
    rover = world.agents["r2"].robot
    assert isinstance(rover, Rover)
    await until(lambda: bool(rover.stopped), "the others are told at once")
    assert not stopping.done()
    world.network.thaw(world.agents["r1"].transport)  # type: ignore[arg-type]
    assert list(await stopping) == ["r1", "r2"]
    await newcomer.close()


async def test_who_comes_to_sight_while_an_answer_is_awaited_is_told(world: World) -> None:
    served: dict[str, Any] = world.agents["r1"].transport.served  # type: ignore[attr-defined]
    ((key, answer),) = served.items()
    at_last = asyncio.Event()

    async def answer_late(body: bytes, respond: Callable[[bytes], None]) -> None:
        await at_last.wait()
        await answer(body, respond)

    served[key] = answer_late
    stopping = asyncio.create_task(world.fleet.stop(None))
    await until(lambda: stopped(world, "r2"), "the others are told at once")
    await world.add("r3")
    await until(lambda: stopped(world, "r3"), "so is who comes now")
    assert not stopping.done()
    at_last.set()
    assert list(await stopping) == ["r1", "r2", "r3"]


def stopped(world: World, name: str) -> bool:
    rover = world.agents[name].robot
    assert isinstance(rover, Rover)
    return bool(rover.stopped)


async def test_views_are_found_and_looked_through(world: World) -> None:
    transport = world.network.join("view")
    view = ViewAgent(Window(), transport, "cell", registrar=Registrar(transport))
    await view.start()
    await until(lambda: [listing.name for listing in world.fleet.views()] == ["cell"], "a view is listed")
    assert world.names == ["r1", "r2"], "it is no robot"
    picture = await world.fleet.look("cell", width=64, height=48, quality=9)
    assert picture.jpeg == b" 64x48 9"
    assert (await world.fleet.describe_view("cell")).cameras == ("cell",)
    await view.close()


async def test_changes_are_told_and_the_services_are_named(world: World) -> None:
    changes: list[int] = []
    end = world.fleet.on_change(lambda: changes.append(1))
    assert tuple(world.fleet.services) == ("lookup-1",)
    assert not world.fleet.stale
    await world.lookup.close()
    await until(lambda: bool(changes), "the end of a service is a change")
    assert world.fleet.stale
    assert world.names == ["r1", "r2"], "the last knowledge stays"
    assert await world.fleet.call("r1", "move", {"x": 3.0}) == 3.0, "and robots obey"
    end()


async def test_the_host_is_the_one_named_else_the_first(world: World) -> None:
    transport = world.network.join("host-0")
    other = Host(transport, "host-0", registrar=Registrar(transport))
    await other.start()
    assert (await world.create("a")).host == "host-0"
    assert (await world.create("b", host="host-1")).host == "host-1"
    with pytest.raises(NoSuchHost, match="no host named 'host-7'"):
        await world.create("c", host="host-7")
    await other.close()
    await world.host.close()
    with pytest.raises(NoHost, match="no host is running; start one with `robotree host NAME`"):
        await world.create("d")


Ask = Callable[[World], Awaitable[object]]


@pytest.mark.parametrize(
    ("ask", "error"),
    [
        (lambda world: world.fleet.describe("nobody"), NoSuchRobot),
        (lambda world: world.fleet.describe("*"), BadName),
        (lambda world: world.fleet.look("nobody"), NoSuchView),
        (lambda world: world.fleet.describe_view("r1"), NoSuchView),
        (lambda world: world.fleet.create("/no/such.py", "new"), NoSuchFile),
        (lambda world: world.fleet.create("/dev", "new"), NoSuchFile),
        (lambda world: world.create("r1"), DuplicateName),
        (lambda world: world.create("a/b"), BadName),
        (lambda world: world.fleet.call("r2", "fly", {}), NoSuchCommand),
        (lambda world: world.fleet.call("nobody", "move", {}), NoSuchRobot),
        (lambda world: world.fleet.enslave("r1", "rover", "r2"), NotVirtual),
        (lambda world: world.fleet.enslave("carrier", "wheel", "r2"), NoSuchSlot),
        (lambda world: world.fleet.enslave("train", "first", "r2"), WrongKind),
        (lambda world: world.fleet.enslave("carrier", "rover", "nobody"), NoSuchRobot),
        (lambda world: world.fleet.enslave("thief", "rover", "r1"), LeaseDenied),
        (lambda world: world.fleet.call("thief", "carry", {"far": 1.0}), SlotEmpty),
        (lambda world: world.fleet.delete("r2"), NotVirtual),
        (lambda world: world.fleet.stop("nobody"), NoSuchRobot),
    ],
)  # fmt: skip
async def test_every_failure_is_a_sentence(world: World, ask: Ask, error: type[VrError]) -> None:
    await asyncio.gather(world.create("carrier"), world.create("thief"), world.create("train", "Train"))
    await world.fleet.enslave("carrier", "rover", "r1")
    with pytest.raises(error):
        await ask(world)
    names = [robot.name for robot in await world.fleet.tree()]
    assert sorted(names) == ["carrier", "r1", "r2", "thief", "train"], "and nothing is lost"


async def test_source_that_raises_names_the_file(world: World) -> None:
    world.source.write_text("import no_such_module")
    with pytest.raises(BrokenSource, match=r"carrier\.py.*no_such_module"):
        await world.create("new", "")


async def test_after_the_end_everything_is_refused(world: World) -> None:
    world.network.kill(world.agents.pop("r1").transport)  # type: ignore[arg-type]
    with pytest.raises((NoSuchRobot, Unreachable)):
        await world.fleet.describe("r1")


def test_robots_that_command_each_other_are_still_shown() -> None:
    """No such ring can be made, but two descriptions of different moments may look like one."""
    one, other = (Address("robot", name, "1") for name in ("one", "other"))
    ring = [
        RobotDescription(address=me, kinds=("Robot",), slots=(SlotSpec(name="s", kind="Robot", child=it),))
        for me, it in ((one, other), (other, one))
    ]
    assert [robot.name for robot in from_the_top(ring)] == ["one", "other"]
