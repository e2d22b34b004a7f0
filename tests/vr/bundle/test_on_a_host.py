"""Signed pages on a host: what runs, what does not, and what is still so after a restart and a reload."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
from msgspec.structs import replace

from robotree.vr.agents.bundles import KnownBundles
from robotree.vr.agents.host import Host
from robotree.vr.base.errors import (
    CommandFailed,
    NoSuchBundle,
    NotPermitted,
    NotSigned,
    RevokedSigner,
    UnknownSigner,
)
from robotree.vr.base.permissions import Permissions
from robotree.vr.base.requests import AnyRequest, BundleRead, Call, Create, Delete, Raised, ReadBundle, Reply
from robotree.vr.bundle import Bundle
from robotree.vr.bundle.admission import OWN, Clearance, Gate
from robotree.vr.exchange.asking import send_request
from robotree.vr.exchange.client import HostClient
from tests.vr.bundle.signed import key_of, of, signer, trusting
from tests.vr.place import HostPlace

PAGE = """
from robotree.vr import VirtualRobot, command

class Guide(VirtualRobot):
    @command
    def greet(self) -> str:
        return "{}"
"""
NOTHING = Permissions()


class Place(HostPlace):
    """A host that trusts Anna."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.gate = Gate(trusting(folder, signer("anna", isolation="none")))

    async def greeting(self, name: str) -> object:
        return await self.robot(name).call("greet", {})


@pytest.fixture
async def place(tmp_path: Path) -> AsyncIterator[Place]:
    place = Place(tmp_path)
    await place.start()
    yield place
    await place.end()


async def test_two_versions_of_a_class_by_two_signers_live_side_by_side(place: Place) -> None:
    trusting(place.folder, signer("anna", isolation="none"), signer("bob", isolation="none"))
    await place.client.create(Bundle(PAGE.format("own"), "guide.py"), "own")
    for who in ("anna", "bob"):
        await place.client.create(of(who, source=PAGE.format(who)), who)
    for name in ("own", "anna", "bob"):
        assert await place.greeting(name) == name
    assert place.host.clearances == {
        "own": OWN,
        "anna": Clearance("anna", NOTHING, "none"),
        "bob": Clearance("bob", NOTHING, "none"),
    }
    pages = place.host.description().pages
    assert len(set(pages.values())) == 3


async def test_a_foreign_page_is_refused_before_a_line_of_it_runs(place: Place) -> None:
    source = f"open({str(place.folder / 'ran')!r}, 'w').close()\n" + PAGE.format("bob")
    with pytest.raises(UnknownSigner):
        await place.client.create(of("bob", source=source), "bob")
    assert not (place.folder / "ran").exists()
    assert not place.host.agents


async def test_a_robot_goes_on_with_a_foreign_page_only_if_its_signer_is_trusted(place: Place) -> None:
    await place.client.create(of("anna", source=PAGE.format("first")), "guide")
    with pytest.raises(UnknownSigner):
        await place.client.reload(of("bob", source=PAGE.format("bob")), "guide")
    assert await place.greeting("guide") == "first"
    await place.client.reload(of("anna", source=PAGE.format("second")), "guide")
    assert await place.greeting("guide") == "second"
    assert place.host.clearances["guide"].signer == "anna"


async def test_a_signed_robot_comes_back_with_its_host_as_it_was(place: Place) -> None:
    sent = of("anna", source=PAGE.format("anna"))
    await place.client.create(sent, "guide")
    await place.end()
    await place.start()
    assert await place.greeting("guide") == "anna"
    assert place.host.clearances["guide"] == Clearance("anna", NOTHING, "none")
    assert place.host.page_of("guide") == sent.hash


