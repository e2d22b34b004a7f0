"""Rules see that a partner is stopped and released, and begin again only then."""

from __future__ import annotations

import pytest

from robotree.vr.base.requests import State
from robotree.vr.running.activity import CommandActivity
from tests.vr.scripts.stage import Stage
from tests.vr.scripts.test_script_stories import HEAD, led

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


async def test_what_was_interrupted_by_a_stop_of_the_partner_begins_again_when_it_is_released(
    stage: Stage,
) -> None:
    robot, script, running = await led(stage, WAITS)
    robot.go.clear()
    await stage.call("guide", "go", place="hall")
    await stage.until(lambda: stage.agents["c1"].description().busy == "go_to")
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
