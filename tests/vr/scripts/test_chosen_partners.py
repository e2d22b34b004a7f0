"""Scripts choose their partners while they lead, and release them when they are over."""

from __future__ import annotations

import pytest

from robotree.vr.base.errors import BrokenScript
from tests.vr.scripts.stage import Charged, Listed
from tests.waiting import until

SCRIPT = """
script: greet
partners:
  robot: {kind: Companion, needs: [say], choose: free, where: "battery > 30 and near hall", returns: 5 s}
rules:
  - rule: hello
    when: [start]
    then: [do: [robot, say, hello]]
"""
EXPERT = """
(defscript greet "Greets."
  (partner robot (kind Companion) (needs say) (choose free) (where "battery > 30 and near hall")))
(defrule hello (msg (act start)) => (do robot say hello))
"""


@pytest.mark.parametrize(("source", "suffix"), [(SCRIPT, ".yaml"), (EXPERT, ".clp")])
async def test_a_partner_is_chosen_when_the_script_begins_and_free_when_it_is_over(
    listed: Listed, source: str, suffix: str
) -> None:
    low, fit = Charged("low", 10.0, "hall"), Charged("fit", 80.0, "hall")
    for robot in (low, fit, Charged("far", 90.0, "kitchen")):
        await listed.start(robot)
    await listed.script(source, "greet", suffix)
    assert listed.agents["fit"].description().bond is None
    running = listed.begin("greet")
    await until(lambda: bool(fit.done), "the chosen one says hello")
    slot = listed.agents["greet"].description().slot("robot")
    assert slot is not None
    assert slot.why.startswith("fit is free and has battery 80, place hall"), slot.why
    assert not low.done
    await listed.call("greet", "finish")
    await running
    await until(lambda: listed.agents["fit"].description().bond is None, "the partner is free again")


async def test_who_needs_a_partner_waits_until_one_fits(listed: Listed) -> None:
    robot = Charged("c1", 10.0, "hall")
    await listed.start(robot)
    await listed.script(SCRIPT, "greet")
    running = listed.begin("greet")
    lines = listed.agents["greet"].runtime.log.since
    await until(lambda: any("stays empty" in line.text for line in lines(0)), "it says why it waits")
    assert not robot.done
    robot.battery = 50.0
    await until(lambda: bool(robot.done), "it is chosen when it fits")
    await listed.call("greet", "finish")
    await running


@pytest.mark.parametrize(
    ("partner", "reason"),
    [
        ("{kind: Companion, choose: best}", "'best' is no way to choose a partner"),
        ('{kind: Companion, where: "battery > 3"}', "a partner with a where is chosen"),
        ('{kind: Companion, choose: free, where: "battery >"}', "something is missing at the end"),
    ],
)
async def test_a_choice_that_cannot_be_made_is_refused_with_its_place(
    listed: Listed, partner: str, reason: str
) -> None:
    with pytest.raises(BrokenScript, match=reason) as refusal:
        await listed.script(f"script: greet\npartners:\n  robot: {partner}\n", "greet")
    assert refusal.value.data["line"] == 3
