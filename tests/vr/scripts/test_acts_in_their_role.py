"""An act begins when its partner plays the role that was given before it, however long that takes."""

from __future__ import annotations

import threading
from typing import Annotated, Any

import pytest

from robotree.vr import command
from robotree.vr.base.errors import CommandFailed
from tests.vr.scripts.stage import Companion, Stage
from tests.vr.scripts.test_script_stories import HEAD

WAVE = HEAD + "  - rule: wave\n    when: [go]\n    then: [role: {robot: child}, do: robot.wave]\n"
STOP = "  - rule: stop\n    when: [halt]\n    then: [cancel: WHAT]\n"
ENDS = (
    "  - rule: refused\n    when: [failed: {act: wave, reason: $r}]\n    then: [end: $r]\n"
    "  - rule: without\n    when: [failed: {act: play}]\n    then: [log: it plays nothing]\n"
)


class Slow(Companion):
    """A companion that takes a role when the test says so."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.asked, self.ready = threading.Event(), threading.Event()
        self.refuses = False

    @classmethod
    def kinds(cls) -> tuple[str, ...]:
        return ("Companion", *super().kinds())

    @command(effect="read")
    def play(self, role: str, at: Annotated[str, "as in RolePlayer"] = "") -> str:
        """Play a role, slowly."""
        self.asked.set()
        while not self.ready.is_set():
            self.sleep(0.005)
        if self.refuses:
            raise RuntimeError("the costume is missing")
        self.note(f"plays {role}")
        return super().play(role, at)


async def led(stage: Stage, source: str) -> tuple[Slow, Any, Any]:
    robot = Slow("c1")
    await stage.start(robot)
    script = await stage.script(source)
    await stage.enslave("guide", "robot", "c1")
    running = stage.begin("guide")
    await stage.until(lambda: script.condition == "active" and script._run.engine.happened >= 2, 60.0)
    return robot, script, running


async def test_an_act_waits_until_its_partner_plays_the_role_that_was_given_before_it(stage: Stage) -> None:
    robot, script, _ = await led(stage, WAVE)
    await stage.call("guide", "go", place="x")
    await stage.until(robot.asked.is_set, 60.0)
    await stage.until(lambda: script._run.under_way == 2, 60.0)
    assert robot.done == []
    robot.ready.set()
    await stage.until(lambda: len(robot.done) == 2, 60.0)
    assert robot.done == ["plays child", "wave with both arms"]


async def test_an_act_of_a_role_that_is_refused_fails_and_is_not_done_in_the_old_manner(stage: Stage) -> None:
    robot, _, running = await led(stage, WAVE + ENDS)
    robot.refuses = True
    robot.ready.set()
    await stage.call("guide", "go", place="x")
    assert "robot does not play the role for it: " in await running
    assert robot.done == []


async def test_a_role_that_is_refused_ends_a_script_without_a_rule_for_that(stage: Stage) -> None:
    robot, _, running = await led(stage, WAVE)
    robot.refuses = True
    robot.ready.set()
    await stage.call("guide", "go", place="x")
    with pytest.raises(CommandFailed, match=r"robot.play failed .*costume is missing.* no rule handles it"):
        await running
    assert robot.done == []


@pytest.mark.parametrize("what", ["robot", "role"])
async def test_an_act_whose_role_is_cancelled_does_not_begin(stage: Stage, what: str) -> None:
    source = (WAVE + STOP.replace("WHAT", what) + ENDS).replace("text}\n", "text}\n  halt: {}\n")
    robot, script, running = await led(stage, source)
    await stage.call("guide", "go", place="x")
    await stage.until(robot.asked.is_set, 60.0)
    await stage.until(lambda: script._run.under_way == 2, 60.0)
    await stage.call("guide", "halt")
    if what == "role":
        assert await running == "robot does not play the role for it: that was cancelled"
    else:
        await stage.until(lambda: script._run.under_way == 0, 60.0)
    robot.ready.set()
    assert robot.done == []
