"""A policy in a realm with keys: signed, handed on by gateways, and in force at each site."""

from __future__ import annotations

import asyncio

import pytest

from robotree.files import replace
from robotree.vr.base.envelope import sitting_at
from robotree.vr.base.errors import BrokenScript, Denied, PolicyUnusable
from robotree.vr.base.requests import SafeStop
from robotree.vr.network.policy_file import SIGNED, PolicyFile, checked, member_of
from tests.vr.policy.conftest import ME
from tests.vr.sites.site import ROBOT, SiteOfTest, ask, call, hub, sites
from tests.waiting import until

__all__ = ["hub", "sites"]


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
