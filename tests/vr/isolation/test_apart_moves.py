"""Robots in processes of their own move between hosts, and take orders: their processes are real ones."""

from __future__ import annotations

import asyncio
import contextlib
import os
import shutil
import signal
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any

import pytest

from robotree.vr.base.address import everyone
from robotree.vr.base.errors import CannotMove, CommandCancelled, VrError
from robotree.vr.base.permissions import Isolation
from robotree.vr.base.requests import Done, LeaveOrder, Migrate, OrderLeft
from robotree.vr.bundle import Bundle
from robotree.vr.exchange.asking import ask
from robotree.vr.exchange.client import HostClient, RobotClient
from robotree.vr.isolation import pipe
from robotree.vr.journal.kept import leave_stop
from robotree.vr.network.local import LocalTransport, join
from robotree.vr.orders.service import DirectoryService
from robotree.vr.orders.store import OrderStore
from tests.vr.isolation.test_apart import Place, robot_of
from tests.waiting import PATIENCE, until

PAGE = """
import os

from robotree.vr import Child, VirtualRobot, command, state


class Leaf(VirtualRobot):
    done: list[int] = state([])

    @command(effect="once")
    def act(self, number: int) -> int:
        self.sleep(0.02)
        self.done = [*self.done, number]
        return number

    @command(offline="queue")
    def count(self, number: int) -> int:
        self.done = [*self.done, number]
        return os.getpid()


class Tour(VirtualRobot):
    arm = Child("Leaf")
    count: int = state(0)

    @command
    def tour(self, steps: int) -> list[int]:
        found = []
        for number in range(steps):
            found.append(self.arm.act(number=number))
            self.count = self.count + 1
        return found

    @command
    def go(self, host: str) -> int:
        self.move_to(host)
        return os.getpid()

    @command
    def tie(self) -> None:
        self.file = open(os.devnull)
"""
STEPS = 60


class Realm:
    """Hosts in the process of the test."""

    operator: LocalTransport

    def __init__(self, folder: Path, root: Path) -> None:
        self.folder, self.root, self.hosts = folder, root, dict[str, Place]()

    async def start(self, *names: str) -> None:
        for name in names:
            self.hosts[name] = here = Place(self.folder, self.root, name)
            await here.start()

    async def create(self, kind: str, name: str, host: str, level: Isolation) -> None:
        client = HostClient(self.operator, self.hosts[host].host.address)
        await client.create(Bundle(PAGE, "tour.py", kind), name, None, level)
        await until(lambda: bool(self.operator.presence.keys(everyone("robot", name))))

    def robot(self, name: str) -> RobotClient:
        return robot_of(self.operator, name)

    async def migrate(self, name: str, source: str, target: str) -> None:
        key = self.hosts[source].host.address.key
        request = Migrate(robot=name, host=target)
        await ask(self.operator, key, request, Done, timeout=PATIENCE)

    def where(self, name: str) -> list[str]:
        """Return the hosts that have a robot."""
        return [
            host
            for host, place in self.hosts.items()
            if name in {robot.name for robot in place.host.description().robots}
        ]

    async def acts(self) -> list[int]:
        found: list[int] = (await self.robot("leaf").describe()).kept["done"]
        return found


@pytest.fixture
async def realm(tmp_path: Path, place: Path) -> AsyncIterator[Realm]:
    here = Realm(tmp_path, place / "robotree")
    here.operator = await join("test", root=here.root)
    yield here
    await here.operator.close()
    for host in here.hosts.values():
        await host.end()


async def touring(realm: Realm, level: Isolation = "process") -> asyncio.Future[Any]:
    """Have a tour begin in h1, over a leaf in h2 that is apart, too."""
    await realm.start("h1", "h2")
    await realm.create("Leaf", "leaf", "h2", "process")
    await realm.create("Tour", "tour", "h1", level)
    await realm.robot("tour").enslave("arm", realm.robot("leaf").address)
    call = asyncio.ensure_future(realm.robot("tour").call("tour", {"steps": STEPS}, deadline=3 * PATIENCE))
    await acted(realm, 3)
    return call


async def acted(realm: Realm, count: int) -> None:
    """Wait until the leaf has done so much."""
    async with asyncio.timeout(PATIENCE):
        while len(await realm.acts()) < count:  # noqa: ASYNC110 # it is asked, and does not tell
            await asyncio.sleep(0.01)


