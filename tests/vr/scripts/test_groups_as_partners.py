"""A script whose partner is a group: an act goes to each member, each answers, and it ends once."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from robotree.vr.base.errors import BrokenScript, CommandFailed
from robotree.vr.base.group import RobotGroup
from robotree.vr.network.group_file import groups_beside
from robotree.vr.network.policy_file import PolicyFile
from tests.vr.scripts.stage import Charged, Companion, Listed, Stage
from tests.waiting import until

TEAM = """
script: team
partners:
  team: {kind: Companion, count: 3}
facts:
  said: {robot: nobody, ok: no, what: none}
hears:
  go: {place: text}
  quit: {}
rules:
  - rule: go
    when: [go: {place: $p}]
    then:
      - do: team.go_to
        with: {place: $p}
  - rule: answers
    when: [answer: {partner: team, robot: $r, ok: $ok, result: $what}]
    then: [remember: {said: {robot: $r, ok: $ok, what: $what}}]
  - rule: all
    when: [done: {partner: team, act: go_to}]
    then: [log: all of them are there]
  - rule: not-all
    when: [failed: {partner: team, act: go_to, reason: $why}]
    then: [log: $why]
  - rule: one-less
    when: [lost: {partner: team, robot: $r}]
    then: [log: we have lost $r]
  - rule: whole
    priority: 1
    when: [go: {place: $p}, no partner: {name: team, state: missing}]
    then: [log: all of us go to $p]
"""


async def led(stage: Stage, source: str = TEAM) -> tuple[list[Companion], asyncio.Task[object]]:
    robots = [await stage.companion(f"c{each}") for each in (1, 2, 3)]
    script = await stage.script(source, "team")
    for each in (1, 2, 3):
        await stage.enslave("team", f"team_{each}", f"c{each}")
    running = stage.begin("team")
    await stage.until(lambda: script.condition == "active" and script._run.engine.happened >= 4)
    return robots, running


async def test_an_act_goes_to_each_member_and_ends_once_when_all_have_answered(stage: Stage) -> None:
    robots, running = await led(stage)
    robots[1].go.clear()
    await stage.call("team", "go", place="hall")
    await stage.until(lambda: robots[0].done and robots[2].done)
    assert "all of us go to hall" in stage.lines("team")
    assert "all of them are there" not in stage.lines("team"), "one of them is on its way"
    robots[1].go.set()
    await stage.until(lambda: "all of them are there" in stage.lines("team"))
    assert [robot.done for robot in robots] == [["go_to hall at 0.5"]] * 3
    facts = await stage.call("team", "facts")
    assert all(f"said: {{robot: c{each}, ok: yes" in facts for each in (1, 2, 3)), facts
    await stage.call("team", "finish")
    await running


async def test_who_does_not_do_it_is_named_and_the_others_have_done_it(stage: Stage) -> None:
    robots, running = await led(stage)
    robots[2].fails = "go_to"
    await stage.call("team", "go", place="hall")
    await stage.until(
        lambda: any(line.startswith("1 of 3 did not do it: c3: ") for line in stage.lines("team"))
    )
    assert [bool(robot.done) for robot in robots] == [True, True, False]
    facts = await stage.call("team", "facts")
    assert "said: {robot: c3, ok: no" in facts, facts
    await stage.call("team", "finish")
    await running


async def test_a_member_that_is_lost_is_left_out(stage: Stage) -> None:
    robots, running = await led(stage)
    await stage.release("team", "team_2")
    await stage.until(lambda: "we have lost c2" in stage.lines("team"))
    await stage.call("team", "go", place="hall")
    await stage.until(lambda: "all of them are there" in stage.lines("team"))
    assert [bool(robot.done) for robot in robots] == [True, False, True]
    assert "all of us go to hall" not in stage.lines("team")
    await stage.call("team", "finish")
    await running


async def test_a_failure_of_a_group_that_no_rule_handles_ends_the_script(stage: Stage) -> None:
    source = TEAM.replace("failed: {partner: team, act: go_to", "failed: {partner: team, act: wave")
    robots, running = await led(stage, source)
    robots[0].fails = "go_to"
    await stage.call("team", "go", place="hall")
    with pytest.raises(CommandFailed, match=r"team.go_to failed \(1 of 3 did not do it: c1: "):
        await running


GROUPED = """
script: pair
partners:
  pair: {kind: Companion, count: 2, group: hall, where: "battery > 30"}
rules:
  - rule: hello
    when: [start]
    then: [do: [pair, say, hello]]
  - rule: over
    when: [done: {partner: pair, act: say}]
    then: [end: both have said it]
"""
EXPERT = """
(defscript pair "A pair."
  (partner pair (kind Companion) (count 2) (group hall) (choose free) (where "battery > 30")))
(defrule hello (msg (act start)) => (do pair say hello))
(defrule over (msg (perf inform) (from pair) (act done)) => (end "both have said it"))
"""


@pytest.mark.parametrize(("source", "suffix"), [(GROUPED, ".yaml"), (EXPERT, ".clp")])
async def test_the_partners_are_chosen_among_the_members_of_a_group_of_the_realm(
    tmp_path: Path, source: str, suffix: str
) -> None:
    stage = Listed()
    stage.network.gate = PolicyFile(tmp_path)
    await stage.open()
    groups_beside(stage.network.gate).write(RobotGroup(name="hall", names=("a", "b", "low")))
    robots = {
        name: Charged(name, battery, "hall")
        for name, battery in {"a": 80.0, "b": 60.0, "low": 10.0, "stranger": 90.0}.items()
    }
    for robot in robots.values():
        await stage.start(robot)
    await stage.script(source, "pair", suffix)
    assert await stage.begin("pair") == "both have said it"
    assert [name for name, robot in robots.items() if robot.done] == ["a", "b"]
    await until(lambda: stage.agents["a"].description().bond is None, "they are free again")
    await stage.close()


@pytest.mark.parametrize(
    ("partner", "reason"),
    [
        ("{kind: Companion, group: hall}", "partner robot is of group hall: say how many"),
        ("{kind: Companion, count: 0}", "'0' is no number of robots"),
        ("{kind: Companion, count: many}", "'many' is no number of robots"),
        ("{kind: Companion, count: 2, group: '-'}", "'-'"),
    ],
)
async def test_a_group_that_cannot_be_a_partner_is_refused_with_its_place(
    stage: Stage, partner: str, reason: str
) -> None:
    with pytest.raises(BrokenScript, match=reason) as refusal:
        await stage.script(f"script: greet\npartners:\n  robot: {partner}\n", "greet")
    assert refusal.value.data["line"] == 3