async def test_a_robot_whose_signer_was_revoked_meanwhile_does_not_come_back(
    place: Place, caplog: pytest.LogCaptureFixture
) -> None:
    await place.client.create(of("anna", source=PAGE.format("anna")), "guide")
    await place.end()
    revoked = place.folder / "revoked_signers"
    revoked.write_text(f"{key_of('anna').public}\n")
    revoked.chmod(0o600)
    await place.start()
    assert not place.host.agents
    assert "guide is not back: /home/anna/guide.py is signed by" in caplog.text
    with pytest.raises(RevokedSigner):
        await place.client.create(of("anna"), "guide-2")


async def test_what_ran_unchecked_once_is_not_ones_own_after_a_restart(
    place: Place, caplog: pytest.LogCaptureFixture
) -> None:
    place.gate.any_signer = True
    afar = replace(Bundle(PAGE.format("afar"), "guide.py"), sender="anna@lab")
    await place.host.create(afar, "guide")
    assert place.host.clearances["guide"].unchecked
    assert place.host.agents["guide"].description().unchecked
    await place.end()
    place.gate.any_signer = False
    await place.start()
    assert not place.host.agents
    assert "comes from anna@lab and is not signed" in caplog.text


# -- permissions -----------------------------------------------------------------------------------

ARM = """
from robotree.vr import VirtualRobot, command

class Arm(VirtualRobot):
    @command
    def move(self, x: float) -> float:
        return x

    @command
    def melt(self) -> None:
        raise AssertionError("nobody may melt it")

    def readings(self) -> dict[str, float]:
        return {"z": 0.5, "secret": 42.0}
"""
BOSS = """
from robotree.vr import Child, VirtualRobot, command

class Boss(VirtualRobot):
    arm = Child("Arm")

    @command
    def move(self) -> float:
        return self.arm.move(x=2.0)

    @command
    def melt(self) -> str:
        try:
            getattr(self.arm, "melt")()
        except Exception as error:
            return str(error)
        return "melted"

    @command
    def look(self) -> list[str]:
        reading = self.arm.readings
        seen = [str(reading.z)]
        try:
            seen.append(str(reading.secret))
        except AttributeError as error:
            seen.append("hidden")
        return seen

    exposed_melt = arm.exposed("melt")
"""
LIMITED = Permissions(("Arm.move",), ("Arm.z",))


@pytest.mark.parametrize("where", ["in the same host", "in another process"])
async def test_a_signed_page_asks_and_sees_no_more_than_its_manifest_says(place: Place, where: str) -> None:
    home, client = place.host, place.client
    if where == "in another process":
        home = Host(place.network.join("host-2"), "host-2")
        await home.start()
        client = HostClient(place.network.join("operator-2"), home.address)
    arm = await client.create(Bundle(ARM, "arm.py"), "arm")
    await place.client.create(of("anna", LIMITED, source=BOSS), "boss")
    boss = place.robot("boss")
    await boss.enslave("arm", arm.address)
    assert await boss.call("move", {}) == 2.0
    sentence = "boss may not call Arm.melt: the manifest of its page does not permit it"
    assert sentence in str(await boss.call("melt", {}))
    with pytest.raises(NotPermitted, match=r"boss may not call Arm\.melt"):
        await boss.call("exposed_melt", {})
    assert await boss.call("look", {}) == ["0.5", "hidden"]

    await place.client.reload(Bundle(BOSS, "boss.py"), "boss")
    with pytest.raises(CommandFailed, match="nobody may melt it"):
        await boss.call("exposed_melt", {})
    if home is not place.host:
        await home.close()


