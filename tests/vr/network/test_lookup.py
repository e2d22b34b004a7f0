"""Names and the services that list who has them, with every accident between them, in virtual time."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import msgspec
import pytest

from robotree.vr.base.address import Address, Role
from robotree.vr.base.description import Listing, Template
from robotree.vr.base.errors import BadName, DuplicateName, NameInSilence, NoSuchHost, NoSuchRobot, NoSuchView
from robotree.vr.base.requests import Register, Registered
from robotree.vr.base.transport import Incoming, Registration, Transport
from robotree.vr.exchange.asking import ask
from robotree.vr.exchange.claim import claim, new_address
from robotree.vr.lookup import registrar
from robotree.vr.lookup.directory import FIRST_LOOK, SYNCHRONISE, Directory
from robotree.vr.lookup.registrar import TERM, Registrar
from robotree.vr.lookup.service import LookupService
from robotree.vr.world.network import MemoryNetwork
from robotree.vr.world.testing import LOOKUP_CHECKS, Join, Open, in_virtual_time


class Agent:
    """One agent in a process of its own."""

    def __init__(self, network: MemoryNetwork, name: str) -> None:
        self.network, self.transport = network, network.join(name)
        self.registrar = Registrar(self.transport, chance=lambda: 0.5)
        self.listing = Listing(address=new_address("robot", name), kinds=("Arm", "Robot"))
        self.presence: Registration | None = None

    async def start(self) -> Agent:
        self.presence = await self.transport.announce(self.listing.address.key)
        await self.registrar.enter(self.listing)
        return self

    async def become_free(self) -> None:
        await self.registrar.enter(self.listing)

    async def be_enslaved(self) -> None:
        await self.registrar.leave(self.listing.address)


class Onlooker:
    """A supervisor's directory and everything that it was told."""

    def __init__(self, network: MemoryNetwork) -> None:
        self.directory = Directory(network.join("onlooker"))
        self.told: list[str] = []
        self.directory.on_change(
            lambda change: self.told.append(
                f"{change.kind} {change.listing.name}" if change.listing else change.kind
            )
        )

    async def start(self) -> Onlooker:
        await self.directory.start()
        return self

    @property
    def news(self) -> list[str]:
        """What was told of robots since the last look."""
        told, self.told = self.told, []
        return [line for line in told if line not in {"services", "presence"}]

    @property
    def names(self) -> list[str]:
        return [listing.name for listing in self.directory.listings]


async def open_service(transport: Transport, name: str) -> LookupService:
    service = LookupService(transport, name)
    await service.start()
    return service


async def open_lookup(network: MemoryNetwork, name: str) -> LookupService:
    return await open_service(network.join(name), name)


async def open_realm(*agents: str, lookups: int = 3) -> Any:
    """Have lookup services, agents and an onlooker; returns the network, and them."""
    network = MemoryNetwork()
    services = [await open_lookup(network, f"lookup-{number}") for number in range(lookups)]
    started = [await Agent(network, name).start() for name in agents]
    return network, services, await Onlooker(network).start(), *started


@in_virtual_time
async def test_arrivals_changes_and_departures_appear_by_themselves_and_once() -> None:
    network, _, onlooker = await open_realm()
    arm, rover = await Agent(network, "arm").start(), await Agent(network, "rover").start()
    await asyncio.sleep(0.01)
    assert onlooker.news == ["arrived arm", "arrived rover"]
    await arm.registrar.enter(msgspec.structs.replace(arm.listing, doc="now with a doc"))
    await asyncio.sleep(0.01)
    assert onlooker.news == ["changed arm"]
    await arm.be_enslaved()
    await asyncio.sleep(0.01)
    assert onlooker.news == ["departed arm"]
    network.kill(rover.transport)
    await asyncio.sleep(0.01)
    assert onlooker.news == ["departed rover"], "death is seen at once, not when the lease ends"
    await arm.become_free()
    await asyncio.sleep(0.01)
    assert onlooker.news == ["arrived arm"]
    await asyncio.sleep(300)
    assert onlooker.news == [], "leases are renewed"
    assert onlooker.directory.services == ("lookup-0", "lookup-1", "lookup-2")


@in_virtual_time
async def test_an_agent_that_goes_on_in_another_process_is_listed_though_it_was_withdrawn() -> None:
    network, _, onlooker, arm = await open_realm("arm")
    await arm.be_enslaved()
    there = Agent(network, "arm")
    there.listing = arm.listing
    await there.start()
    await asyncio.sleep(1)
    assert onlooker.names == ["arm"]


