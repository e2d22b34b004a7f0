"""Operators at several sites see each other, under the names by which robots name them."""

from __future__ import annotations

import pytest

from robotree.vr.network.policy_file import put
from robotree.vr.supervision.operators import Operators
from tests.vr.policy.conftest import ME
from tests.vr.policy.test_over_sites import in_force, signed, text
from tests.vr.sites.test_gateway import SiteOfTest, hub, sites
from tests.waiting import until

__all__ = ["hub", "sites"]

pytestmark = pytest.mark.real_threads


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


async def test_a_site_that_is_not_heard_is_named(sites: list[SiteOfTest]) -> None:
    lab, _, yard = sites
    here = await operators_at(lab)
    assert here.silent == ()
    await yard.gateway.close()
    await until(lambda: here.silent == ("yard",))


async def test_a_policy_keeps_back_which_robot_an_operator_looks_at(sites: list[SiteOfTest]) -> None:
    lab, hall, _ = sites
    put(lab.keys.folder.parent / "policy.yaml", signed(lab, text(1, "see: arm-2")))
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
