"""Rules see that a partner is stopped and released, and begin again only then."""

from __future__ import annotations

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
    await stage.until(lambda: script._run.last_log == "held: a child is in the way")
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
    robot, script = await stage.companion(), await stage.script(WAITS)
    await stage.enslave("guide", "robot", "c1")
    await stage.client("c1").safe_stop("not yet")
    stage.begin("guide")
    await stage.until(lambda: script._run is not None and script._run.last_log == "held: not yet")
    await stage.call("guide", "go", place="hall")
    await stage.client("guide").resume()
    await stage.until(lambda: robot.done == ["go_to hall at 0.5"])