@pytest.mark.parametrize("seconds", [0.5, 1.9, 2.1, 5.0, 9.0, 11.0, 100.0])
@in_virtual_time
async def test_with_one_of_three_stopped_nobody_notices(seconds: float) -> None:
    network, lookups, onlooker, _ = await open_realm("arm")
    assert onlooker.news == ["arrived arm"]
    network.freeze(lookups[1]._transport)
    await asyncio.sleep(seconds)
    network.thaw(lookups[1]._transport)
    await asyncio.sleep(60)
    assert onlooker.news == []


@in_virtual_time
async def test_a_stopped_lookup_delays_neither_agents_nor_onlookers() -> None:
    network, lookups, _ = await open_realm()
    network.freeze(lookups[1]._transport)
    loop = asyncio.get_running_loop()
    begin = loop.time()
    arm = await Agent(network, "arm").start()
    assert loop.time() - begin < 0.2
    onlooker = await Onlooker(network).start()
    assert loop.time() - begin < FIRST_LOOK + 0.3
    assert onlooker.names == ["arm"]
    begin = loop.time()
    await arm.be_enslaved()
    assert loop.time() - begin < 0.2
    await asyncio.sleep(0.01)
    assert onlooker.names == []


@in_virtual_time
async def test_with_all_killed_the_list_is_stale_and_heals_when_one_returns() -> None:
    network, lookups, onlooker, arm, rover, bound = await open_realm("arm", "rover", "bound")
    assert onlooker.news == ["arrived arm", "arrived bound", "arrived rover"]
    for lookup in lookups:
        network.kill(lookup._transport)
    await asyncio.sleep(600)
    assert onlooker.news == []
    assert onlooker.directory.stale
    assert onlooker.names == ["arm", "bound", "rover"], "the last knowledge stays"
    await bound.be_enslaved()
    network.kill(rover.transport)
    await asyncio.sleep(0.01)
    assert onlooker.news == ["departed rover"], "who is dead is dead, lookup or not"
    late = await Agent(network, "late").start()
    assert await onlooker.directory.resolve("late") == late.listing.address
    await open_lookup(network, "lookup-9")
    await asyncio.sleep(1)
    assert not onlooker.directory.stale
    news = ["departed bound", "arrived late"]  # one was enslaved while no lookup lived
    assert onlooker.news == news, "all register again, and who was known does not flicker"
    await asyncio.sleep(60)
    assert onlooker.news == []
    await arm.be_enslaved()
    await asyncio.sleep(0.01)
    assert onlooker.news == ["departed arm"]


@in_virtual_time
async def test_who_is_slow_to_register_with_a_new_lookup_does_not_flicker() -> None:
    network, (lookup,), onlooker, arm = await open_realm("arm", lookups=1)
    network.kill(lookup._transport)
    network.freeze(arm.transport)
    await open_lookup(network, "lookup-9")
    await asyncio.sleep(1.5)
    network.thaw(arm.transport)
    await asyncio.sleep(60)
    assert onlooker.news == ["arrived arm"]


@in_virtual_time
async def test_a_service_that_heard_nothing_for_longer_than_the_lease_learns_everything_again() -> None:
    network, (service,), onlooker, arm, rover = await open_realm("arm", "rover", lookups=1)
    transport: Any = service._transport
    handler, heard = transport.served[service.address.key], 0

    def count(incoming: Incoming) -> None:
        nonlocal heard
        heard += 1
        handler(incoming)

    def lose(incoming: Incoming) -> None:
        """Lose what comes, and the answer too."""
        incoming.end(None)

    spare = Agent(network, "spare")
    spare.transport, spare.registrar = arm.transport, arm.registrar
    await spare.start()
    await asyncio.sleep(0.1)
    assert onlooker.names == ["arm", "rover", "spare"]
    transport.served[service.address.key] = lose
    await asyncio.sleep(TERM + 1)
    assert onlooker.names == []
    await spare.be_enslaved()
    transport.served[service.address.key] = count
    await asyncio.sleep(1)
    assert onlooker.names == ["arm", "rover"]
    assert rover.registrar is not arm.registrar
    heard = 0
    await asyncio.sleep(30)
    assert heard < 30, "one renewal for each process, however many robots it has"


