"""Hosts: robots made of source while everything runs, what cannot be made, and pages that are edited."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from robotree.vr.agents.host import Host
from robotree.vr.base.errors import (
    BadArgument,
    BadName,
    BrokenSource,
    CommandCancelled,
    DuplicateName,
    NoSuchCommand,
    NoVirtualRobot,
    OtherKind,
    ReloadWaits,
    SeveralVirtualRobots,
    SlotHeld,
    Unreachable,
    VrError,
)
from robotree.vr.base.requests import DescribeView, ViewDescribed
from robotree.vr.bundle import Bundle
from robotree.vr.bundle.loader import LIMIT
from robotree.vr.exchange.asking import ask
from robotree.vr.exchange.client import HostClient, RobotClient
from robotree.vr.lookup.directory import Directory
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.lookup.service import LookupService
from robotree.vr.running import frame
from robotree.vr.world.network import MemoryNetwork
from robotree.vr.world.testing import until
from tests.vr.core.conftest import REAL_GRACE

HEADER = "import time\nfrom robotree.vr import VirtualRobot, command\n"
ADDER = f"""{HEADER}
class Adder(VirtualRobot):
    '''Adds.'''

    @command(effect="read")
    def add(self, a: float, b: float) -> float:
        return a + b
"""
BLOCKER = f"""{HEADER}
class Blocker(VirtualRobot):
    @command
    def block(self) -> None:
        while True:
            pass
