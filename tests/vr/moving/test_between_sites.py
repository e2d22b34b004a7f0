"""Robots that move between hosts of two sites: real meshes, gateways, threads and journals, in one process.

Both sites have a host of the same name, and so a log of the same name: only that of the destination knows.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from robotree.vr.agents.host import Host
from robotree.vr.agents.moving import ANSWERED_WITHIN
from robotree.vr.agents.run import kept_by
from robotree.vr.base.address import Address
from robotree.vr.base.errors import CannotMove, Denied, NotSigned, OldParent, UnknownSigner, VrError
from robotree.vr.base.places import Places
from robotree.vr.base.principal import ITSELF, Principal
from robotree.vr.base.requests import DescribeHost, Done, HostDescribed, Migrate, PrepareMove, TakeRobot
from robotree.vr.bundle import Bundle
from robotree.vr.bundle.admission import Gate
from robotree.vr.bundle.build import signed as signed_page
from robotree.vr.core.bonds import GrantedLease, Slots
from robotree.vr.core.machine import AcceptedCall, Calls, RobotState
from robotree.vr.core.stop import Stop
from robotree.vr.exchange.asking import ask
from robotree.vr.exchange.client import HostClient, RobotClient
from robotree.vr.journal.journal import HostJournal
from robotree.vr.journal.recovery import see_from
from robotree.vr.network.local import LocalTransport, join
from robotree.vr.network.policy_file import PolicyFile
from robotree.vr.running.process import Process
from robotree.vr.running.runner import Threads
from tests.vr.bundle.signed import key_of
from tests.vr.moving.conftest import HEADER
from tests.vr.moving.test_moves import LEAF, TOUR
from tests.vr.policy.test_enforced import rule, text
from tests.vr.sites.site import MemoryHub, SiteOfTest, hub, sites
from tests.waiting import PATIENCE, until

__all__ = ["hub", "sites"]

pytestmark = pytest.mark.real_threads

ANNA = key_of("anna")
COUNTER = """
class Counter(VirtualRobot):
    done: list[int] = state([])

    @command
    def count_to(self, number: int) -> list[int]:
        for n in range(number):
            self.sleep(0.02)
            self.done = [*self.done, n]
        return self.done
