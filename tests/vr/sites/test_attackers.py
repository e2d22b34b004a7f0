"""Attacks on gateways that run: hubs that inject, and members who lie."""

from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from robotree.vr import Child, VirtualRobot, command
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.base.envelope import seal
from robotree.vr.base.errors import NotInControl, StaleEpoch
from robotree.vr.base.requests import Call, Done
from robotree.vr.exchange.client import RobotClient
from robotree.vr.sites.certificates import MemberKind
from robotree.vr.sites.frames import SiteAsk
from robotree.vr.sites.sealing import Lane
from robotree.vr.world.testing import until
from tests.vr.sites.realm import Realm
from tests.vr.sites.site import ROBOT, MemoryHub, SiteOfTest, ask, call, linked

MEMBERS: tuple[tuple[str, MemberKind], ...] = (("hall", "site"), ("yard", "site"), ("anna", "person"))


@pytest.fixture
async def sites(place: Path, hub: MemoryHub) -> AsyncIterator[dict[str, SiteOfTest]]:
    """Lab, hall with a robot, yard, and the machine of a person."""
    async with linked(place, hub, *MEMBERS) as found:
        yield {site.keys.name: site for site in found}


class Arm(VirtualRobot):
    """Moves."""

    @command
    def step(self, x: float) -> float:
        """Move."""
        return x


class Parent(VirtualRobot):
    """Has an arm."""

    arm = Child("Robot")


async def test_a_member_that_names_the_parent_of_a_robot_commands_it_under_no_lease(
    sites: dict[str, SiteOfTest],
) -> None:
    lab, hall, yard = sites["lab"], sites["hall"], sites["yard"]
    arm, parent = RobotAgent(Arm("arm-9"), hall.member), RobotAgent(Parent("boss"), lab.member)
    await arm.start()
    await parent.start()
    try:
        await until(lambda: lab.member.presence.there(arm.address.key), "the parent sees its child")
        await until(lambda: yard.member.presence.there(parent.address.key), "all see the parent")
        await RobotClient(lab.member, parent.address).enslave("arm", arm.address)
        bond = (await RobotClient(hall.member, arm.address).describe()).bond
        assert bond is not None
        for epoch in (0, bond.epoch):
            forged = Call(key=f"f{epoch}", command="step", arguments={"x": 1.0}, epoch=epoch, deadline=5.0)
            answer = await ask(yard, forged, key=arm.address.key, sender=parent.address.key)
            assert isinstance(answer, NotInControl if epoch else StaleEpoch), answer
    finally:
        await parent.close()
        await arm.close()


async def test_the_machine_of_a_person_speaks_for_nobody_else(sites: dict[str, SiteOfTest]) -> None:
    anna, hall = sites["anna"], sites["hall"]
    assert await ask(anna, call()) == Done(note="moved")
    assert hall.asked[-1][1].user == "anna", "not who has an account on that machine"
    to_hall = anna.gateway.sites["hall"]
    sealed = seal(call("k2"), now=anna.gateway.now(), within=5.0)
    lie = SiteAsk(77, ROBOT, sealed.body, False, anna.gateway.now(), 0.0, "root", 1)
    assert anna.gateway.send(to_hall, lie, Lane.NORMAL)
    await until(lambda: len(hall.asked) == 2, "it has come")
    assert (hall.asked[-1][1].user, hall.asked[-1][1].site) == ("anna", "anna")


async def test_who_has_no_key_is_counted_and_told_and_has_nothing_done(
    sites: dict[str, SiteOfTest], hub: MemoryHub, caplog: pytest.LogCaptureFixture
) -> None:
    lab, hall = sites["lab"], sites["hall"]
    stream = lab.gateway.sites["hall"].stream
    assert stream is not None
    sealed = stream.session + bytes([Lane.URGENT]) + (1 << 40).to_bytes(8, "big") + bytes(60)
    # one that was due already would count as sent again, and one that is not due yet as early: of this lane
    # every later one is looked at
    expected = bytes([Lane.SAMPLES]) + (1 << 40).to_bytes(8, "big")
    foreign = Realm("plant", 9).gateway("lab")
    for number in range(1000):
        hub.inject("robotree/plant/to/hall", b"g" + foreign.greet("hall", float(number)))
        hub.inject("robotree/plant/to/hall", b"s" + sealed)
        hub.inject("robotree/plant/to/hall", b"s" + stream.session + expected + bytes(60))
        hub.inject("robotree/plant/to/hall", b"s" + bytes(90))
    refused = hall.gateway.refused
    await until(lambda: refused.total() >= 2000, "all of it was taken")
    assert sum(count for reason, count in refused.items() if "has not signed" in reason) == 1000
    assert sum(count for reason, count in refused.items() if "changed" in reason) == 1000
    assert len(refused) < 10
    assert hall.asked == []
    assert any("1000 times" in record.getMessage() for record in caplog.records), "it is in the log"
    assert await ask(lab, call()) == Done(note="moved"), "and the session goes on"
    assert len(hall.gateway._handshakes) < 64