"""


class Realm:
    def __init__(self) -> None:
        self.network = MemoryNetwork()
        self.operator = self.network.join("operator")
        self.directory = Directory(self.operator)
        self.lookup = LookupService(self.network.join("lookup"), "lookup-1")
        self.hosts: list[Host] = []

    async def open(self, *hosts: str) -> None:
        await asyncio.gather(self.lookup.start(), *(self.add(name) for name in hosts))
        await self.directory.start()

    async def add(self, name: str, limit: float = LIMIT) -> Host:
        transport = self.network.join(name)
        host = Host(transport, name, registrar=Registrar(transport), limit=limit)
        self.hosts.append(host)
        await host.start()
        return host

    def client(self, number: int = 0) -> HostClient:
        return HostClient(self.operator, self.hosts[number].address)

    @property
    def names(self) -> list[str]:
        return [listing.name for listing in self.directory.listings]


@pytest.fixture
async def realm() -> AsyncIterator[Realm]:
    realm = Realm()
    await realm.open("host-1", "host-2")
    yield realm
    for host in realm.hosts:
        await host.close()
    await realm.directory.close()
    await realm.lookup.close()
    for transport in list(realm.network.members):
        await transport.close()


async def test_a_robot_made_of_a_file_can_be_called_and_is_listed(realm: Realm, tmp_path: Path) -> None:
    path = tmp_path / "adder.py"
    path.write_text(ADDER)
    bundle = Bundle.read(path)
    path.unlink()  # it is read where its author is
    made = await realm.client().create(bundle, "sum")
    assert (made.name, made.kind, made.host, made.doc) == ("sum", "Adder", "host-1", "Adds.")
    assert await RobotClient(realm.operator, made.address).call("add", {"a": 1.0, "b": 2.0}) == 3.0
    await until(lambda: realm.names == ["sum"], "it is listed")
    assert (await realm.client().describe()).robots == (made.address,)
    assert (await realm.client(1).describe()).robots == ()


async def test_a_deleted_robot_is_gone_and_its_name_is_free(realm: Realm) -> None:
    first = await realm.client().create(Bundle(ADDER, "adder.py"), "sum")
    robot = RobotClient(realm.operator, first.address)
    await robot.delete()
    second = await realm.client(1).create(Bundle(ADDER, "adder.py"), "sum")
    assert second.address != first.address
    with pytest.raises(Unreachable):
        await robot.describe()
    assert (await realm.client().describe()).robots == ()


async def test_two_hosts_have_no_name_in_common(realm: Realm) -> None:
    with pytest.raises(DuplicateName, match="a host named 'host-1'"):
        await realm.add("host-1")


async def test_a_name_whose_robot_is_just_ending_is_waited_for(realm: Realm) -> None:
    first = await realm.client().create(Bundle(ADDER, "adder.py"), "sum")
    deleting = asyncio.create_task(RobotClient(realm.operator, first.address).delete())
    second = await realm.client().create(Bundle(ADDER, "adder.py"), "sum")
    await deleting
    assert second.address != first.address


@pytest.mark.parametrize("hosts", [(0, 0), (0, 1)])
async def test_of_two_made_at_once_under_one_name_one_stays(realm: Realm, hosts: tuple[int, int]) -> None:
    making = [realm.client(number).create(Bundle(ADDER, "adder.py"), "sum") for number in hosts]
    results = await asyncio.gather(*making, return_exceptions=True)
    assert [type(result) for result in results].count(DuplicateName) == 1
    assert len(realm.operator.presence.keys("robot/sum/*")) == 1
    await until(lambda: realm.names == ["sum"], "the one that stays is listed")


@pytest.mark.parametrize(
    ("source", "error", "sentence"),
    [
        ("", NoVirtualRobot, "defines no virtual robot; it needs a class"),
        ("def (", BrokenSource, "bad.py cannot be loaded"),
        ("1 / 0", BrokenSource, "division by zero"),
        ("raise SystemExit", BrokenSource, "bad.py cannot be loaded"),
        (f"{ADDER}\n{BLOCKER}", SeveralVirtualRobots, "Adder, Blocker"),
        (f"{ADDER}\n    def __init__(self, name): raise OSError('no')", BrokenSource, "OSError"),
    ],
)
async def test_source_that_cannot_be_used_is_refused_in_one_sentence(
    realm: Realm, source: str, error: type[VrError], sentence: str
) -> None:
    with pytest.raises(error, match=sentence):
        await realm.client().create(Bundle(source, "bad.py"), "sum")
    made = await realm.client().create(Bundle(ADDER, "adder.py"), "sum")
    assert made.name == "sum", "the host goes on, and the name is free"


async def test_the_class_wanted_is_taken(realm: Realm) -> None:
    bundle = Bundle(f"{ADDER}\n{BLOCKER}", "two.py", "Blocker")
    assert (await realm.client().create(bundle, "b")).kind == "Blocker"
    with pytest.raises(NoVirtualRobot, match="no virtual robot named 'Other'"):
        await realm.client().create(Bundle(ADDER, "adder.py", "Other"), "o")


async def test_names_that_break_addresses_are_refused(realm: Realm) -> None:
    for name in ("", "a/b", "*", "a" * 65):
        with pytest.raises(BadName):
            await realm.client().create(Bundle(ADDER, "adder.py"), name)
    with pytest.raises(BadName):
        Host(realm.operator, "a b")


async def test_source_that_never_ends_delays_nobody_else(realm: Realm) -> None:
    await realm.add("brief", limit=2.0)
    host = realm.client(-1)
    endless = asyncio.ensure_future(host.create(Bundle("while True: pass", "endless.py"), "never"))
    await host.create(Bundle(ADDER, "adder.py"), "sum")
    assert not endless.done(), "it waited for nobody"
    with pytest.raises(BrokenSource, match=r"endless\.py cannot be loaded"):
        await endless


async def test_a_robot_that_blocks_does_not_stop_its_neighbours(realm: Realm) -> None:
    blocker = await realm.client().create(Bundle(BLOCKER, "blocker.py"), "blocker")
    adder = await realm.client().create(Bundle(ADDER, "adder.py"), "sum")
    blocking = RobotClient(realm.operator, blocker.address)
    await blocking.tell("block", {})
    assert await RobotClient(realm.operator, adder.address).call("add", {"a": 1.0, "b": 2.0}) == 3.0
    assert (await blocking.describe()).busy, "it waited for nobody"
    await blocking.cancel()
    while (await blocking.describe()).busy:  # noqa: ASYNC110 # what is asked is the law
        await asyncio.sleep(0.01)


DEFIER = f"""{HEADER}
import contextlib, threading
class Defier(VirtualRobot):
    @command
    def defy(self) -> None:
        while not threading.current_thread().name.startswith("let go"):
            with contextlib.suppress(BaseException):
                while not threading.current_thread().name.startswith("let go"):
                    with contextlib.suppress(BaseException):
                        time.sleep(0.02)
"""


async def test_what_a_deleted_robot_leaves_running_is_told_by_its_host(
    realm: Realm, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(frame, "GRACE", REAL_GRACE)
    defier = RobotClient(
        realm.operator, (await realm.client().create(Bundle(DEFIER, "d.py"), "defier")).address
    )
    await defier.tell("defy", {})
    assert await defier.delete() == "its defy ignores every cancel and still runs; restart host host-1"
    described = await realm.client().describe()
    assert (described.robots, described.abandoned) == ((), ("defier.defy",))
    assert (await realm.client(1).describe()).abandoned == ()
    again = await realm.client().create(Bundle(DEFIER, "d.py"), "defier")
    assert again.abandoned == (), "another robot of this name has nothing to do with it"
    for thread in threading.enumerate():
        if thread.name == "defier.defy":
            thread.name = "let go"
    await until(lambda: realm.hosts[0].description().abandoned == (), "it has ended after all")


async def test_a_host_that_ends_takes_its_robots_along_and_no_others(realm: Realm) -> None:
    await realm.client(0).create(Bundle(ADDER, "adder.py"), "one")
    await realm.client(1).create(Bundle(ADDER, "adder.py"), "two")
    await until(lambda: realm.names == ["one", "two"], "both are listed")
    await realm.hosts[0].close()
    await realm.hosts[0].close()
    await until(lambda: realm.names == ["two"], "its robot has left")
    assert not realm.hosts[0].agents
    with pytest.raises(Unreachable):
        await realm.client(0).describe()


async def test_a_host_answers_no_other_questions(realm: Realm) -> None:
    with pytest.raises(VrError, match="a host does not answer DescribeView"):
        await ask(realm.operator, realm.hosts[0].address.key, DescribeView(), ViewDescribed, timeout=5)
    made = await realm.client().create(Bundle(ADDER, "adder.py"), "sum")
    with pytest.raises(NoSuchCommand):
        await RobotClient(realm.operator, made.address).call("multiply", {})


TEAM = """
from typing import Annotated
from robotree.vr import Range, Unit, VirtualRobot, command

