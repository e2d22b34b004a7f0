"""A partner dies, freezes, or its answer is lost: the rules are told in bounded time, and go on or end."""

from __future__ import annotations

from robotree.vr.world.network import MemoryTransport
from tests.vr.scripts.stage import Stage
from tests.vr.scripts.test_script_stories import GO, led

TERM = 3.0
"""[s] Longest that a script may take to learn that its partner is gone: the term of a bond."""
GOES_ON = (
    GO
    + "  - rule: lost\n    when: [lost: {partner: robot, reason: $why}]\n    then: [log: $why]\n"
    + "  - rule: failed\n    when: [failed: {act: $a, reason: $why}]\n    then: [log: $why]\n"
)


def process(stage: Stage, name: str) -> MemoryTransport:
    transport = stage.agents[name].transport
    assert isinstance(transport, MemoryTransport)
    return transport


async def test_rules_that_handle_a_killed_partner_go_on_with_the_next_one(stage: Stage) -> None:
    robot, script, running = await led(stage, GOES_ON)
    robot.go.clear()
    await stage.call("guide", "go", place="hall")
    await stage.until(lambda: stage.agents["c1"].description().busy == "go_to")
    stage.network.kill(process(stage, "c1"))
    await stage.until(lambda: script.condition == "inactive: needs robot (Companion)", within=2 * TERM)
    robot.go.set()
    other = await stage.companion("c2")
    await stage.enslave("guide", "robot", "c2")
    await stage.until(lambda: script.condition == "active")
    await stage.call("guide", "go", place="kitchen")
    await stage.until(lambda: other.done == ["go_to kitchen at 0.5"])
    assert not running.done()


async def test_a_partner_behind_a_cut_cable_obeys_nobody_and_the_script_is_told(stage: Stage) -> None:
    robot, script, _ = await led(stage, GOES_ON)
    stage.network.cut(process(stage, "guide"), process(stage, "c1"))
    await stage.until(lambda: script.condition == "inactive: needs robot (Companion)", within=3 * TERM)
    await stage.call("guide", "go", place="hall")
    await stage.until(lambda: "failed" in [firing.rule for firing in script._run.engine.firings])
    assert robot.done == []
    stage.network.heal(process(stage, "guide"), process(stage, "c1"))


async def test_a_script_whose_host_is_killed_leaves_no_partner_at_work(stage: Stage) -> None:
    robot, _, running = await led(stage)
    robot.go.clear()
    await stage.call("guide", "go", place="hall")
    await stage.until(lambda: stage.agents["c1"].description().busy == "go_to")
    stage.network.kill(process(stage, "guide"))
    await stage.until(lambda: not stage.agents["c1"].description().busy, within=3 * TERM)
    assert robot.done == [], "what it had begun was cancelled"
    await stage.until(lambda: stage.agents["c1"].description().bond is None, within=3 * TERM)
    running.cancel()


RETURNS = GOES_ON.replace("  robot: Companion\n", "  robot: {kind: Companion, return: 5 min}\n") + (
    "  - rule: back\n    when: [found: robot]\n    then: [log: it is back]\n"
)


async def test_a_partner_whose_process_is_started_anew_in_time_is_bound_again_and_moves_by_a_rule_only(
    stage: Stage,
) -> None:
    robot, script, running = await led(stage, RETURNS)
    robot.go.clear()
    await stage.call("guide", "go", place="hall")
    await stage.until(lambda: stage.agents["c1"].description().busy == "go_to")
    stage.network.kill(process(stage, "c1"))
    await stage.until(lambda: script.condition == "inactive: needs robot (Companion)", within=2 * TERM)
    robot.go.set()
    other = await stage.companion("c1")
    await stage.until(lambda: script.condition == "active" and "it is back" in stage.lines("guide"))
    assert other.done == [], "what it did before does not begin again by itself"
    await stage.call("guide", "go", place="kitchen")
    await stage.until(lambda: other.done == ["go_to kitchen at 0.5"])
    assert not running.done()


async def test_a_partner_that_somebody_has_used_since_it_was_started_anew_is_left_to_him(
    stage: Stage,
) -> None:
    _, script, running = await led(stage, RETURNS)
    stage.network.kill(process(stage, "c1"))
    await stage.until(lambda: script.condition == "inactive: needs robot (Companion)", within=2 * TERM)
    agents = stage.agents["guide"]
    stage.network.pause(process(stage, "guide"))
    other = await stage.companion("c1")
    await stage.call("c1", "go_to", place="garden")
    stage.network.resume(process(stage, "guide"))
    await stage.until(lambda: not agents._children._returning)
    assert script.condition == "inactive: needs robot (Companion)"
    assert other.done == ["go_to garden at 0.5"]
    assert not running.done()


async def test_a_partner_without_a_stated_time_does_not_come_back_as_another_incarnation(
    stage: Stage,
) -> None:
    _, script, _ = await led(stage, GOES_ON)
    stage.network.kill(process(stage, "c1"))
    await stage.until(lambda: script.condition == "inactive: needs robot (Companion)", within=2 * TERM)
    await stage.companion("c1")
    await stage.until(lambda: not stage.agents["guide"]._children._returning)
    assert script.condition == "inactive: needs robot (Companion)"


async def test_a_partner_that_hung_for_longer_than_its_lease_is_bound_again_by_the_script(
    stage: Stage,
) -> None:
    robot, script, running = await led(stage, RETURNS)
    stage.network.pause(process(stage, "c1"))
    await stage.until(lambda: script.condition == "inactive: needs robot (Companion)", within=3 * TERM)
    await stage.until(lambda: script._run.engine.firings[-1].rule == "lost")
    stage.network.resume(process(stage, "c1"))
    await stage.until(lambda: script.condition == "active")
    assert robot.done == []
    await stage.call("guide", "go", place="hall")
    await stage.until(lambda: robot.done == ["go_to hall at 0.5"])
    assert not running.done()
