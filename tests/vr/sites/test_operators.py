"""Operators at several sites see each other, under the names by which robots name them."""

from __future__ import annotations

import pytest

from robotree.files import replace
from robotree.vr.base.requests import OperatorHere, encode
from robotree.vr.supervision.operators import Operators
from tests.vr.policy.conftest import ME
from tests.vr.policy.test_enforced import in_force, signed, text
from tests.vr.sites.site import SiteOfTest
from tests.waiting import until


async def operators_at(site: SiteOfTest) -> Operators:
    key = f"caller/{site.keys.name}"
    await site.member.announce(key)

    async def caller() -> str:
        return key

    return Operators(site.member, caller)


def names(operators: Operators) -> set[str]:
    return {each.person for each in operators.here()}


async def test_who_is_at_another_site_is_seen_there_with_page_and_robot(sites: list[SiteOfTest]) -> None:
    lab, hall, _ = sites
    here, there, asks = await operators_at(lab), await operators_at(hall), await operators_at(sites[2])
    await here.open()
    await there.open()
    there.show("panel of arm-1", "arm-1")
    await until(lambda: f"{ME}@hall" in names(here))
    await until(lambda: any(each.page == "panel of arm-1" for each in here.here()))
    assert {f"{ME}@lab", f"{ME}@hall"} <= {each.person for each in await asks.ask()}, "a shell asks once"
    said: list[tuple[str, str]] = []
    here.on_said.append(lambda person, line: said.append((person, line)))
    await there.say("lunch")
    await until(lambda: said == [(f"{ME}@hall", "lunch")])
    await there.close()
    await until(lambda: f"{ME}@hall" not in names(here))
    for each in (here, asks):
        await each.close()


async def test_what_a_shell_says_is_heard_at_another_site_once_though_it_leaves_at_once(
    sites: list[SiteOfTest],
) -> None:
    lab, hall, _ = sites
    there = await operators_at(hall)
    await there.open()
    said: list[str] = []
    there.on_said.append(lambda _person, line: said.append(line))
    for number in range(5):
        key = f"caller/shell-{number}"
        presence = await lab.member.announce(key)

        async def caller(key: str = key) -> str:
            return key

        shell = Operators(lab.member, caller)
        assert await shell.say(f"line {number}") == (1, ())
        await presence.close()
        await shell.close()
    assert said == [f"line {number}" for number in range(5)]
    await there.close()


async def test_who_does_not_confirm_a_line_is_named(
    sites: list[SiteOfTest], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("robotree.vr.supervision.operators.CONFIRMING", 0.2)
    lab, hall, _ = sites
    here, key = await operators_at(lab), "caller/older"
    await here.open()
    await hall.member.announce(key)

    def seen() -> bool:  # by one that knows of no lines to confirm
        hall.member.publish(f"{key}/here", encode(OperatorHere(person=f"{ME}@pts/1")))
        return f"{ME}@hall" in names(here)

    await until(seen)
    assert await here.say("lunch") == (0, (f"{ME}@hall",))
    await here.close()


async def test_a_site_that_is_not_heard_is_named(sites: list[SiteOfTest]) -> None:
    lab, _, yard = sites
    here = await operators_at(lab)
    assert here.silent == ()
    await yard.gateway.close()
    await until(lambda: here.silent == ("yard",))


async def test_a_policy_keeps_back_which_robot_an_operator_looks_at(sites: list[SiteOfTest]) -> None:
    lab, hall, _ = sites
    replace(lab.keys.folder.parent / "policy.yaml", signed(lab, text(1, "see: arm-2")))
    await until(lambda: all(in_force(site) == 1 for site in sites))
    here, there = await operators_at(lab), await operators_at(hall)
    there.show("panel of arm-1", "arm-1")
    await here.open()
    await there.open()
    await until(lambda: f"{ME}@hall" in names(here))
    seen = next(each for each in here.here() if each.person == f"{ME}@hall")
    assert (seen.page, seen.robot) == ("panel", "")
    for each in (here, there):
        await each.close()
