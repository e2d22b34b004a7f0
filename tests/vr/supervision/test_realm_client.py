"""The realm client as a supervisor sees it: everything by name, and every failure a sentence."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from robotree.vr.agents.view import ViewAgent
from robotree.vr.base.address import Address
from robotree.vr.base.description import RobotDescription, SlotSpec
from robotree.vr.base.errors import (
    BadName,
    BrokenSource,
    DuplicateName,
    Hanging,
    HostReserved,
    LeaseDenied,
    NoHost,
    NoSuchCommand,
    NoSuchFile,
    NoSuchHost,
    NoSuchRobot,
    NoSuchSlot,
    NoSuchView,
    NotInControl,
    NotVirtual,
    SlotEmpty,
    StillBonded,
    VrError,
    WrongKind,
)
from robotree.vr.base.requests import State
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.supervision.realm_client import RealmClient, from_the_top
from robotree.vr.world.testing import until
from tests.vr.supervision.world import Window, World


async def test_the_thesis_story_by_name(world: World) -> None:
    realm_client = world.realm_client
    made = await world.create("carrier")
    assert (made.kind, made.host) == ("Carrier", "host-1")
    parent = await realm_client.enslave("carrier", "rover", "r1")
    assert parent.slots[0].child == world.agents["r1"].address
    await until(lambda: world.names == ["carrier", "r2"], "the enslaved leaves the list")
    assert (await realm_client.describe("r1")).bond is not None, "and is still found by name"
    progress: list[tuple[float, str]] = []
    result = await realm_client.call(
        "carrier", "carry", {"far": 2.0}, deadline=60, on_progress=lambda *told: progress.append(told)
    )
    assert result == 2.0
    assert progress == [(0.5, "half way")]
    with pytest.raises(NotInControl, match="r1 is commanded by carrier"):
        await realm_client.call("r1", "move", {"x": 1.0})
    await world.create("train", "Train")
    await realm_client.enslave("train", "front", "carrier")
    with pytest.raises(StillBonded):
        await realm_client.delete("carrier")
    await realm_client.release("train", "front")
    assert (await realm_client.release("carrier", "rover")).slots[0].child is None
    await realm_client.delete("carrier")
    await until(lambda: world.names == ["r1", "r2", "train"], "all are free again")
    assert await realm_client.call("r1", "move", {"x": 1.0}) == 1.0


async def test_the_tree_shows_parents_before_children_and_everybody_once(world: World) -> None:
    realm_client = world.realm_client
    await asyncio.gather(world.create("a"), world.create("b"), world.create("t", "Train"))
    await realm_client.enslave("t", "second", "a")
    await realm_client.enslave("t", "front", "b")
    await realm_client.enslave("a", "rover", "r2")
    await realm_client.enslave("b", "rover", "r1")
    await world.add("r0")
    assert [robot.name for robot in await realm_client.tree()] == ["r0", "t", "b", "a", "r1", "r2"]
    hosts = await realm_client.hosts()
    assert [(host.address.name, [robot.name for robot in host.robots]) for host in hosts] == [
        ("host-1", ["a", "b", "t"])
    ]


async def test_the_tree_leaves_out_who_hangs_or_vanishes(world: World) -> None:
    await world.create("carrier")
    await world.realm_client.enslave("carrier", "rover", "r1")
    world.network.freeze(world.agents["r1"].transport)  # type: ignore[arg-type]
    assert [robot.name for robot in await world.realm_client.tree()] == ["carrier", "r2"]
    killed = world.agents.pop("r1")
    world.network.kill(killed.transport)  # type: ignore[arg-type]
    killed.runtime.process.close()
    assert [robot.name for robot in await world.realm_client.tree()] == ["carrier", "r2"]


async def test_states_are_heard_of_one_or_of_all(world: World) -> None:
    heard: dict[str, State] = {}
    only: set[str] = set()
    one = await world.realm_client.watch_state("r1", lambda name, _: only.add(name))
    everybody = await world.realm_client.watch_state(None, heard.__setitem__)
    world.network.members[0].publish("robot/r1/1/state", b"nonsense")
    await until(lambda: heard.keys() == {"r1", "r2"} and bool(only), "states are heard")
    assert only == {"r1"}
    assert heard["r2"].readings == {"x": 1.0}
    await one.close()
    await everybody.close()
    with pytest.raises(BadName):
        await world.realm_client.watch_state("*", heard.__setitem__)


async def test_views_are_found_and_looked_through(world: World) -> None:
    transport = world.network.join("view")
    view = ViewAgent(Window(), transport, "cell", registrar=Registrar(transport))
    await view.start()
    await until(
        lambda: [listing.name for listing in world.realm_client.views()] == ["cell"], "a view is listed"
    )
    assert world.names == ["r1", "r2"], "it is no robot"
    picture = await world.realm_client.look("cell", width=64, height=48, quality=9)
    assert picture.jpeg == b" 64x48 9"
    assert (await world.realm_client.describe_view("cell")).cameras == ("cell",)
    await view.close()


async def test_changes_are_told_and_the_services_are_named(world: World) -> None:
    changes: list[int] = []
    end = world.realm_client.on_change(lambda: changes.append(1))
    assert tuple(world.realm_client.services) == ("lookup-1",)
    assert not world.realm_client.stale
    await world.lookup.close()
    await until(lambda: bool(changes), "the end of a service is a change")
    assert world.realm_client.stale
    assert world.names == ["r1", "r2"], "the last knowledge stays"
    assert await world.realm_client.call("r1", "move", {"x": 3.0}) == 3.0, "and robots obey"
    end()


async def test_the_host_is_the_one_named_else_the_first(world: World) -> None:
    transport = world.network.join("host-0")
    other = world.host_on(transport, "host-0")
    await other.start()
    assert (await world.create("a")).host == "host-0"
    assert (await world.create("b", host="host-1")).host == "host-1"
    with pytest.raises(NoSuchHost, match="no host named 'host-7'"):
        await world.create("c", host="host-7")
    await other.close()
    await world.host.close()
    with pytest.raises(NoHost, match="no host is running; start one with `robotree host NAME`"):
        await world.create("d")


async def test_a_host_for_one_robot_takes_no_other(world: World) -> None:
    transport = world.network.join("host-0")
    alone = world.host_on(transport, "host-0", only="a")
    await alone.start()
    with pytest.raises(HostReserved, match="host 'host-0' runs a alone"):
        await world.create("b", host="host-0")
    assert (await world.create("b")).host == "host-1", "where none is named it is passed over"
    await world.host.close()
    with pytest.raises(HostReserved):
        await world.create("c")
    assert (await world.create("a")).host == "host-0"
    over = asyncio.ensure_future(alone.deserted(5))
    await asyncio.sleep(10)
    assert not over.done()
    await world.realm_client.delete("a")
    await over
    await alone.deserted(5)  # what has come and gone does not come again
    await alone.close()


async def test_a_host_whose_robot_does_not_come_waits_no_longer(world: World) -> None:
    transport = world.network.join("host-0")
    alone = world.host_on(transport, "host-0", only="a")
    await alone.start()
    waiting = asyncio.ensure_future(alone.deserted(0.01))
    await until(waiting.done, "it has waited")
    assert not alone.agents
    await alone.close()


Ask = Callable[[World], Awaitable[object]]


@pytest.mark.parametrize(
    ("ask", "error"),
    [
        (lambda world: world.realm_client.describe("nobody"), NoSuchRobot),
        (lambda world: world.realm_client.describe("*"), BadName),
        (lambda world: world.realm_client.look("nobody"), NoSuchView),
        (lambda world: world.realm_client.describe_view("r1"), NoSuchView),
        (lambda world: world.realm_client.create("/no/such.py", "new"), NoSuchFile),
        (lambda world: world.realm_client.create("/dev", "new"), NoSuchFile),
        (lambda world: world.create("r1"), DuplicateName),
        (lambda world: world.create("a/b"), BadName),
        (lambda world: world.realm_client.call("r2", "fly", {}), NoSuchCommand),
        (lambda world: world.realm_client.call("nobody", "move", {}), NoSuchRobot),
        (lambda world: world.realm_client.enslave("r1", "rover", "r2"), NotVirtual),
        (lambda world: world.realm_client.enslave("carrier", "wheel", "r2"), NoSuchSlot),
        (lambda world: world.realm_client.enslave("train", "front", "r2"), WrongKind),
        (lambda world: world.realm_client.enslave("carrier", "rover", "nobody"), NoSuchRobot),
        (lambda world: world.realm_client.enslave("thief", "rover", "r1"), LeaseDenied),
        (lambda world: world.realm_client.call("thief", "carry", {"far": 1.0}), SlotEmpty),
        (lambda world: world.realm_client.delete("r2"), NotVirtual),
        (lambda world: world.realm_client.stop("nobody"), NoSuchRobot),
    ],
)  # fmt: skip
async def test_every_failure_is_a_sentence(world: World, ask: Ask, error: type[VrError]) -> None:
    await asyncio.gather(world.create("carrier"), world.create("thief"), world.create("train", "Train"))
    await world.realm_client.enslave("carrier", "rover", "r1")
    with pytest.raises(error):
        await ask(world)
    names = [robot.name for robot in await world.realm_client.tree()]
    assert sorted(names) == ["carrier", "r1", "r2", "thief", "train"], "and nothing is lost"


async def test_whatever_is_asked_of_a_frozen_robot_its_process_is_named(world: World) -> None:
    await world.create("carrier")
    world.network.freeze(world.agents["r1"].transport)  # type: ignore[arg-type]
    newcomer = RealmClient(world.network.join("newcomer"))
    await newcomer.start()
    for realm_client in (world.realm_client, newcomer):
        questions: list[Awaitable[object]] = [
            realm_client.describe("r1"),
            realm_client.call("r1", "move", {"x": 1.0}),
            realm_client.cancel("r1"),
            realm_client.release("r1", "slot"),
            realm_client.delete("r1"),
            realm_client.enslave("carrier", "rover", "r1"),
        ]
        for question in questions:
            with pytest.raises(Hanging, match=r"^the robot 'r1' is in r1, which hangs and .*; thaw r1$"):
                await question
    world.network.thaw(world.agents["r1"].transport)  # type: ignore[arg-type]
    assert (await newcomer.describe("r1")).name == "r1"
    await newcomer.close()


async def test_source_that_raises_names_the_file(world: World) -> None:
    world.source.write_text("import no_such_module")
    with pytest.raises(BrokenSource, match=r"carrier\.py.*no_such_module"):
        await world.create("new", "")


def test_robots_that_command_each_other_are_still_shown() -> None:
    """No such ring can be made, but two descriptions of different moments may look like one."""
    one, other = (Address("robot", name, "1") for name in ("one", "other"))
    ring = [
        RobotDescription(address=me, kinds=("Robot",), slots=(SlotSpec(name="s", kind="Robot", child=it),))
        for me, it in ((one, other), (other, one))
    ]
    assert [robot.name for robot in from_the_top(ring)] == ["one", "other"]