@pytest.mark.parametrize("level", ["process", "none"])
async def test_a_command_goes_on_in_the_other_host_and_back(realm: Realm, level: Isolation) -> None:
    call = await touring(realm, level)
    before, page = realm.robot("tour").address, realm.folder / "h1" / "apart"
    for host in realm.hosts.values():  # who came without a wish runs as its new host has it
        host.host.isolate = "process"
    await realm.migrate("tour", "h1", "h2")
    assert realm.where("tour") == ["h2"]
    assert not list(page.glob("*")), "nothing of it is left where it was"
    await acted(realm, 20)
    await realm.migrate("tour", "h2", "h1")
    assert await call == list(range(STEPS))
    assert await realm.acts() == list(range(STEPS))
    assert realm.robot("tour").address == before
    assert realm.where("tour") == ["h1"]
    assert realm.hosts["h1"].host.agents == {}, "it is in a process of its own"
    tour = realm.hosts["h1"].host.apart
    assert tour is not None
    assert [kept.children for kept in tour.kept()] == [("leaf",)], "it may command whom it could before"


async def test_one_that_nobody_keeps_apart_comes_back_into_the_process_of_a_host(realm: Realm) -> None:
    await realm.start("h1", "h2")
    realm.hosts["h1"].host.isolate = "process"
    await realm.create("Tour", "tour", "h1", "none")
    assert not realm.hosts["h1"].host.agents, "a host that keeps its robots apart runs none itself"
    await realm.migrate("tour", "h1", "h2")
    assert list(realm.hosts["h2"].host.agents) == ["tour"]
    await realm.create("Tour", "other", "h1", "process")
    await realm.migrate("other", "h1", "h2")
    assert list(realm.hosts["h2"].host.agents) == ["tour"], "its author wants it apart, wherever it is"
    assert realm.where("other") == ["h2"]


async def test_a_robot_apart_moves_itself(realm: Realm) -> None:
    await realm.start("h1", "h2")
    await realm.create("Tour", "tour", "h1", "process")
    first = realm.hosts["h1"].pid("tour")
    assert await realm.robot("tour").call("go", {"host": "h2"}) == realm.hosts["h2"].pid("tour") != first
    await until(lambda: realm.where("tour") == ["h2"])
    with pytest.raises(VrError, match="nowhere"):
        await realm.robot("tour").call("go", {"host": "nowhere"})


async def test_what_cannot_travel_is_named_and_it_stays(realm: Realm) -> None:
    await realm.start("h1", "h2")
    await realm.create("Tour", "tour", "h1", "process")
    await realm.robot("tour").call("tie", {})
    with pytest.raises(CannotMove, match=r"self\.file is an open file"):
        await realm.migrate("tour", "h1", "h2")
    assert realm.where("tour") == ["h1"]
    assert not list((realm.folder / "h2" / "apart").glob("*.page"))


async def test_robots_apart_leave_their_host_with_the_others(realm: Realm) -> None:
    await realm.start("h1", "h2")
    await realm.create("Tour", "tour", "h1", "process")
    await realm.create("Tour", "own", "h1", "none")
    done = await realm.hosts["h1"].host.moves.drain(lambda _: None)
    assert sorted(done.confirmed) == ["own", "tour"]
    assert (realm.where("tour"), realm.where("own")) == (["h2"], ["h2"])


@pytest.mark.parametrize(
    ("boundary", "killed"), [("out", "h1"), ("answered", "h1"), ("ready", "h2"), ("logged", "h2")]
)
async def test_its_process_or_the_one_that_waits_for_it_is_killed_at_a_boundary_of_the_move(
    realm: Realm, monkeypatch: pytest.MonkeyPatch, boundary: str, killed: str
) -> None:
    call = await touring(realm)
    struck: list[str] = []

    def strike(place: str) -> None:
        if place == boundary and not struck:
            struck.append(place)
            os.kill(realm.hosts[killed].pid("tour"), signal.SIGKILL)

    monkeypatch.setattr(realm.hosts[killed].host.moves, "moment", strike)
    with contextlib.suppress(CannotMove):
        await realm.migrate("tour", "h1", "h2")
    assert await call == list(range(STEPS))
    assert await realm.acts() == list(range(STEPS))
    assert struck == [boundary]
    await until(lambda: len(realm.where("tour")) == 1)


