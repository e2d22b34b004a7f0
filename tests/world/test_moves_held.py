"""Robots that are on their way for long: what their relatives do meanwhile, and what they find.

As in `keeping`: two hosts with journals. One of them stands still when the robot is on its way.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Generator
from contextlib import contextmanager
from typing import Any

import pytest

from robotree.vr.base.errors import CommandCancelled, VrError
from robotree.vr.bundle import Bundle
from robotree.vr.exchange.client import HostClient
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.world import World
from tests.world.keeping import KeepingRealm

PAGE = """
from robotree.vr import Child, VirtualRobot, command, state

class Leaf(VirtualRobot):
    done: list[int] = state([])

    @command(effect="once")
    def act(self, number: int) -> int:
        self.sleep(0.1)
        self.done = [*self.done, number]
        return number

class Tour(VirtualRobot):
    arm = Child("Leaf")

    @command
    def tour(self, steps: int) -> list[int]:
        return [self.arm.act(number=number) for number in range(steps)]

    @command
    def rows(self, rows: int) -> list[list[int]]:
        with self.together() as all_rows:
            for row in range(rows):
                all_rows.start(self._row, row)
        return all_rows.results

    def _row(self, row):
        return [self.arm.act(number=10 * row + number) for number in range(3)]

class Boss(VirtualRobot):
    deputy = Child("Tour")

    @command
    def lead(self, steps: int) -> list[int]:
        return self.deputy.tour(steps=steps)
