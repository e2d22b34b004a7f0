"""Nobody commands itself, over however many others, and however close they come to it."""

from __future__ import annotations

import asyncio
import itertools
from typing import Any

import pytest

from robotree.vr import Child, VirtualRobot
from robotree.vr.base.errors import CycleOfBonds

TERM = 5.0


class Box(VirtualRobot):
    """Takes anything, also another box."""

    inner = Child("Robot")


async def test_a_robot_cannot_command_its_own_ancestor(realm: Any) -> None:
    boxes = [await realm.start(Box(name)) for name in ("top", "middle", "bottom")]
    for parent, child in itertools.pairwise(boxes):
        await realm.client(parent).enslave("inner", child.address)
    with pytest.raises(CycleOfBonds, match=r"bottom cannot enslave top: .*\(top > middle > bottom\)"):
        await realm.client(boxes[2]).enslave("inner", boxes[0].address)


async def test_two_that_enslave_each_other_at_once_do_not_both_succeed(realm: Any) -> None:
    one, two = await realm.start(Box("one")), await realm.start(Box("two"))
    results = await asyncio.gather(
        realm.client(one).enslave("inner", two.address),
        realm.client(two).enslave("inner", one.address),
        return_exceptions=True,
    )
    assert any(isinstance(result, CycleOfBonds) for result in results)
    await asyncio.sleep(TERM)
    assert realm.listed() != []


async def test_a_cycle_of_three_that_closes_at_once_opens_again(realm: Any) -> None:
    boxes = [await realm.start(Box(name)) for name in ("a", "b", "c")]
    ring = zip(boxes, [*boxes[1:], boxes[0]], strict=True)
    questions = [realm.client(parent).enslave("inner", child.address) for parent, child in ring]
    await asyncio.gather(*questions, return_exceptions=True)
    await realm.until(lambda: realm.listed() != [], within=2 * TERM)
    await asyncio.sleep(TERM)
    bonds = [agent.description().bond for agent in boxes]
    assert bonds.count(None) >= 1