"""


class Home:
    """A host of one site."""

    def __init__(self, site: SiteOfTest, folder: Path, name: str) -> None:
        self.site, self.folder, self.name = site, folder / f"{site.keys.name}-logs" / name, name

    async def open(self) -> None:
        runner = Threads()
        self.folder.parent.mkdir(exist_ok=True)
        self.member = await join("test", root=self.site.place)
        self.member.gate = PolicyFile(self.site.keys.folder.parent)
        self.journal = HostJournal(self.folder, runner)
        process: Process[Any] = Process(runner, self.journal)
        transport = kept_by(self.journal, process, self.member)
        keys = {ANNA.key.public_key().public_bytes_raw()}
        gate = Gate(own_keys=lambda: keys)
        self.host = Host(transport, self.name, process=process, journal=self.journal, gate=gate)
        await self.host.start()
        await self.host.restore()

    async def close(self) -> None:
        await self.host.close()
        self.journal.close()
        await self.member.close()

    async def create(self, name: str, page: str, *, signed: bool = True) -> RobotClient:
        bundle = Bundle(HEADER + page, f"{name}.py")
        if signed:
            bundle = signed_page(bundle, ANNA)
        made = await HostClient(self.site.member, self.host.address).create(bundle, name)
        return RobotClient(self.site.member, made.address)

    async def migrate(self, robot: str, host: str) -> str:
        """Have a robot move, as somebody at its site asks for it."""
        request = Migrate(robot=robot, host=host)
        key = self.host.address.key
        return (await ask(self.site.member, key, request, Done, timeout=PATIENCE)).note

    def has(self, robot: str) -> bool:
        """Whether a robot acts here."""
        agent = self.host.agents.get(robot)
        return agent is not None and not agent.runtime.is_on_way

    def fields(self, robot: str) -> dict[str, Any]:
        return self.host.agents[robot].runtime.core.state.fields


@pytest.fixture
async def homes(sites: list[SiteOfTest], tmp_path: Path) -> AsyncIterator[dict[str, Home]]:
    """Hosts h1 and h2 at lab, and h2 at hall."""
    lab, hall, _ = sites
    found = {"lab:h1": Home(lab, tmp_path, "h1"), "lab:h2": Home(lab, tmp_path, "h2")}
    found["hall:h2"] = Home(hall, tmp_path, "h2")
    async with contextlib.AsyncExitStack() as stack:
        for home in found.values():
            await home.open()
            stack.push_async_callback(home.close)
        keys = [home.host.address.key for home in found.values()]
        await until(lambda: all(site.member.presence.there(key) for site in (lab, hall) for key in keys))
        yield found


async def touring(homes: dict[str, Home], steps: int) -> asyncio.Future[Any]:
    """Have a tour begin in h1 of lab, over a leaf beside it."""
    h1 = homes["lab:h1"]
    leaf, tour = await homes["lab:h2"].create("leaf", LEAF), await h1.create("tour", TOUR)
    await tour.enslave("arm", leaf.address)
    call = asyncio.ensure_future(tour.call("tour", {"steps": steps}, deadline=PATIENCE))
    await until(lambda: len(homes["lab:h2"].fields("leaf")["done"]) >= 2)
    return call


async def test_a_command_goes_on_at_the_other_site_and_its_page_is_fetched_by_its_hash(
    homes: dict[str, Home],
) -> None:
    h1, far = homes["lab:h1"], homes["hall:h2"]
    prepared: list[PrepareMove] = []
    answer = far.host.moves.answer

    async def note(request: Any, *more: Any) -> Any:
        if isinstance(request, PrepareMove):
            prepared.append(request)
        return await answer(request, *more)

    asked_from: list[str] = []

    def look(place: str) -> None:
        if place == "served":
            calls = far.host.agents["tour"].runtime.core.state.calls.live
            asked_from.extend(call.principal.site for call in calls.values())

    far.host.moves.answer, far.host.moves.moment = note, look  # type: ignore[method-assign]
    call = await touring(homes, 40)
    absent: list[str] = []
    key = h1.host.agents["tour"].address.key
    h1.site.member.presence.watch(key, lambda key, there: None if there else absent.append(key))
    await h1.migrate("tour", "hall:h2")
    assert (h1.has("tour"), far.has("tour")) == (False, True)
    assert not prepared[0].page.source
    assert len(prepared[0].page.hash) == 64
    assert asked_from == ["lab"], "who has called is at another site now"
    assert await call == list(range(40))
    assert homes["lab:h2"].fields("leaf")["done"] == list(range(40))
    assert far.fields("tour")["count"] == 40
    assert absent == [], "nobody at lab has missed it"
    assert Places(h1.site.member.presence).site_of(key) == "hall"
    await far.migrate("tour", "h1")  # the only one of that name, at another site
    assert h1.has("tour")
    await until(lambda: Places(far.site.member.presence).site_of(key) == "lab")
    there = RobotClient(far.site.member, Address.parse(key))  # type: ignore[arg-type]
    assert await there.call("tour", {"steps": 1}) == [0]


async def test_a_doubt_lasts_as_long_as_the_cut_and_a_log_of_the_same_name_says_nothing(
    homes: dict[str, Home], hub: MemoryHub
) -> None:
    h1, far, near = homes["lab:h1"], homes["hall:h2"], homes["lab:h2"]
    asked: list[Any] = []
    answers = {home: home.host.moves.answer for home in (far, near)}

    async def taken_and_cut(request: Any, *more: Any) -> Any:
        if isinstance(request, TakeRobot):
            hub.up = False
        return await answers[far](request, *more)

    async def not_asked(request: Any, *more: Any) -> Any:
        asked.append(request)
        return await answers[near](request, *more)

    far.host.moves.answer = taken_and_cut  # type: ignore[method-assign]
    near.host.moves.answer = not_asked  # type: ignore[method-assign]
    counter = await h1.create("counter", COUNTER)
    call = asyncio.ensure_future(counter.call("count_to", {"number": 40}, deadline=PATIENCE))
    await until(lambda: h1.fields("counter")["done"])
    moving = asyncio.ensure_future(h1.migrate("counter", "hall:h2"))
    await until(lambda: far.has("counter"))
    await asyncio.sleep(ANSWERED_WITHIN + 1.0)
    assert h1.host.moves.leaving["counter"].in_doubt
    assert not h1.has("counter")
    assert asked == []
    await until(lambda: len(far.fields("counter")["done"]) == 40)  # hall goes on without a line
    hub.up = True
    await moving
    await until(lambda: "counter" not in h1.host.agents)
    assert far.has("counter")
    assert await call == list(range(40))


async def test_what_a_host_of_another_site_refuses_and_what_helps(homes: dict[str, Home]) -> None:
    h1, h2, far = homes["lab:h1"], homes["lab:h2"], homes["hall:h2"]

    async def refused(robot: str, host: str, kind: type[VrError], *words: str) -> None:
        with pytest.raises(kind) as error:
            await h1.migrate(robot, host)
        for word in words:
            assert word in str(error.value), error.value
        assert h1.has(robot), "it goes on where it was"

    await h1.create("plain", LEAF, signed=False)
    await refused("plain", "hall:h2", NotSigned, "signed")
    await h1.create("leaf", LEAF)
    await refused("leaf", "cellar:h2", VrError, "cellar")
    await refused("leaf", "hall:h9", VrError, "h9")
    await far.create("leaf", LEAF)
    await refused("leaf", "hall:h2", CannotMove, "another robot here is called leaf", "another name")
    await h1.create("other", LEAF)
    far.host.most = 0
    await refused("other", "hall:h2", VrError, "h2", "is full: it runs 0 robots at most")
    far.host.most = None
    far.host.gate = Gate()
    await refused("other", "hall:h2", UnknownSigner, "trust")
    h2.host.gate = Gate()
    await refused("other", "h2", UnknownSigner, "trust")  # the host of this machine is meant


def known(version: int, *members: LocalTransport) -> bool:
    """Whether all know this policy."""
    for member in members:
        member.gate.refresh(asyncio.get_running_loop().time())
    return all(one.gate.policy is not None and one.gate.policy.version == version for one in members)


async def test_whoever_may_not_create_there_sends_nothing(
    homes: dict[str, Home], sites: list[SiteOfTest]
) -> None:
    h1, far, (lab, hall, _) = homes["lab:h1"], homes["hall:h2"], sites
    await h1.create("leaf", LEAF)
    for version, line, allowed in ((1, "command: '*'", False), (2, "create: '*'", True)):
        rule(lab, text(version, "see: '*'", line))
        await until(partial(known, version, lab.member, hall.member, h1.member, far.member))
        if allowed:
            await h1.migrate("leaf", "hall:h2")
            assert far.has("leaf")
        else:
            with pytest.raises(Denied, match="may not create"):
                await h1.migrate("leaf", "hall:h2")
            assert h1.has("leaf")


# -- robots that find their place: two sites, a slow line ------------------------------------------


DELAY = 0.1
"""[s] one way between the sites."""


def tour(*options: str) -> str:
    """Return a page of a tour with options of its class."""
    head = "class Tour(VirtualRobot):\n"
    assert head in TOUR
    return TOUR.replace(head, head + "".join(f"    {option}\n" for option in options))


AUTO = 'placement = "auto"'


def slow(hub: MemoryHub) -> None:
    """Delay what crosses between the sites."""
    loop = asyncio.get_running_loop()

    def hold(topic: str, body: bytes) -> list[bytes]:
        loop.call_soon_threadsafe(loop.call_later, DELAY, hub.inject, topic, body)
        return []

    hub.on_way = hold


async def test_a_robot_moves_beside_the_one_that_it_calls_and_says_why(
    homes: dict[str, Home], hub: MemoryHub
) -> None:
    near, far = homes["lab:h1"], homes["hall:h2"]
    slow(hub)
    robots: dict[str, RobotClient] = {}
    for name, page in {"placed": tour(AUTO), "pinned": tour(AUTO, "pinned = True"), "asked": tour()}.items():
        leaf = await far.create(f"leaf-{name}", LEAF)
        robots[name] = await near.create(name, page)
        await until(lambda key=leaf.address.key: near.site.member.presence.there(key))  # type: ignore[misc]
        await robots[name].enslave("arm", leaf.address)
    assert "better off" in await robots["asked"].place("advise")
    for home in (near, far):
        home.host.finds_places(used=lambda: 0.0)
    advised, over = near.host.agents["asked"].runtime, asyncio.Event()
    latest = time.monotonic() + PATIENCE

    async def work(name: str) -> None:
        """Have a robot tour until all have found out, and see that nothing is done twice or left out."""
        tours = 0
        while not over.is_set() and time.monotonic() < latest:
            assert await robots[name].call("tour", {"steps": 15}, deadline=PATIENCE) == list(range(15))
            tours += 1
            assert far.fields(f"leaf-{name}")["done"] == list(range(15)) * tours
            if far.has("placed") and advised.advised == "hall:h2":
                over.set()

    await asyncio.gather(*map(work, robots))
    assert (near.has("pinned"), near.has("asked"), near.has("placed")) == (True, True, False)
    shown = await robots["placed"].describe()
    assert shown.placement == "auto"
    assert shown.placed.startswith("hall:h2 is nearer than h1: its ")
    assert (await robots["pinned"].describe()).advice == "its author has pinned it"
    assert "hall:h2 is nearer" in (await robots["asked"].describe()).advice
    (slot,) = (await robots["asked"].describe()).slots
    assert slot.round_trip > 1.5 * DELAY
    described = await ask(
        near.site.member, near.host.address.key, DescribeHost(), HostDescribed, timeout=PATIENCE
    )
    assert described.ways[far.host.address.key] > 1.5 * DELAY
    assert described.load is not None
    assert described.load.robots == 2


# -- who commands a robot is the same one after it has moved to another site, named as it is seen there


LEVER = Address("robot", "lever", "1")
NEAR = Principal(user="anna", process=7, agent=LEVER.key)
FAR = Principal(user="anna", process=7, agent=LEVER.key, site="desk")
HOST = Principal(user="anna", process=7, agent="host/host-1/1", site="desk")


def state_of(holder: Principal) -> RobotState:
    lease = GrantedLease.free("mover", unix=1e9)
    lease.petition(LEVER, "mover", ("lever",), 5.0, now=0.0, unix=1e9, principal=holder)
    lease.promise(10.0, 1)
    calls = Calls()
    for key, principal in (("its", holder), ("own", ITSELF)):
        calls.live[key] = AcceptedCall(key=key, command="go", sent={}, arguments={}, principal=principal)
    return RobotState(
        address=Address("robot", "mover", "1"),
        home="",
        lease=lease,
        slots=Slots("mover"),
        calls=calls,
        stop=Stop(),
    )


def test_its_parent_at_the_site_that_it_left_renews_its_lease_from_there() -> None:
    state = state_of(NEAR)
    epoch = state.lease.epoch
    with pytest.raises(OldParent):  # as another process of the parent, which it is not
        state.lease.renew(LEVER, epoch, ("lever",), now=1.0, unix=1e9, principal=FAR, life=1)
    see_from(state, HOST, "plant")
    state.lease.renew(LEVER, epoch, ("lever",), now=1.0, unix=1e9, principal=FAR, life=1)
    assert state.lease.epoch == epoch
    assert [call.principal for call in state.calls.live.values()] == [FAR, ITSELF]


def test_a_parent_at_the_site_to_which_it_comes_is_near_then_and_one_at_a_third_stays_where_it_is() -> None:
    state = state_of(FAR)
    see_from(state, Principal(user="bob", process=9, agent="host/host-2/1", site="plant"), "desk")
    assert state.lease.current is not None
    assert state.lease.current.principal == NEAR
    yard = Principal(user="anna", process=7, agent=LEVER.key, site="yard", roles=("maker",))
    third = state_of(yard)
    see_from(third, HOST, "plant")
    assert third.lease.current is not None
    assert third.lease.current.principal == yard


def test_who_sits_at_the_machine_of_a_person_is_that_person_there() -> None:
    state = state_of(NEAR)
    see_from(
        state,
        Principal(user="cleo", process=7, agent="host/h/1", site="cleo", member=True, roles=("a",)),
        "plant",
    )
    assert state.lease.current is not None
    assert state.lease.current.principal == Principal(
        user="cleo", process=7, agent=LEVER.key, site="cleo", member=True, roles=("a",)
    )
