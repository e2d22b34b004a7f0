"""Each robot keeps to the policy by itself, whoever asks, by whatever program and at whatever site."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from typing import Any

import pytest

from robotree.files import replace
from robotree.vr import Child, Robot, VirtualRobot, command
from robotree.vr.base.address import Address
from robotree.vr.base.envelope import sitting_at
from robotree.vr.base.errors import BrokenScript, CommandCancelled, Denied, NotAllowed, PolicyUnusable
from robotree.vr.base.policy import Person
from robotree.vr.base.principal import Credentials, principal_of
from robotree.vr.base.requests import (
    Call,
    Cancel,
    Delete,
    Describe,
    Enslave,
    Free,
    Petition,
    ReadLog,
    Renew,
    Resume,
    SafeStop,
)
from robotree.vr.exchange.authority import Here, authorise
from robotree.vr.network.policy_file import SIGNED, PolicyFile, checked, member_of
from tests.vr.policy.conftest import ME
from tests.vr.sites.site import ROBOT, SiteOfTest, ask, call, hub, sites
from tests.waiting import until

__all__ = ["hub", "sites"]


class Rover(Robot):
    """A rover."""

    @command
    def move(self, x: float) -> None:
        """Move for x seconds."""
        self.sleep(x)

    @command
    def turn(self, x: float) -> None:
        """Turn for x seconds."""
        self.sleep(x)


class Pair(VirtualRobot):
    """Two rovers."""

    left = Child("Rover")

    @command
    def move(self, x: float) -> None:
        """Move the left one."""
        self.left.move(x=x)


@pytest.fixture
def at_a_terminal() -> Iterator[None]:
    with sitting_at("pts/3"):
        yield


def roles(*lines: str, me: str = "some") -> str:
    return f"persons: {{'{ME}': {me}, ben@lab: some}}\nroles:\n  none: {{}}\n  some:\n" + "".join(
        f"    {line}\n" for line in lines
    )


@pytest.mark.usefixtures("at_a_terminal")
async def test_a_person_may_call_what_the_policy_says_and_nothing_else(realm: Any) -> None:
    rover = await realm.start(Rover("rover-1"))
    realm.rule(roles("command: rover-1.move"))
    client = realm.client(rover)
    await client.call("move", {"x": 0.1})
    with pytest.raises(Denied) as refusal:
        await client.call("turn", {"x": 0.1})
    assert str(refusal.value) == (
        f"{ME} may not command rover-1.turn: line 7 allows command only of rover-1.move; "
        "ask who made the realm"
    )
    for forbidden in (client.describe(), client.read_log(), client.resume(), client.delete()):
        with pytest.raises(Denied):
            await forbidden
    await client.safe_stop("a hand")
    assert rover.description().stopped, "everybody may stop"


REQUESTS = (
    Describe(),
    ReadLog(),
    Call(key="k", command="move", arguments={"x": 1.0}, deadline=5.0),
    Cancel(),
    Resume(),
    Enslave(slot="left", child=Address("robot", "other", "1")),
    Free(slot="left"),
    Delete(),
)


@pytest.mark.parametrize("request_", REQUESTS, ids=lambda one: type(one).__name__)
@pytest.mark.parametrize("guest", ["eve@lab", "ben@hall", "eve", "ben"])
async def test_a_guest_sees_nothing_and_may_only_stop(realm: Any, guest: str, request_: Any) -> None:
    """Also by a program that speaks the protocol itself; the gateway of this machine says who it is."""
    pair = await realm.start(Pair("pair"))
    realm.rule(roles("see: '*'", "command: '*'", "release: '*'", "resume: '*'"))
    with pytest.raises(Denied, match=f"no line names {guest}, and a guest may only stop"):
        await realm.ask_as(guest, pair.address.key, request_)
    await realm.ask_as(guest, pair.address.key, SafeStop())
    await realm.until(lambda: pair.description().stopped)


async def test_a_role_in_a_key_is_worth_what_the_policy_says(realm: Any) -> None:
    rover = await realm.start(Rover("rover-1"))
    realm.rule(roles("see: '*'"))
    await realm.ask_as("ben@lab", rover.address.key, Describe())
    with pytest.raises(Denied):
        await realm.ask_as("ben@lab", rover.address.key, REQUESTS[2])


@pytest.mark.usefixtures("at_a_terminal")
async def test_who_may_command_a_virtual_robot_may_what_its_commands_do_below(realm: Any) -> None:
    pair = await realm.team(Pair("pair"), left=Rover("rover-1"))
    realm.rule(roles("command: pair"))
    await realm.client(pair).call("move", {"x": 0.1})
    with pytest.raises(Denied):
        await realm.client(pair.left).call("move", {"x": 0.1})


@pytest.mark.usefixtures("at_a_terminal")
async def test_nobody_puts_a_robot_on_top_of_one_that_they_may_not_command(realm: Any) -> None:
    """The child decides: it is told who asks. One command of it is not enough for a parent."""
    pair, rover = await realm.start(Pair("pair")), await realm.start(Rover("rover-1"))
    for line in ("command: pair", "command: [pair, rover-1.move]"):
        realm.rule(roles(line))
        with pytest.raises(Denied, match=f"{ME} may not command rover-1"):
            await realm.client(pair).enslave("left", rover.address)
        assert rover.description().bond is None
        assert pair.description().slots[0].child is None
    realm.rule(roles("command: rover-1"))
    with pytest.raises(Denied, match=f"{ME} may not command pair"):
        await realm.client(pair).enslave("left", rover.address)
    realm.rule(roles("command: [pair, {kind: Rover}]", "see: pair"))
    await realm.client(pair).enslave("left", rover.address)
    assert rover.description().bond.parent == pair.address


async def test_a_parent_at_another_site_needs_the_right_itself(realm: Any) -> None:
    rover = await realm.start(Rover("rover-1"))
    parent = Address("robot", "pair", "1")
    petition = Petition(parent=parent, slot="left", kind="Rover", lineage=("pair",), term=5.0)
    realm.rule(roles("command: '*'", me="none"))
    with pytest.raises(Denied, match="carl@hall may not command rover-1"):
        await realm.ask_as("carl@hall", rover.address.key, petition, sender=parent.key)
    for_anna = Petition(
        parent=parent, slot="left", kind="Rover", lineage=("pair",), term=5.0, asker=Person("eve@lab", "lab")
    )
    with pytest.raises(Denied, match="eve@lab may not command rover-1"):
        await realm.ask_as("ben@lab", rover.address.key, for_anna, sender=parent.key)
    with pytest.raises(NotAllowed, match="it speaks for pair and is not pair"):
        await realm.ask_as("ben@lab", rover.address.key, petition, sender="robot/thief/1")
    assert rover.description().bond is None


async def test_a_bond_ends_with_its_lease_when_the_right_is_withdrawn_and_nothing_else_does(
    realm: Any,
) -> None:
    rover, other = await realm.start(Rover("rover-1")), await realm.team(Pair("own"), left=Rover("rover-2"))
    parent = Address("robot", "pair", "1")
    await realm.operator.announce(parent.key)
    petition = Petition(parent=parent, slot="left", kind="Rover", lineage=("pair",), term=5.0)
    realm.rule(roles("command: rover-1", me="none"))
    granted = await realm.ask_as("ben@lab", rover.address.key, petition, sender=parent.key)
    renewal = Renew(parent=parent, epoch=granted.epoch, lineage=("pair",))
    await realm.ask_as("ben@lab", rover.address.key, renewal, sender=parent.key)
    realm.rule(roles("command: rover-7", me="none"))
    with pytest.raises(Denied):
        await realm.ask_as("ben@lab", rover.address.key, renewal, sender=parent.key)
    assert await realm.until(lambda: rover.description().bond is None) <= 5.1
    assert other.left.description().bond.parent == other.address


@pytest.mark.usefixtures("at_a_terminal")
async def test_a_command_ends_when_its_asker_loses_the_right_and_others_go_on(realm: Any) -> None:
    pair = await realm.team(Pair("pair"), left=Rover("rover-1"))
    other = await realm.start(Rover("rover-2"))
    realm.rule(roles("command: '*'"))
    mine = asyncio.create_task(realm.client(pair).call("move", {"x": 60.0}))
    kept = asyncio.create_task(realm.client(other).call("move", {"x": 20.0}))
    await realm.until(lambda: pair.left.description().busy == "move" and other.description().busy == "move")
    realm.rule(roles("command: rover-2"))
    with pytest.raises(CommandCancelled, match=r"the policy has changed: .* may not command pair\.move"):
        await mine
    assert pair.left.description().bond.parent == pair.address, "the bond is nobody's command"
    await kept


async def test_who_began_a_command_may_end_it_whatever_the_policy_says_now(realm: Any) -> None:
    rover = await realm.start(Rover("rover-1"))
    realm.rule(roles("command: rover-1.move"))
    long = Call(key="k", command="move", arguments={"x": 60.0}, deadline=90.0, oneway=True)
    await realm.ask_as("ben@lab", rover.address.key, long)
    await realm.until(lambda: rover.description().busy == "move")
    with pytest.raises(Denied):
        await realm.ask_as("eve@lab", rover.address.key, Cancel(key="k"))
    await realm.ask_as("ben@lab", rover.address.key, Cancel(key="k"))
    await realm.until(lambda: not rover.description().busy)


@pytest.mark.usefixtures("at_a_terminal")
async def test_a_policy_that_cannot_be_used_leaves_only_the_stop(realm: Any) -> None:
    rover = await realm.start(Rover("rover-1"))
    realm.gate.trouble = "the policy of the realm cannot be used"
    with pytest.raises(Denied, match="the policy of the realm cannot be used; ask who made the realm"):
        await realm.client(rover).call("move", {"x": 1})
    await realm.client(rover).safe_stop("a hand")


@pytest.mark.usefixtures("at_a_terminal")
async def test_lists_show_nothing_that_one_may_not_see(realm: Any, realm_client: Any) -> None:
    for name in ("rover-1", "rover-2"):
        await realm.start(Rover(name))
    await realm.until(lambda: len(realm_client.robots()) == 2)
    realm.rule(roles("see: rover-1"))
    assert [robot.name for robot in await realm_client.tree()] == ["rover-1"]
    assert [robot.name for robot in realm_client.robots()] == ["rover-1"]
    assert {one.key.split("/")[1] for one in realm_client.held()} == {
        "rover-1",
        "lookup",
    }
    realm.rule(roles("see: {kind: Rover}"))
    assert [robot.name for robot in await realm_client.tree()] == ["rover-1", "rover-2"]


def test_a_user_of_the_machine_cannot_choose_another_name() -> None:
    """What a process says of itself is its terminal and its robot; who it is says the kernel."""
    stranger = principal_of(Credentials(process=1, user=4_000_000_000), "robot/pair/1", "")
    with pytest.raises(NotAllowed):
        authorise(stranger, Describe(), None, Here(name="rover-1"))


# -- in a realm with keys: signed, handed on by gateways, and in force at each site ----------------


def text(version: int, *lines: str) -> str:
    return "\n".join([
        "realm: plant", f"version: {version}", f"persons: {{'{ME}@lab': some, '*@yard': none}}",
        "roles:", "  none: {resume: '*'}", "  some:", *(f"    {line}" for line in lines),
    ]) + "\n"  # fmt: skip


def signed(lab: SiteOfTest, content: str) -> bytes:
    return f"{content}{SIGNED}{lab.keys.sign_policy(content.encode()).hex()}\n".encode()


def in_force(site: SiteOfTest) -> int:
    gate = site.member.gate
    gate.refresh(asyncio.get_running_loop().time())
    return 0 if gate.policy is None else gate.policy.version


def rule(lab: SiteOfTest, content: str) -> None:
    replace(lab.keys.folder.parent / "policy.yaml", signed(lab, content))


async def test_a_policy_comes_to_each_site_and_is_kept_by_its_robots(sites: list[SiteOfTest]) -> None:
    lab, hall, _ = sites
    with sitting_at("pts/3"):
        rule(lab, text(1, "see: '*'", "command: arm-1.move"))
        await until(lambda: all(in_force(site) == 1 for site in sites))
        await ask(lab, call("k1"))
        assert [principal.site for _, principal in hall.asked] == ["lab"]
        rule(lab, text(2, "see: '*'", "command: arm-2"))
        await until(lambda: all(in_force(site) == 2 for site in sites))
        refused = await ask(lab, call("k2"))
        assert isinstance(refused, Denied)
        assert str(refused) == (
            f"{ME}@lab may not command hall:arm-1.move: line 8 allows command only of arm-2; "
            "ask who made the realm"
        )
        await ask(lab, SafeStop())
        assert isinstance(hall.asked[-1][0], SafeStop), "everybody may stop"


async def test_a_site_hears_of_no_robot_that_nobody_there_may_see(sites: list[SiteOfTest]) -> None:
    lab, hall, yard = sites
    heard: dict[str, list[bytes]] = {"lab": [], "yard": []}
    await lab.member.subscribe("robot/**", lambda _key, body: heard["lab"].append(body))
    await yard.member.subscribe("robot/**", lambda _key, body: heard["yard"].append(body))
    for line in ("see: arm-1", "see: {kind: Arm}"):
        version = 1 + in_force(lab)
        rule(lab, text(version, line))
        await until(lambda version=version: all(in_force(site) == version for site in sites))
        await until(lambda: lab.member.presence.there(ROBOT) and not yard.member.presence.there(ROBOT))
    await until(lambda: _said(hall, heard["lab"]))
    assert heard["yard"] == []


def _said(hall: SiteOfTest, heard: list[bytes]) -> bool:
    hall.member.publish(f"{ROBOT}/state", b"state")
    return bool(heard)


async def test_an_older_a_foreign_and_a_changed_policy_take_no_effect(sites: list[SiteOfTest]) -> None:
    lab, hall, yard = sites
    old, new = signed(lab, text(1, "see: '*'", "command: '*'")), signed(lab, text(2, "see: '*'"))
    replace(lab.keys.folder.parent / "policy.yaml", new)
    await until(lambda: all(in_force(site) == 2 for site in sites))
    changed = new.replace(b"see:", b"command:")
    for attack in (old, changed, text(3, "command: '*'").encode(), new[: len(new) // 2], b""):
        for site in sites:
            replace(site.keys.folder.parent / "policy.yaml", attack)
            assert in_force(site) == 2
        yard.gateway._showing.take_policy(attack)
    await until(lambda: in_force(hall) == 2)
    with sitting_at("pts/3"):
        assert isinstance(await ask(lab, call()), Denied)


async def test_a_process_that_begins_with_an_unsigned_policy_obeys_only_a_stop(
    sites: list[SiteOfTest],
) -> None:
    _, hall, _ = sites
    place = hall.keys.folder.parent
    replace(place / "policy.yaml", text(1, "see: '*'").encode())
    gate = PolicyFile(place)
    gate.refresh(0.0)
    assert gate.policy is None
    assert gate.closed
    assert "has not signed it, or it was changed since then" in gate.trouble
    assert "\n" not in gate.trouble


async def test_a_policy_of_another_realm_is_none_here(sites: list[SiteOfTest]) -> None:
    lab, _, _ = sites
    member = member_of(lab.keys.folder)
    other = text(1, "see: '*'").replace("realm: plant", "realm: other")
    with pytest.raises(PolicyUnusable, match="it is that of realm other"):
        checked(signed(lab, other), "policy.yaml", member)
    with pytest.raises(BrokenScript, match=r"policy\.yaml:1:1: "):
        checked(signed(lab, ""), "policy.yaml", member)
    checked(signed(lab, text(1, "see: '*'")), "policy.yaml", member)
