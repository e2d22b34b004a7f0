"""Gateways over a hub that loses, holds back and forges: asked at one site, answered at another."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

import msgspec
import pytest

from robotree.vr import Child, VirtualRobot, command
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.base.envelope import seal, sitting_at
from robotree.vr.base.errors import NoAnswer, NotInControl, SiteSilent, StaleEpoch
from robotree.vr.base.places import Places, site_key
from robotree.vr.base.requests import Call, DescribeGateway, Done, GatewayDescribed, SafeStop, State, encode
from robotree.vr.exchange.client import RobotClient
from robotree.vr.exchange.dispatcher import Dispatcher
from robotree.vr.sites.certificates import MemberKind
from robotree.vr.sites.frames import SiteAsk, StillSo
from robotree.vr.sites.gateway import TICK
from robotree.vr.sites.invitations import read_token, request_to_join, token_of
from robotree.vr.sites.keys import RealmKeys
from robotree.vr.sites.known import names_of_sites
from robotree.vr.sites.sealing import Lane
from robotree.vr.sites.site import GONE
from tests.vr.sites.site import ROBOT, WALL, MemoryHub, Realm, SiteOfTest, ask, call, linked
from tests.waiting import until


async def test_a_request_is_answered_and_the_robot_knows_who_asked_where(sites: list[SiteOfTest]) -> None:
    lab, hall, _ = sites
    with sitting_at("pts/3"):
        assert await ask(lab, call()) == Done(note="moved")
    ((request, principal),) = hall.asked
    assert request == call()
    assert principal.site == "lab"
    assert principal.person.endswith("@lab")
    assert principal.process == lab.member.identity.process


async def test_nobody_speaks_for_a_parent_that_is_not_at_its_site(sites: list[SiteOfTest]) -> None:
    lab, hall, yard = sites
    await yard.member.announce("robot/lever/7")
    await until(lambda: hall.member.presence.there("robot/lever/7"))
    begin = asyncio.get_running_loop().time()
    await ask(lab, call(), sender="robot/lever/7")
    assert [principal.agent for _, principal in hall.asked] == [""], "lab says that it is a robot of yard"
    assert asyncio.get_running_loop().time() - begin > 0.9, "its news might have been on the way"
    await ask(yard, call("k2"), sender="robot/lever/7")
    assert hall.asked[-1][1].agent == "robot/lever/7"


async def test_who_is_away_for_a_moment_is_seen_again_though_both_news_come_at_once(
    sites: list[SiteOfTest], hub: MemoryHub
) -> None:
    lab, hall, _ = sites
    key, stream = "robot/cup/1", hall.gateway.sites["lab"].stream
    assert stream is not None

    def confirmed() -> bool:
        """Whether lab has all news."""
        return not stream._kept[Lane.URGENT]

    for _ in range(3):
        present = await hall.member.announce(key)
        await until(lambda: lab.member.presence.there(key))
        hub.up = False
        await present.close()
        await until(lambda: key not in hall.gateway._standing.local)
        present = await hall.member.announce(key)
        await until(lambda: key in hall.gateway._standing.local)
        hub.up = True
        await until(confirmed)
        await until(lambda: key in lab.gateway.sites["hall"].keys)
        await until(lambda: lab.member.presence.there(key))
        await present.close()
        await until(lambda: not lab.member.presence.there(key))


async def test_what_is_seen_at_three_sites_runs_in_no_circle(sites: list[SiteOfTest], hub: MemoryHub) -> None:
    lab, hall, yard = sites
    heard: dict[str, list[bytes]] = {"lab": [], "yard": []}
    await lab.member.subscribe("robot/**", lambda _key, body: heard["lab"].append(body))
    await yard.member.subscribe("robot/**", lambda _key, body: heard["yard"].append(body))
    await asyncio.sleep(1)
    hall.member.publish(f"{ROBOT}/state", b"1")
    await until(lambda: all(heard.values()))
    sent = 0

    def count(_topic: str, body: bytes) -> list[bytes]:
        nonlocal sent
        sent += 1
        return [body]

    hub.on_way = count
    await asyncio.sleep(2)
    assert heard == {"lab": [b"1"], "yard": [b"1"]}
    assert sent < 60, "beats and hints only"


async def test_a_silent_site_is_not_dead_but_begins_nothing(sites: list[SiteOfTest], hub: MemoryHub) -> None:
    lab, hall, _ = sites
    hub.up = False
    await asyncio.sleep(2.2)
    refused = await ask(lab, call())
    assert isinstance(refused, SiteSilent)
    assert "hub memory is not reached" in str(refused)
    assert lab.member.presence.there(ROBOT), "silent is not dead"
    hub.up = True
    await asyncio.sleep(1)
    assert hall.asked == []
    assert await ask(lab, call()) == Done(note="moved")


async def test_after_a_long_cut_nothing_begins_late(sites: list[SiteOfTest], hub: MemoryHub) -> None:
    lab, hall, _ = sites
    hub.up = False
    begin = asyncio.get_running_loop().time()
    late = asyncio.ensure_future(ask(lab, call("late"), within=2.0))
    await asyncio.sleep(4)
    hub.up = True
    answer = await late
    assert answer is None or isinstance(answer, NoAnswer)
    assert asyncio.get_running_loop().time() - begin > 2.0, "it might have begun until then"
    await asyncio.sleep(1)
    assert hall.asked == []


async def test_a_site_that_is_gone_leaves_the_lists_and_comes_back(
    sites: list[SiteOfTest], hub: MemoryHub
) -> None:
    lab, hall, _ = sites
    hub.up = False
    await asyncio.sleep(GONE - 1)
    assert lab.member.presence.there(ROBOT)
    await until(lambda: not lab.member.presence.there(ROBOT))
    hub.up = True
    await until(lambda: lab.member.presence.there(ROBOT))
    assert await ask(lab, call()) == Done(note="moved")
    assert len(hall.asked) == 1


async def test_forged_hints_fill_no_memory(sites: list[SiteOfTest], hub: MemoryHub) -> None:
    for number in range(5000):
        hub.inject("robotree/plant/here", b"site-%d" % number)
        hub.inject("robotree/plant/to/lab", b"g" + b"x" * 100)
        hub.inject("robotree/plant/authority/join/1", b"no request")
    await asyncio.sleep(0.5)
    lab = sites[0]
    assert len(lab.gateway.sites) < 70
    assert len(lab.gateway.refused) < 70
    assert lab.gateway.refused.total() >= 5000
    assert await ask(lab, call()) == Done(note="moved")


async def test_a_reply_that_is_large_arrives_before_its_end(sites: list[SiteOfTest]) -> None:
    _, hall, yard = sites
    large = "x" * 50_000
    await hall.member.announce("robot/cell/1")
    loop = asyncio.get_running_loop()
    dispatcher = Dispatcher("cell", lambda *_: Done(note=large), now=loop.time)
    await hall.member.serve("robot/cell/1", dispatcher.take)
    await until(lambda: yard.member.presence.there("robot/cell/1"))
    for _ in range(5):
        assert (await ask(yard, call(), key="robot/cell/1")).note == large


async def test_a_stop_goes_to_each_site_once_and_names_the_one_that_is_cut_off(
    sites: list[SiteOfTest], hub: MemoryHub
) -> None:
    lab, hall, yard = sites
    stop = SafeStop(reason="test", order="o1", within=1.0)
    key = lab.gateway.address.key
    done = await ask(lab, stop, key=key)
    assert set(done.confirmed) == {"hall:arm-1", "yard:arm-1"}
    assert [sum(isinstance(one, SafeStop) for one, _ in site.asked) for site in (hall, yard)] == [1, 1]
    hub.on_way = lambda topic, body: [] if topic.endswith("/to/yard") else [body]
    refused = await ask(lab, SafeStop(reason="test", order="o2", within=1.0), key=key)
    assert refused.data["told"] == ["hall:arm-1"]
    assert [name for name, _ in refused.data["untold"]] == ["site yard"]


async def seen(site: SiteOfTest) -> GatewayDescribed:
    found = await ask(site, DescribeGateway(), key=site.gateway.address.key)
    assert isinstance(found, GatewayDescribed)
    return found


async def test_the_gateway_says_how_each_site_is_and_why_one_is_not_heard(
    sites: list[SiteOfTest], hub: MemoryHub
) -> None:
    lab, _, _ = sites
    found = await seen(lab)
    assert (found.site, found.trouble, found.out) == ("lab", "", "")
    hall, _ = found.sites
    assert (hall.name, hall.state, hall.version, hall.agents) == ("hall", "linked", "1.2.3", 1)
    assert 0 <= hall.age < 2
    assert abs(hall.clock) < 1
    hub.on_way = lambda topic, body: [] if topic.endswith("/to/yard") or b"yard" in body else [body]
    await asyncio.sleep(GONE)  # yard hears nothing of lab, and ends its session
    await until(lambda: lab.gateway.describe().sites[1].state == "silent")
    assert "has fallen silent" in lab.gateway.describe().sites[1].reason
    await asyncio.sleep(GONE)
    assert lab.gateway.describe().sites[1].state == "away"
    away = lab.gateway.describe().sites[1]
    assert "the hub is reached, and nothing comes from there" in away.reason
    assert "site yard" in away.remedy
    assert away.heard > 6
    hub.up = False
    assert "hub memory is not reached: it is cut" in lab.gateway.describe().sites[1].reason


async def test_a_robot_that_moves_is_found_at_its_new_site_whichever_news_comes_first(
    sites: list[SiteOfTest],
) -> None:
    lab, hall, yard = sites
    places = {site.keys.name: Places(site.gate.presence) for site in sites}
    assert places["lab"].site_of(ROBOT) == "hall"
    assert places["hall"].site_of(ROBOT) == ""
    loop = asyncio.get_running_loop()
    dispatcher = Dispatcher("arm-1", lambda *_: Done(note="at yard"), now=loop.time)
    await yard.member.serve(ROBOT, dispatcher.take)
    there = await yard.member.announce(ROBOT)  # while hall has it, too
    await until(lambda: places["lab"].site_of(ROBOT) == "yard")
    assert places["yard"].site_of(ROBOT) == "", "it is here"
    assert (await ask(lab, call())).note == "at yard"
    await hall.member.close()  # only now hall lets go of it
    await until(lambda: places["hall"].site_of(ROBOT) == "yard")
    await asyncio.sleep(0.3)
    assert lab.member.presence.there(ROBOT)
    assert (await ask(lab, call("k2"))).note == "at yard"
    await there.close()
    await until(lambda: not lab.member.presence.there(ROBOT))
    assert places["lab"].site_of(ROBOT) == ""


async def test_a_site_that_was_admitted_and_never_heard_is_named_by_a_stop_of_each(
    sites: list[SiteOfTest],
) -> None:
    lab, hall, _ = sites
    invitation = read_token(token_of(lab.keys.invite("cellar", "site", now=WALL)), WALL)
    packed = request_to_join(invitation, Realm(seed=9).key())
    lab.pipe.publish(f"robotree/plant/authority/join/{invitation.number}", packed)
    await until(lambda: "cellar" in [one.name for one in hall.gateway.describe().sites])
    for site in (lab, hall):
        refused = await ask(site, SafeStop(order=site.keys.name, within=1.0), key=site.gateway.address.key)
        assert [name for name, _ in refused.data["untold"]] == ["site cellar"]
    RealmKeys(lab.keys.folder).revoke("cellar")
    await until(lambda: "cellar" not in [one.name for one in hall.gateway.describe().sites])
    assert "cellar" not in names_of_sites(lab.keys.folder), "nor does a stop without a gateway name it"
    await until(lambda: not hall.member.presence.there(site_key("cellar")))


async def test_a_site_that_was_revoked_while_it_was_away_is_told_so(
    sites: list[SiteOfTest], hub: MemoryHub
) -> None:
    lab, hall, _ = sites
    hub.on_way = lambda topic, body: [] if topic.endswith("/to/hall") else [body]
    await asyncio.sleep(2 * GONE)
    assert lab.gateway.sites["hall"].stream is None
    RealmKeys(lab.keys.folder).revoke("hall")
    hub.on_way = lambda _topic, body: [body]
    await until(lambda: "was revoked" in hall.gateway.describe().out)
    assert not lab.member.presence.there(ROBOT)


async def test_states_of_idle_robots_cross_as_one_sentence(sites: list[SiteOfTest]) -> None:
    lab, hall, _ = sites
    heard: list[bytes] = []
    await lab.member.subscribe("robot/*/*/state", lambda _key, body: heard.append(body))
    body = encode(State(readings={"x": 1.0}))
    hall.gateway._see_wanted()

    async def publish() -> None:
        while True:
            hall.member.publish(f"{ROBOT}/state", body)
            await asyncio.sleep(0.25)

    publishing = asyncio.create_task(publish())
    try:
        await until(lambda: bool(heard))
        first = hall.gateway.sites["lab"].summaries
        await until(lambda: len(heard) >= 3)
        assert set(heard) == {body}
        assert first is hall.gateway.sites["lab"].summaries
        assert len(lab.gateway.sites["hall"].mirrors.still(StillSo([(1, 0)]))[1]) == 1
    finally:
        publishing.cancel()


async def test_a_certificate_that_ends_in_a_live_session_ends_it(
    sites: list[SiteOfTest], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also of a machine that does not want to know: the others look at each of their ticks."""
    lab, hall, _ = sites
    with sitting_at("pts/3"):
        assert await ask(lab, call()) == Done(note="moved")
        assert TICK <= 10.0, "so long at most it goes on"
        known = lab.gateway.sites["hall"]
        assert known.member is not None
        ends = known.member.ends
        monkeypatch.setattr(hall.keys.trust, "check", lambda *_: None)  # it goes on as if nothing were
        lab.ahead = ends - lab.wall() + 1.0
        monkeypatch.setattr(lab.gateway, "_own", msgspec.structs.replace(lab.gateway._own, ends=ends + 1e6))
        lab.gateway._tick()
        assert known.stream is None
        await until(lambda: not lab.member.presence.there(ROBOT), "its robots are not there")
        await until(lambda: any("ended" in reason for reason in lab.gateway.refused), "it comes again")
        assert known.stream is None
        lab.ahead = 0.0
        await until(
            lambda: known.stream is not None and lab.member.presence.there(ROBOT), "so it is the date"
        )
        assert await ask(lab, call("k2")) == Done(note="moved")


