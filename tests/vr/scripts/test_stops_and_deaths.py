"""A partner or a script is stopped, dies or freezes: the rules are told in bounded time, and go on or end."""

from __future__ import annotations

from typing import Any

import pytest

from robotree.vr.base.errors import CommandCancelled, CommandFailed, Stopped
from robotree.vr.base.requests import State
from robotree.vr.running.activity import CommandActivity
from robotree.vr.world.network import MemoryTransport
from tests.vr.scripts.conftest import Companion, Stage
from tests.vr.scripts.test_script_stories import GO, HEAD, led

# -- rules see that a partner is stopped and released, and begin again only then -------------------


WAITS = (
    HEAD.replace("hears:", "facts:\n  goal: {place: none, doing: no}\nhears:")
    + """\
  - rule: wish
    when: [go: {place: $p}]
    then: [remember: {goal: {place: $p}}]
  - rule: go
    when:
      - goal: {place: $p, doing: no}
        as: g
      - partner: {name: robot, state: here}
    then:
      - update g: {doing: yes}
      - do: robot.go_to
        with: {place: $p}
        as: $p
  - rule: again
    when:
      - failed: {partner: robot, conversation: $p}
      - goal: {place: $p, doing: yes}
        as: g
    then: [update g: {doing: no}]
  - rule: over
    when:
      - done: {partner: robot, conversation: $p}
      - goal: {place: $p}
        as: g
    then: [forget: g]
  - rule: hold
    when: [stopped: {partner: robot, reason: $why}]
    then: [log: "held: $why"]
  - rule: free
    when: [released: robot]
    then: [log: free]
"""
)


async def send_off(stage: Stage, robot: Companion) -> None:
    """Have the partner begin to go to the hall, where it does not arrive by itself."""
    robot.go.clear()
    await stage.call("guide", "go", place="hall")
    await stage.until(lambda: stage.agents["c1"].description().busy == "go_to")


async def test_what_was_interrupted_by_a_stop_of_the_partner_begins_again_when_it_is_released(
    stage: Stage,
) -> None:
    robot, script, running = await led(stage, WAITS)
    await send_off(stage, robot)
    await stage.client("c1").safe_stop("a child is in the way")
    await stage.until(lambda: "held: a child is in the way" in stage.lines("guide"))
    await stage.until(lambda: not stage.agents["c1"].description().busy)
    robot.go.set()
    assert "partner: {name: robot, robot: c1, state: stopped}" in await stage.call("guide", "facts")
    fired = script._run.engine.fired
    await stage.call("guide", "go", place="garden")
    await stage.until(lambda: script._run.engine.fired > fired)
    assert robot.done == [], "no rule begins anything with a partner that is stopped"
    await stage.client("guide").resume()
    await stage.until(lambda: robot.done == ["go_to hall at 0.5", "go_to garden at 0.5"])
    names = [firing.rule for firing in script._run.engine.firings]
    assert names.count("hold") == names.count("free")
    assert not running.done()


async def test_a_partner_that_is_stopped_when_the_script_starts_is_told_as_stopped(stage: Stage) -> None:
    robot, _ = await stage.companion(), await stage.script(WAITS)
    await stage.enslave("guide", "robot", "c1")
    await stage.client("c1").safe_stop("not yet")
    stage.begin("guide")
    await stage.until(lambda: "held: not yet" in stage.lines("guide"))
    await stage.call("guide", "go", place="hall")
    await stage.client("guide").resume()
    await stage.until(lambda: robot.done == ["go_to hall at 0.5"])


async def test_a_partner_whose_stop_is_not_published_yet_is_not_told_as_released(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot, script, _ = await led(stage, WAITS)
    robot.go.clear()
    await stage.call("guide", "go", place="hall")
    await stage.until(lambda: stage.agents["c1"].description().busy == "go_to", 60.0)
    published = CommandActivity.published
    before: list[State] = []

    def late(frame: CommandActivity, slot: str) -> State | None:
        """The state that was published last before the stop, as long as the test wants it."""
        return before[0] if before else published(frame, slot)

    monkeypatch.setattr(CommandActivity, "published", late)
    before.append(State(busy="go_to", stops=0))
    await stage.client("c1").safe_stop("a child is in the way")
    await stage.until(lambda: "held: a child is in the way" in stage.lines("guide"), 60.0)
    happened = script._run.engine.happened
    await stage.call("guide", "go", place="garden")
    await stage.until(lambda: script._run.engine.happened > happened, 60.0)
    robot.go.set()
    assert "state: stopped" in await stage.call("guide", "facts")
    before.clear()
    await stage.client("guide").resume()
    await stage.until(lambda: robot.done == ["go_to hall at 0.5", "go_to garden at 0.5"], 60.0)
    assert [firing.rule for firing in script._run.engine.firings].count("free") == 1


# -- a partner dies, freezes, or its answer is lost ------------------------------------------------


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


async def kill_partner(stage: Stage, script: Any) -> None:
    """Kill the process of the partner; returns when the script knows it."""
    stage.network.kill(process(stage, "c1"))
    await stage.until(lambda: script.condition == "inactive: needs robot (Companion)", within=2 * TERM)


async def test_rules_that_handle_a_killed_partner_go_on_with_the_next_one(stage: Stage) -> None:
    robot, script, running = await led(stage, GOES_ON)
    await send_off(stage, robot)
    await kill_partner(stage, script)
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
    await send_off(stage, robot)
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
    await send_off(stage, robot)
    await kill_partner(stage, script)
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
    await kill_partner(stage, script)
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
    await kill_partner(stage, script)
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


# -- a stopped script: nothing moves until a person releases it, and nothing begins by itself then -


async def test_a_stopped_script_is_over_and_its_release_starts_nothing(stage: Stage) -> None:
    robot, script, running = await led(stage, GO)
    await send_off(stage, robot)
    await stage.client("guide").safe_stop("somebody fell")
    with pytest.raises(CommandCancelled, match="somebody fell"):
        await running
    with pytest.raises(Stopped, match="somebody fell"):
        await stage.call("guide", "start")
    robot.go.set()
    await stage.client("guide").resume()
    assert script.condition == "ready"
    assert "somebody fell" in script.attributes["ended"]
    with pytest.raises(CommandFailed, match=r"it is not started; `robotree call guide.start --detach`"):
        await stage.call("guide", "go", place="hall")
    assert robot.done == [], "neither the script nor its act goes on by itself"
    stage.begin("guide")
    await stage.until(lambda: script._run is not None and script._run.engine.happened >= 2)
    await stage.call("guide", "go", place="kitchen")
    await stage.until(lambda: robot.done == ["go_to kitchen at 0.5"])