class Team(VirtualRobot):
    speed: Annotated[float, Unit("m/s"), Range(0.01, 0.3)] = 0.1

    def __init__(self, name):
        self.initial = self.speed
        super().__init__(name)

    @command(effect="read")
    def look(self) -> float:
        return self.initial
"""


async def test_a_robot_is_made_with_settings_which_its_constructor_reads(realm: Realm) -> None:
    made = await realm.client().create(Bundle(TEAM, "team.py"), "team", {"speed": "20 cm/s"})
    spec = made.command("set")
    assert spec is not None
    assert spec.parameters[0].default == 0.2
    assert await RobotClient(realm.operator, made.address).call("look", {}) == 0.2


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"speed": 3}, "team.create: speed: 3 m/s is out of range; give a number in m/s from 0.01 to 0.3"),
        ({"sped": 0.1}, "team.create: sped: there is no such parameter; it takes speed"),
    ],
)
async def test_a_setting_that_cannot_be_meant_makes_no_robot(
    realm: Realm, given: dict[str, float], says: str
) -> None:
    with pytest.raises(BadArgument) as refused:
        await realm.client().create(Bundle(TEAM, "team.py"), "team", given)
    assert str(refused.value) == says
    assert realm.hosts[0].agents == {}


# -- an author edits a page: the robot goes on with it, and nothing of what it is to the others changes ---


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
    """A team that commands a rover, on the first of two hosts."""

    def __init__(self, realm: Realm) -> None:
        self.realm, self.host, self.client = realm, realm.hosts[0], realm.client()

    async def begin(self) -> None:
        rover = await self.client.create(Bundle(ROVER, "rover.py"), "rover-1")
        team = await self.client.create(Bundle(PAGE, "team.py"), "team", {"speed": 0.5})
        self.team = RobotClient(self.realm.operator, team.address)
        await self.team.enslave("rover", rover.address)

    async def reload(self, source: str, *, now: bool = False, within: float = 5.0) -> tuple[str, ...]:
        bundle = Bundle(source, "team.py")
        return (await self.client.reload(bundle, "team", now=now, within=within)).notes

    async def until(self, *, running: int = 0, waiting: int = 0) -> None:
        """Wait until so many commands of the team run and wait."""
        core = self.host.agents["team"].runtime.core
        await until(lambda: len(core.state.calls.running) >= running, "they run")
        await until(lambda: len(core.state.calls.waiting) >= waiting, "they wait")


@pytest.fixture
async def stage(realm: Realm) -> Stage:
    stage = Stage(realm)
    await stage.begin()
    return stage


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
    first = asyncio.ensure_future(stage.team.call("wait", {"seconds": 1.0}))
    await stage.until(running=1)
    waiting = asyncio.ensure_future(stage.team.call("pick", {}))
    await stage.until(running=1, waiting=1)
    await stage.reload((RENAMED + THAW).replace('"first"', '"second"'))
    assert (await first, await waiting) == ("first", "second")
    assert (await stage.team.describe()).kept == {"done": ["x"]}, "its state is that of the boundary"


async def test_a_reload_that_waits_too_long_says_so_and_the_old_page_goes_on(stage: Stage) -> None:
    running = asyncio.ensure_future(stage.team.call("wait", {"seconds": 0.5}))
    await stage.until(running=1)
    with pytest.raises(ReloadWaits, match=r"team\.wait has not ended within 0\.05 s, so the old page"):
        await stage.reload(SECOND, within=0.05)
    assert await running == "first"
    assert await stage.team.call("pick", {}) == "first"


async def test_a_reload_at_once_cancels_what_runs(stage: Stage) -> None:
    running = asyncio.ensure_future(stage.team.call("wait", {"seconds": 60.0}))
    await stage.until(running=1)
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
    first = asyncio.ensure_future(stage.team.call("wait", {"seconds": 1.0}))
    await stage.until(running=1)
    gone = asyncio.ensure_future(stage.team.call("pick", {}))
    await stage.until(running=1, waiting=1)
    other = asyncio.ensure_future(stage.team.call("wait", {"seconds": 0.0}))
    await stage.until(running=1, waiting=2)
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