@in_virtual_time
async def test_a_listing_that_its_process_gave_up_unheard_runs_out_though_the_others_are_renewed() -> None:
    _, (service,), onlooker, arm = await open_realm("arm", lookups=1)
    keeper = arm.registrar._keepers[service.address.key]
    stray = msgspec.structs.replace(arm.listing, address=new_address("robot", "stray"), revision=1)
    await arm.transport.announce(stray.address.key)
    request = Register(holder=keeper._holder, term=TERM, listings=(stray,))
    await ask(arm.transport, service.address.key, request, Registered, timeout=5)
    await asyncio.sleep(0.1)
    assert onlooker.names == ["arm", "stray"]
    await asyncio.sleep(3 * TERM)
    assert onlooker.names == ["arm"]
    assert onlooker.news == ["arrived arm", "arrived stray", "departed stray"]


@in_virtual_time
async def test_robots_that_come_and_go_all_the_time_leave_a_bounded_trace(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Also while a service hears nothing of it: when it is back its list is what is wanted."""
    monkeypatch.setattr(registrar, "MOST_REMEMBERED", 5)
    network = MemoryNetwork()
    lookups = [await open_lookup(network, f"lookup-{number}") for number in range(2)]
    arm = await Agent(network, "arm").start()
    kept = await Agent(network, "kept").start()
    network.freeze(lookups[1]._transport)
    for number in range(50):
        passing = msgspec.structs.replace(arm.listing, address=new_address("robot", f"r{number}"))
        await arm.registrar.enter(passing)
        await arm.registrar.leave(passing.address)
        assert len(arm.registrar.wanted) <= 6
    network.thaw(lookups[1]._transport)
    await asyncio.sleep(2 * TERM)
    onlooker = await Onlooker(network).start()
    network.kill(lookups[0]._transport)
    await asyncio.sleep(2 * SYNCHRONISE)
    assert onlooker.names == ["arm", "kept"]
    assert kept.registrar.wanted.keys() == {kept.listing.address}


@in_virtual_time
async def test_a_late_lookup_is_not_kept_waiting_by_a_stopped_one() -> None:
    network, lookups, *_ = await open_realm("arm")
    network.freeze(lookups[0]._transport)
    begin = asyncio.get_running_loop().time()
    service = await open_lookup(network, "late")
    assert asyncio.get_running_loop().time() - begin < 1.5
    now = asyncio.get_running_loop().time()
    assert [listing.name for listing, _ in service.table.find(Template(), now)] == ["arm"]


@in_virtual_time
async def test_news_that_got_lost_is_made_up_for() -> None:
    network, (service,), onlooker = await open_realm(lookups=1)
    service._tell = lambda _: None  # as if the network dropped it
    arm = await Agent(network, "arm").start()
    await asyncio.sleep(SYNCHRONISE + 1)
    assert onlooker.news == ["arrived arm"]
    await arm.be_enslaved()
    await asyncio.sleep(SYNCHRONISE + 1)
    assert onlooker.news == ["departed arm"]


@in_virtual_time
async def test_the_enslaved_are_found_by_name_and_nobody_else() -> None:
    _, _, onlooker, arm = await open_realm("arm", lookups=1)
    await arm.be_enslaved()
    await asyncio.sleep(0.01)
    assert onlooker.names == []
    assert await onlooker.directory.resolve("arm") == arm.listing.address
    for role, error in (("robot", NoSuchRobot), ("view", NoSuchView), ("host", NoSuchHost)):
        with pytest.raises(error, match="'nobody'"):
            await onlooker.directory.resolve("nobody", role)  # type: ignore[arg-type]
    with pytest.raises(NoSuchView):
        await onlooker.directory.resolve("arm", "view")
    assert onlooker.directory.present("robot") == (arm.listing.address,)


@in_virtual_time
async def test_a_listener_that_raises_or_leaves_disturbs_nobody(caplog: pytest.LogCaptureFixture) -> None:
    network = MemoryNetwork()
    await open_lookup(network, "lookup-1")
    onlooker = Onlooker(network)

    def fail(_: object) -> None:
        raise RuntimeError("on purpose")

    end = onlooker.directory.on_change(fail)
    onlooker.directory.on_change(lambda _: None)()
    await onlooker.start()
    await Agent(network, "arm").start()
    await asyncio.sleep(0.01)
    end()
    end()
    assert onlooker.news == ["arrived arm"]
    assert "on purpose" in caplog.text


@in_virtual_time
async def test_what_was_closed_asks_and_tells_nothing_more() -> None:
    _, (service,), onlooker, arm = await open_realm("arm", lookups=1)
    await onlooker.directory.close()
    await onlooker.directory.close()
    await arm.registrar.close()
    await arm.registrar.close()
    assert onlooker.news == ["arrived arm"]
    await asyncio.sleep(60)
    assert onlooker.news == []
    assert service.table.find(Template(), asyncio.get_running_loop().time()) == (), "nobody renews"
    await service.close()
    await service.close()
    left = asyncio.all_tasks() - {asyncio.current_task()}
    assert not left, "no task is left behind"


# -- the service alone -----------------------------------------------------------------------------


@pytest.mark.parametrize("check", LOOKUP_CHECKS, ids=lambda check: check.__name__)
@in_virtual_time
async def test_a_lookup_service_passes_its_examination(
    check: Callable[[Join, Open], Awaitable[None]], join_memory: Join
) -> None:
    await check(join_memory, open_service)


@in_virtual_time
async def test_two_of_one_name_cannot_be() -> None:
    network = MemoryNetwork()
    first = await open_lookup(network, "lookup-1")
    with pytest.raises(DuplicateName, match="a lookup named 'lookup-1' is already running"):
        await open_lookup(network, "lookup-1")
    await first.close()
    await (await open_lookup(network, "lookup-1")).close()


@in_virtual_time
async def test_a_name_that_breaks_addresses_is_refused() -> None:
    with pytest.raises(BadName):
        LookupService(MemoryNetwork().join(), "a/b")


# -- one living agent has each name, also if two came at the same moment ---------------------------


@in_virtual_time
async def test_a_name_whose_holder_hangs_is_not_given_to_another() -> None:
    """When it wakes there would be two, and each would take the children for its own."""
    network = MemoryNetwork()
    one, other = network.join("one"), network.join("other")
    held = await claim(one, new_address("robot", "arm"))
    network.freeze(one)
    await asyncio.sleep(2 * network.lease)
    assert not other.presence.keys("robot/**")
    with pytest.raises(NameInSilence, match=r"a robot named 'arm' is in one, which hangs; choose .*thaw"):
        await claim(other, new_address("view", "arm"))
    network.kill(one)
    await claim(other, new_address("robot", "arm"))
    await held.close()


@pytest.mark.parametrize(("first", "second"), [("robot", "robot"), ("robot", "view"), ("view", "robot")])
@in_virtual_time
async def test_a_name_is_refused_until_its_holder_has_gone_but_a_host_may_have_that_of_a_robot(
    first: Role, second: Role
) -> None:
    network = MemoryNetwork()
    one, other = network.join(), network.join()
    held = await claim(one, new_address(first, "cell"))
    with pytest.raises(DuplicateName, match=f"a {first} named 'cell' is already running"):
        await claim(other, new_address(second, "cell"))
    await claim(other, new_address("host", "cell"))
    await claim(other, new_address("lookup", "cell"))
    await held.close()
    await claim(other, new_address(second, "cell"))
    assert len(one.presence.keys("*/cell/*")) == 3


@in_virtual_time
async def test_a_holder_that_is_just_leaving_is_waited_for() -> None:
    network = MemoryNetwork(delay=0.02)
    one, other = network.join(), network.join()
    held = await claim(one, new_address("robot", "arm"))
    asyncio.get_running_loop().call_later(0.05, lambda: asyncio.ensure_future(held.close()))
    assert await claim(other, new_address("robot", "arm"))


@pytest.mark.parametrize("role", ["robot", "view"])
@in_virtual_time
async def test_of_two_who_wait_for_a_holder_to_leave_exactly_one_stays(role: Role) -> None:
    """Both see it go at the same moment, and neither sees the other before it has announced itself."""
    network = MemoryNetwork(delay=0.04)
    holder, *waiting = (network.join() for _ in range(3))
    held = await claim(holder, Address("robot", "arm", "0"))
    asyncio.get_running_loop().call_later(0.02, lambda: asyncio.ensure_future(held.close()))
    await asyncio.sleep(0.05)
    addresses = Address("robot", "arm", "1"), Address(role, "arm", "2")
    one, other = await asyncio.gather(*map(claim, waiting, addresses), return_exceptions=True)
    assert not isinstance(one, BaseException), "the smaller address"
    assert isinstance(other, DuplicateName)