"""


class HeldRealm(KeepingRealm):
    """Does something when a host comes to a boundary of a move."""

    def __init__(self, world: World) -> None:
        self.at: dict[tuple[str, str], Callable[[], object]] = {}
        """By host and boundary; once."""
        super().__init__(world)
        self.results: dict[str, Any] = {}
        """What came of all that the operator wanted: results and errors."""

    def moment(self, name: str, what: str) -> None:
        super().moment(name, what)
        if (act := self.at.pop((name, what), None)) is not None:
            act()

    @property
    def operator(self) -> RealmClient:
        return self.realm_clients["operator-1"]

    def begin(self, what: str, work: Callable[[], Awaitable[Any]]) -> None:
        """Have the operator want something; what comes of it stands in `results`."""

        async def carry_out() -> None:
            try:
                self.results[what] = await work()
            except VrError as error:
                self.results[what] = error

        self.processes["operator-1"].do(carry_out, what)

    def until(self, happened: Callable[[], bool], within: float = 20.0) -> None:
        """Let time pass until something has happened, which must."""
        runner = self.world.runner
        until = runner.now() + within
        while not happened():
            assert runner.now() < until
            self.world.run(runner.now() + 0.01)

    def do(self, what: str, work: Callable[[], Awaitable[Any]]) -> Any:
        """Have the operator do something, and wait for it."""
        self.begin(what, work)
        self.until(lambda: what in self.results)
        if isinstance(self.results[what], VrError):
            raise self.results[what]
        return self.results[what]

    def call(self, name: str, command: str, **arguments: Any) -> None:
        self.begin(command, lambda: self.operator.call(name, command, arguments, deadline=60.0))

    def move(self, name: str, host: str) -> None:
        self.begin("move", lambda: self.operator.migrate(name, host))

    def make(self, name: str, kind: str, host: str) -> None:
        async def create() -> None:
            address = await self.operator.directory.resolve(host, "host")
            await HostClient(self.operator._transport, address).create(Bundle(PAGE, "/page.py", kind), name)

        self.do(f"create {name}", create)

    def enslave(self, parent: str, slot: str, child: str) -> None:
        self.do(f"enslave {child}", lambda: self.operator.enslave(parent, slot, child))

    def stand_still(self, host: str, seconds: float) -> None:
        """Suspend a host for some time."""
        process = self.processes[host]
        process.pause()
        self.world.runner.at(self.world.runner.now() + seconds, process.resume)

    def where(self, name: str) -> list[str]:
        return [host for host, each in self.hosts.items() if name in each.agents]

    @property
    def done(self) -> list[int]:
        """What the leaf has done."""
        return self.agents()["leaf"].runtime.core.state.fields["done"]


@contextmanager
def realm_of(leaf: str, tour: str = "host-1", *, boss: bool = False) -> Generator[HeldRealm]:
    """Make a realm with a tour over a leaf, at these hosts, and perhaps a boss beside the tour."""
    with World(7) as world:
        realm = HeldRealm(world)
        world.run(1.0)
        realm.make("leaf", "Leaf", leaf)
        realm.make("tour", "Tour", tour)
        realm.enslave("tour", "arm", "leaf")
        if boss:
            realm.make("boss", "Boss", tour)
            realm.enslave("boss", "deputy", "tour")
        yield realm


@pytest.mark.parametrize("leaf", ["host-1", "host-2"])
def test_a_cancel_within_a_host_reaches_a_robot_that_is_on_its_way(leaf: str) -> None:
    """It is put off: if the robot has left, it is sent after it."""
    with realm_of(leaf, boss=True) as realm:
        realm.call("boss", "lead", steps=100)
        realm.until(lambda: len(realm.done) == 3)
        realm.at["host-1", "move out"] = lambda: realm.stand_still("host-2", 1.0)
        realm.move("tour", "host-2")
        deputy = realm.agents()["tour"].runtime
        realm.until(lambda: deputy.in_doubt)
        realm.begin("cancel", lambda: realm.operator.cancel("boss"))
        realm.world.run(realm.world.runner.now() + 0.5)
        assert deputy.is_on_way
        assert deputy.ice is not None
        assert deputy.ice.deferred, "the cancel waits"
        realm.until(lambda: {"lead", "move"} <= realm.results.keys())
        assert isinstance(realm.results["lead"], CommandCancelled)
        realm.until(lambda: realm.where("tour") == ["host-2"])
        tour = realm.agents()["tour"].runtime
        realm.until(lambda: not tour.look(lambda state: state.calls.live))
        done = list(realm.done)
        assert done == list(range(len(done))), "no step is done twice or left out"
        assert len(done) < 30
        realm.call("boss", "lead", steps=2)
        del realm.results["lead"]
        realm.until(lambda: "lead" in realm.results)
        assert realm.results["lead"] == [0, 1]
        assert realm.done == [*done, 0, 1], "and nothing of it goes on"


@pytest.mark.parametrize("mover", ["tour", "leaf"])
@pytest.mark.parametrize("after", [0.0, 0.03, 0.06, 0.09])
def test_a_child_that_waits_for_the_worker_of_its_caller_is_called_once_when_one_of_them_moves(
    mover: str, after: float
) -> None:
    """Three rows want the leaf at once: one carries it out, two wait for their turn to do so."""
    with realm_of("host-1") as realm:
        realm.call("tour", "rows", rows=3)
        realm.until(lambda: len(realm.done) == 2)
        realm.world.run(realm.world.runner.now() + after)
        leaf = realm.agents()["leaf"].runtime
        assert leaf.look(lambda state: len(state.calls.live)) == 3
        realm.at["host-1", "move out"] = lambda: realm.stand_still("host-2", 1.0)
        realm.move(mover, "host-2")
        realm.until(lambda: {"rows", "move"} <= realm.results.keys())
        assert realm.where(mover) == ["host-2"], realm.results["move"]
        assert realm.results["rows"] == [[10 * row + n for n in range(3)] for row in range(3)]
        assert sorted(realm.done) == sorted(number for row in realm.results["rows"] for number in row)


@pytest.mark.parametrize("rivals", [0, 1])
def test_a_parcel_that_was_sent_late_brings_no_lease_that_has_run_out(rivals: int) -> None:
    """Its source was suspended before it sent it: the child has let go, and may be another one's by then."""
    with realm_of("host-2") as realm:
        realm.make("rival", "Tour", "host-2")
        realm.call("tour", "tour", steps=20)
        realm.until(lambda: len(realm.done) == 3)
        realm.at["host-1", "move frozen"] = lambda: realm.stand_still("host-1", 8.0)
        realm.move("tour", "host-2")
        leaf = realm.agents()["leaf"].runtime
        realm.until(lambda: not leaf.look(lambda state: state.lease.current))
        if rivals:
            realm.enslave("rival", "arm", "leaf")
        done = list(realm.done)
        realm.until(lambda: realm.where("tour") == ["host-2"])
        tour = realm.agents()["tour"].runtime
        realm.until(lambda: not tour.look(lambda state: state.slots.bonds()))
        realm.world.run(realm.world.runner.now() + 2.0)
        asked = realm.do("describe", lambda: realm.operator.describe("tour")).asks
        assert "act(number=3) may have been carried out or not" in asked, "it was when the source stood still"
        assert realm.done == done, "nothing was begun under it"
        if rivals:
            realm.do("rival", lambda: realm.operator.call("rival", "tour", {"steps": 2}))
            assert realm.done == [*done, 0, 1]
