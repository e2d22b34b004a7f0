"""The realm client as a supervisor sees it: everything by name, and every failure a sentence."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from robotree.vr.agents.view import ViewAgent
from robotree.vr.base.address import Address
from robotree.vr.base.description import RobotDescription, SlotSpec
from robotree.vr.base.envelope import sitting_at
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
    NotConfirmed,
    NotInControl,
    NotVirtual,
    SlotEmpty,
    StillBonded,
    Stopped,
    VrError,
    WrongKind,
)
from robotree.vr.base.presence import Held, Presence
from robotree.vr.base.requests import LoggedLine, Remembered, State
from robotree.vr.base.transport import Incoming
from robotree.vr.lookup.chronicle import APART, Chronicle, merged, site_told
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.supervision.realm_client import RealmClient, from_the_top
from robotree.vr.supervision.stop import CONFIRM
from robotree.vr.world.testing import until
from tests.vr.supervision.conftest import Rover, Window, World


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


# -- which robots stops and resumes reach, and what is said of the others --------------------------


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


# -- lookup services remember who came, left, died and hung; hosts the logs of their ended robots --


HOST, ARM = "host/host-1/1", "robot/arm-1/2"


class Watched:
    """A chronicle, with what the system would say of the process of every agent."""

    def __init__(self) -> None:
        self.hang: set[str] = set()
        self.live = {HOST, ARM}
        self.presence = Presence(held=self._held, unheard=self._unheard)
        self.chronicle = Chronicle(self.presence, lambda: 1000.0)

    def _held(self, pattern: str) -> list[Held]:
        return [Held(pattern, "process 7", "")]

    def _unheard(self, pattern: str) -> list[tuple[Held, bool]]:
        return [(Held(one, "process 7", ""), True) for one in self.hang if one == pattern]

    @property
    def texts(self) -> list[str]:
        return [line.line.text for line in self.chronicle.lines]


def test_a_death_and_a_hang_are_told_apart_with_the_process() -> None:
    watched = Watched()
    watched.chronicle.seen(HOST, there=True)
    watched.chronicle.seen(HOST, there=False)
    watched.chronicle.seen(ARM, there=True)
    watched.hang = {ARM}
    watched.chronicle.seen(ARM, there=False)
    watched.hang = set()
    watched.chronicle.seen(ARM, there=True)
    assert watched.texts == [
        "host-1 (host, process 7) has come",
        "host-1 (host, process 7) has died: its process has gone",
        "arm-1 (robot, process 7) has come",
        "arm-1 (robot, process 7) hangs and does not answer",
        "arm-1 (robot, process 7) answers again",
    ]
    assert [line.line.level for line in watched.chronicle.lines] == ["info", "error", "info", "error", "info"]


def test_an_agent_that_ends_while_it_hangs_has_died() -> None:
    watched = Watched()
    watched.chronicle.seen(ARM, there=True)
    watched.hang = {ARM}
    watched.chronicle.seen(ARM, there=False)
    watched.chronicle.look()
    assert watched.texts[-1].endswith("hangs and does not answer")
    watched.hang = set()
    watched.chronicle.look()
    watched.chronicle.look()
    assert watched.texts[2:] == ["arm-1 (robot, process 7) has died: its process has gone"]


def test_what_two_services_saw_is_one_line_and_what_a_robot_said_twice_is_two() -> None:
    def seen(unix: float, text: str = "arm-1 has died", key: str = ARM, command: str = "") -> Remembered:
        return Remembered("arm-1", LoggedLine(1, unix, "error", text, command, key))

    here, there, again = seen(5.0), seen(5.4), seen(5.4 + APART)
    assert merged([there, again, here]) == [here, again]
    said = [seen(1.0, "go_to is done", "k1", "go_to"), seen(1.0, "go_to is done", "k1", "go_to")]
    assert merged(said) == said


def test_what_another_site_saw_of_an_agent_counts_less_than_what_was_told_where_it_is() -> None:
    def seen(unix: float, text: str) -> Remembered:
        return Remembered("arm-1", LoggedLine(1, unix, "info", text, "", ARM))

    died = seen(5.0, "arm-1 (robot, site hall, process 7) has died: its process has gone")
    gone = seen(5.3, "arm-1 (robot, site hall) is not seen any more")
    cut = seen(5.3 + 2 * APART, "arm-1 (robot, site hall) is not seen any more")
    assert merged([gone, cut, died]) == [died, cut]
    watched = Watched()
    for key in ("gateway/lab/3", "site/hall", f"at/hall/{ARM}"):
        watched.presence.count(key, there=True)
    for key in (HOST, ARM):
        watched.chronicle.seen(key, there=True)
    watched.chronicle.seen(ARM, there=False)
    assert watched.texts == [
        "host-1 (host, site lab, process 7) has come",
        "arm-1 (robot, site hall) has come",
        "arm-1 (robot, site hall) is not seen any more",
    ]
    assert [site_told(line.line) for line in watched.chronicle.lines] == ["lab", "hall", "hall"]


async def test_the_realm_remembers_by_whom_a_robot_was_created_stopped_and_deleted(world: World) -> None:
    with sitting_at("pts/3"):
        await world.create("carrier")
        await world.realm_client.stop(None)
        await world.realm_client.resume(None)
        await world.realm_client.delete("carrier")
        with pytest.raises(NotVirtual):
            await world.realm_client.delete("r1")
    logged = [line.text for line in world.agents["r1"].runtime.log.since(0)]
    assert not [text for text in logged if "deleted" in text], "a refusal is no deletion"
    await until(lambda: not world.host.agents, "it has ended")
    history = [one.line for one in await world.realm_client.read_history() if one.name == "carrier"]
    texts = [line.text for line in history]
    assert any(text.startswith("carrier (robot") and text.endswith(") has come") for text in texts)
    assert any("created from" in text and text.endswith("@pts/3") for text in texts)
    stops = [text for text in texts if text.startswith("stopped: ")]
    assert len(stops) == 1, "two ways to a robot are one stop"
    assert stops[0].endswith("@pts/3's protective stop")
    assert any(text.startswith("resumed by") and text.endswith("@pts/3") for text in texts)
    assert any(text.startswith("deleted by") and text.endswith("@pts/3") for text in texts)
    assert any(text.endswith(") has left") for text in texts)
    assert all(line.unix > 0 for line in history)