async def test_the_robot_that_is_asked_refuses_what_the_askers_page_may_not(place: Place) -> None:
    """The process of a page that sends what it may not, as its envelope says."""
    arm = await place.client.create(Bundle(ARM, "arm.py"), "arm")
    transport = place.network.join("foreign")

    async def asked(key: str, request: AnyRequest) -> Reply:
        answer: asyncio.Future[Reply | None] = asyncio.get_running_loop().create_future()

        def take(reply: Reply | None) -> None:
            loop.call_soon_threadsafe(lambda: answer.done() or answer.set_result(reply))

        loop = asyncio.get_running_loop()
        send_request(
            transport, key, request, take, now=loop.time(), within=30.0, sender="robot/boss/1", may=LIMITED
        )
        async with asyncio.timeout(60):
            found = await answer
        assert found is not None
        return found

    def refused(reply: Reply) -> str:
        assert isinstance(reply, Raised)
        return str(reply.revive())

    melt = Call(key="k1", command="melt", arguments={}, deadline=30.0, caller="boss")
    assert "boss may not call Arm.melt" in refused(await asked(arm.address.key, melt))
    move = Call(key="k2", command="move", arguments={"x": 1.0}, deadline=30.0, caller="boss")
    assert not isinstance(await asked(arm.address.key, move), Raised)
    assert "boss may not ask for Delete" in refused(await asked(arm.address.key, Delete()))
    create = Create(name="x", path="x.py", source=ARM)
    assert "boss may not ask for Create" in refused(await asked(place.host.address.key, create))


# -- by hash ---------------------------------------------------------------------------------------


class Others:
    """Two more hosts in the realm of a place."""

    def __init__(self, place: Place) -> None:
        joined = [(name, place.network.join(name)) for name in ("host-2", "host-3")]
        self.hosts = [Host(transport, name, gate=place.gate) for name, transport in joined]

    async def __aenter__(self) -> list[Host]:
        for host in self.hosts:
            await host.start()
        return self.hosts

    async def __aexit__(self, *_: object) -> None:
        for host in self.hosts:
            await host.close()


class Forger(KnownBundles):
    """Says that one page is another one."""

    def __init__(self, good: Bundle, forged: Bundle) -> None:
        self.asked_for, self.forged = good.hash, forged

    def answer(self, request: ReadBundle) -> BundleRead:
        assert request.hash == self.asked_for
        return BundleRead(page=self.forged.request())


async def test_a_signed_page_is_found_by_its_hash_from_whoever_has_it(place: Place) -> None:
    async with Others(place) as (second, _):
        sent = of("anna", source=PAGE.format("anna"))
        await HostClient(place.network.join("a"), second.address).create(sent, "there")
        made = await place.client.create_known(sent.hash, "here")
        assert await place.greeting("here") == "anna"
        assert place.host.page_of("here") == sent.hash == second.page_of("there")
        assert place.host.clearances["here"].signer == "anna"
        assert made.kind == "Guide"


async def test_a_page_that_nobody_has_is_named(place: Place) -> None:
    async with Others(place):
        with pytest.raises(NoSuchBundle, match="nobody here has the bundle 0000000000000000; "):
            await place.client.create_known("0" * 64, "here")


async def test_ones_own_page_is_known_by_its_hash_where_it_has_been(place: Place) -> None:
    own = Bundle(PAGE.format("own"), "guide.py")
    await place.client.create(own, "first")
    await place.client.create_known(own.hash, "second")
    assert place.host.clearances["second"] == OWN


async def test_an_unsigned_page_of_another_host_is_not_ones_own(place: Place) -> None:
    async with Others(place) as (second, _):
        own = Bundle(PAGE.format("own"), "guide.py")
        await HostClient(place.network.join("a"), second.address).create(own, "there")
        with pytest.raises(NotSigned, match=r"guide\.py comes from host host-2 and is not signed"):
            await place.client.create_known(own.hash, "here")


async def test_a_host_that_sends_another_page_than_was_asked_for_is_not_believed(place: Place) -> None:
    async with Others(place) as (second, third):
        good = of("anna", source=PAGE.format("anna"))
        second.bundles = Forger(good, of("anna", source=PAGE.format("forged")))
        with pytest.raises(NoSuchBundle):
            await place.client.create_known(good.hash, "here")
        third.bundles.keep(good)
        await place.client.create_known(good.hash, "here")
        assert await place.greeting("here") == "anna"
