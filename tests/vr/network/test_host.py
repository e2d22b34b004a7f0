"""Hosts: robots made of source while everything runs, and what cannot be made."""

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
    DuplicateName,
    NoSuchCommand,
    NoVirtualRobot,
    SeveralVirtualRobots,
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
