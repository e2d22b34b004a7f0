"""Signed pages on a host: what runs, what does not, and what is still so after a restart and a reload."""

from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path

import pytest
from msgspec.structs import replace

from robotree.vr.agents.host import Host
from robotree.vr.base.errors import RevokedSigner, UnknownSigner
from robotree.vr.base.permissions import Permissions
from robotree.vr.bundle import Bundle
from robotree.vr.bundle.admission import OWN, Clearance, Gate
from robotree.vr.exchange.client import HostClient, RobotClient
from robotree.vr.journal.journal import HostJournal
from robotree.vr.running.process import Process
from robotree.vr.running.runner import runner_of
from robotree.vr.world.network import MemoryNetwork
from tests.vr.bundle.signed import key_of, of, signer, trusting

PAGE = """
from robotree.vr import VirtualRobot, command

class Guide(VirtualRobot):
    @command
    def greet(self) -> str:
        return "{}"
"""
NOTHING = Permissions()


class Place:
    """A host that may be started again."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.network = folder, MemoryNetwork()
        self.trust = trusting(folder, signer("anna", isolation="none"))
        self.gate = Gate(self.trust)

    async def start(self) -> None:
        import asyncio

        runner = runner_of(asyncio.get_running_loop())
        self.journal = HostJournal(self.folder / "journal", runner)
        process = Process(runner, self.journal)
        transport = self.network.join("host-1")
        self.host = Host(transport, "host-1", process=process, journal=self.journal, gate=self.gate)
        self.client = HostClient(self.network.join("operator"), self.host.address)
        await self.host.start()
        await self.host.restore()

    async def end(self) -> None:
        await self.host.close()
        self.journal.close()

    async def greeting(self, name: str) -> object:
        robot = RobotClient(self.network.join(), self.host.agents[name].address)
        return await robot.call("greet", {})


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
    await place.end()
    place.gate.any_signer = False
    await place.start()
    assert not place.host.agents
    assert "comes from anna@lab and is not signed" in caplog.text
