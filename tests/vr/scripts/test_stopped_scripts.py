"""A script and a stop: nothing moves until a person releases it, and nothing begins by itself then."""

from __future__ import annotations

import pytest

from robotree.vr.base.errors import CommandCancelled, CommandFailed, Stopped
from tests.vr.scripts.stage import Stage
from tests.vr.scripts.test_script_stories import GO, led


async def test_a_stopped_script_is_over_and_its_release_starts_nothing(stage: Stage) -> None:
    robot, script, running = await led(stage, GO)
    robot.go.clear()
    await stage.call("guide", "go", place="hall")
    await stage.until(lambda: stage.agents["c1"].description().busy == "go_to")
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
