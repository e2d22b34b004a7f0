"""Sites that chose the same name before they met both keep it, and nobody takes one for the other."""

from __future__ import annotations

import pytest

from robotree.vr.base.address import Address, parted, shown_address
from robotree.vr.base.errors import BadName, NoSuchRobot, NoSuchSite, NotConfirmed, SeveralSites, SiteAway
from robotree.vr.base.places import place_key, silent_key, site_key
from robotree.vr.base.requests import Done, SafeStop
from robotree.vr.exchange.dispatcher import Dispatcher
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.network import MemoryNetwork, MemoryTransport
from robotree.vr.world.testing import in_virtual_time


class Machine:
    """The machine of site lab, whose gateway knows two other sites."""

    def __init__(self) -> None:
        self.network = MemoryNetwork()
        self.gateway, self.host = self.network.join("gateway"), self.network.join("host")
        self.stopped: list[str] = []

    async def open(self) -> RealmClient:
        await self.gateway.announce("gateway/lab/1")
        for site in ("hall", "yard"):
            await self.gateway.announce(site_key(site))
        self.operator = self.network.join("operator")
        found = RealmClient(self.operator)
        await found.start()
        return found

    async def robot(self, key: str, site: str = "", error: Exception | None = None) -> None:
        """Have a robot, here or at a site."""
        member: MemoryTransport = self.gateway if site else self.host
        if site:
            await member.announce(place_key(site, key))

        def answer(received: object, _: object) -> Done:
            assert isinstance(getattr(received, "request", None), SafeStop)
            if error is not None:
                raise error
            self.stopped.append(key)
            return Done()

        await member.serve(key, Dispatcher(key, answer, now=member.loop.time).take)
        await member.announce(key)


def test_a_name_may_have_a_site_before_it() -> None:
    assert parted("hall:arm-1") == ("hall", "arm-1")
    assert parted("arm-1") == ("", "arm-1")
    for bad in ("hall:", ":arm-1", "a:b:c", "hall:arm 1", "*:arm", "hall:*"):
        with pytest.raises(BadName):
            parted(bad)
    shown = Address("robot", "arm-1", "6f").shown("hall")
    assert (shown.name, shown.key, shown.plain_name) == ("hall:arm-1", "robot/arm-1/6f", "arm-1")
    assert shown_address("robot/hall:arm-1/6f") == shown
    assert Address.parse("robot/hall:arm-1/6f") is None, "nobody can be present under such a name"


@in_virtual_time
async def test_a_plain_name_is_the_own_one_else_the_only_one_else_a_sentence_names_both() -> None:
    machine = Machine()
    realm = await machine.open()
    resolve = realm.directory.resolve
    await machine.robot("robot/arm-1/h", "hall")
    assert (await resolve("arm-1")).incarnation == "h"
    await machine.robot("robot/arm-1/y", "yard")
    with pytest.raises(SeveralSites, match=r"robot arm-1 is at hall and at yard.*hall:arm-1 or yard:arm-1"):
        await resolve("arm-1")
    assert (await resolve("yard:arm-1")).incarnation == "y"
    await machine.robot("robot/arm-1/l")
    assert (await resolve("arm-1")).incarnation == "l"
    assert (await resolve("lab:arm-1")).incarnation == "l"
    assert (await resolve("hall:arm-1")).incarnation == "h"
    with pytest.raises(NoSuchRobot):
        await resolve("hall:arm-2")
    with pytest.raises(NoSuchSite, match="the others are hall, yard"):
        await resolve("cellar:arm-1")
    await machine.gateway.announce(silent_key("hall"))
    with pytest.raises(SiteAway, match="site hall is not heard"):
        await resolve("hall:arm-2")
    await realm.close()


@in_virtual_time
async def test_the_confirmation_of_one_never_counts_for_the_other() -> None:
    machine = Machine()
    realm = await machine.open()
    await machine.robot("robot/arm-1/h", "hall", error=NoSuchRobot(name="x"))
    await machine.robot("robot/arm-1/l")
    assert list(await realm.stop("arm-1")) == ["lab:arm-1"]
    with pytest.raises(NotConfirmed, match="confirmed by nobody but NOT by hall:arm-1"):
        await realm.stop("hall:arm-1")
    assert machine.stopped == ["robot/arm-1/l"]
    await realm.close()


@in_virtual_time
async def test_a_stop_of_a_name_that_only_others_have_stops_all_of_them() -> None:
    machine = Machine()
    realm = await machine.open()
    await machine.robot("robot/arm-1/h", "hall")
    await machine.robot("robot/arm-1/y", "yard")
    assert set(await realm.stop("arm-1")) == {"hall:arm-1", "yard:arm-1"}, "a stop asks nobody back"
    with pytest.raises(NoSuchSite):
        await realm.stop("cellar:arm-1")
    with pytest.raises(NoSuchRobot):
        await realm.stop("arm-9")
    await machine.gateway.announce(silent_key("hall"))
    with pytest.raises(NotConfirmed, match=r"hall:arm-9 .site hall is not heard, and it may be there"):
        await realm.stop("arm-9")
    await realm.close()


@in_virtual_time
async def test_one_machine_alone_knows_no_sites() -> None:
    network = MemoryNetwork()
    host, operator = network.join("host"), network.join("operator")
    await host.announce("robot/arm-1/1")
    realm = RealmClient(operator)
    await realm.start()
    assert realm.places.own == ""
    assert [one.name for one in realm.present("robot")] == ["arm-1"]
    with pytest.raises(NoSuchSite, match="no gateway on this machine knows others"):
        await realm.directory.resolve("hall:arm-1")
    await realm.close()