# -- attacks: hubs that inject, and members who lie ------------------------------------------------

MEMBERS: tuple[tuple[str, MemberKind], ...] = (("hall", "site"), ("yard", "site"), ("anna", "person"))


@pytest.fixture
async def members(place: Path, hub: MemoryHub) -> AsyncIterator[dict[str, SiteOfTest]]:
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
    members: dict[str, SiteOfTest],
) -> None:
    lab, hall, yard = members["lab"], members["hall"], members["yard"]
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


async def test_the_machine_of_a_person_speaks_for_nobody_else(members: dict[str, SiteOfTest]) -> None:
    anna, hall = members["anna"], members["hall"]
    assert await ask(anna, call()) == Done(note="moved")
    assert hall.asked[-1][1].user == "anna", "not who has an account on that machine"
    to_hall = anna.gateway.sites["hall"]
    sealed = seal(call("k2"), now=anna.gateway.now(), within=5.0)
    lie = SiteAsk(77, ROBOT, sealed.body, False, anna.gateway.now(), 0.0, "root", 1)
    assert anna.gateway.send(to_hall, lie, Lane.NORMAL)
    await until(lambda: len(hall.asked) == 2, "it has come")
    assert (hall.asked[-1][1].user, hall.asked[-1][1].site) == ("anna", "anna")


async def test_who_has_no_key_is_counted_and_told_and_has_nothing_done(
    members: dict[str, SiteOfTest], hub: MemoryHub, caplog: pytest.LogCaptureFixture
) -> None:
    lab, hall = members["lab"], members["hall"]
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