async def test_a_stop_that_was_left_holds_a_robot_that_has_come_and_not_begun(
    realm: Realm, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Its host ends before its process has the parcel, as a copy of its disk shows."""
    call = await touring(realm)

    def copy(place: str) -> None:
        if place == "logged":
            shutil.copytree(tmp_path / "h2", tmp_path / "kept" / "h2")

    monkeypatch.setattr(realm.hosts["h2"].host.moves, "moment", copy)
    await realm.migrate("tour", "h1", "h2")
    assert await call == list(range(STEPS))
    assert leave_stop(tmp_path / "kept" / "h2" / "apart" / "tour", [], "halt") == ("tour",)
    elsewhere = Realm(tmp_path / "kept", tmp_path / "elsewhere")
    elsewhere.operator = await join("test", root=elsewhere.root)
    await elsewhere.start("h2")
    tour = elsewhere.robot("tour")
    assert (await tour.describe()).stop_reason == "halt, while its host was away"
    with pytest.raises(VrError, match="halt"):
        await tour.call("tour", {"steps": 1})
    await elsewhere.operator.close()
    await elsewhere.hosts["h2"].end()


@pytest.fixture
def store(tmp_path: Path) -> Iterator[OrderStore]:
    with contextlib.closing(OrderStore(tmp_path / "orders.db")) as store:
        yield store


@pytest.fixture
async def directory(realm: Realm, store: OrderStore) -> AsyncIterator[DirectoryService]:
    keeper = await join("test", root=realm.root)
    service = DirectoryService(keeper, "memory", store)
    await service.start()
    yield service
    await service.close()
    await keeper.close()


async def test_a_robot_apart_takes_an_order_once_wherever_it_is(
    realm: Realm, directory: DirectoryService, store: OrderStore
) -> None:
    await realm.start("h1", "h2")

    async def ordered(number: int) -> int:
        """Leave an order; returns in which process it was carried out."""
        left = await ask(
            realm.operator,
            directory.address.key,
            LeaveOrder(
                key=f"0123456789abcde{number}",
                robot="leaf",
                command="count",
                arguments={"number": number},
                begin_within=600.0,
                may_take=PATIENCE,
            ),
            OrderLeft,
            timeout=PATIENCE,
        )
        await until(lambda: store.orders[left.order.key].over)
        order = store.orders[left.order.key]
        assert order.state == "done", order
        return int(order.value)

    await realm.create("Leaf", "leaf", "h1", "process")
    await until(lambda: any(known.name == "leaf" for known in store.agents.values()))
    assert await ordered(1) == realm.hosts["h1"].pid("leaf")
    await realm.migrate("leaf", "h1", "h2")
    assert await ordered(2) == realm.hosts["h2"].pid("leaf")
    os.kill(realm.hosts["h2"].pid("leaf"), signal.SIGKILL)
    await until(lambda: realm.hosts["h2"].pid("leaf") > 0)
    await ordered(3)
    assert await realm.acts() == [1, 2, 3]


@pytest.mark.usefixtures("directory")
async def test_one_that_sends_what_cannot_be_used_is_ended_and_not_awaited_by_the_directories(
    realm: Realm, store: OrderStore
) -> None:
    await realm.start("h1")
    await realm.create("Leaf", "leaf", "h1", "process")
    await until(lambda: any(known.name == "leaf" for known in store.agents.values()))
    apart = realm.hosts["h1"].host.apart
    assert apart is not None
    robot = apart.robots["leaf"]
    robot._takers[pipe.Alive] = lambda _: robot._be_up(pipe.Up(b"\xff", "x"))  # pyright: ignore[reportPrivateUsage]
    await until(lambda: all(known.deleted for known in store.agents.values()))
    assert realm.where("leaf") == []


async def test_one_that_is_placed_moves_beside_the_one_that_it_calls_and_says_why(
    realm: Realm, monkeypatch: pytest.MonkeyPatch
) -> None:
    await realm.start("h1", "h2")
    await realm.create("Leaf", "leaf", "h2", "none")
    await realm.create("Tour", "tour", "h1", "process")
    tour, leaf = realm.robot("tour"), realm.robot("leaf")
    await tour.enslave("arm", leaf.address)
    for name, way in {"h1": 0.2, "h2": 0.001}.items():
        host = realm.hosts[name].host
        host.finds_places(used=lambda: 0.0)
        assert host.placing is not None
        hosts = {each.host.address.key: 0.2 for each in realm.hosts.values()}
        measured = {leaf.address.key: way, **hosts}

        async def measure(_keys: object, found: dict[str, float] = measured) -> dict[str, float]:
            return found

        monkeypatch.setattr(host.placing, "measured", measure)  # as over a slow line
    calling = asyncio.ensure_future(tour.call("tour", {"steps": 100 * STEPS}, deadline=PATIENCE))
    await tour.place("advise")
    async with asyncio.timeout(PATIENCE):
        while (await tour.describe()).advised != "h2":  # noqa: ASYNC110 # another process
            await asyncio.sleep(0.1)
    assert realm.where("tour") == ["h1"]
    await tour.place("auto")
    await until(lambda: realm.where("tour") == ["h2"])
    shown = await tour.describe()
    assert shown.placed.startswith("h2 is nearer than h1: its ")
    assert shown.isolation == "process"
    done = len(await realm.acts())
    await acted(realm, done + 3)  # it goes on there
    await tour.cancel()
    with pytest.raises(CommandCancelled):
        await calling
    acts = realm.hosts["h2"].host.agents["leaf"].runtime.look(lambda state: state.fields["done"])
    assert len(acts) >= done + 3
    assert acts == list(range(len(acts))), "nothing is done twice, nothing is left out"
