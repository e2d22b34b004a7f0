"""A script leads robots: figure 4 of the NBSA paper, and what it claims of scripts and roles."""

from tests.vr.scripts.stage import EXAMPLES, Stage

GUIDE = (EXAMPLES / "guide.yaml").read_text()


async def test_a_message_goes_through_the_rules_to_the_robot_and_its_end_comes_back(stage: Stage) -> None:
    robot, script = await stage.companion(), await stage.script(GUIDE)
    assert script.condition == "inactive: needs robot (Companion)"
    running = stage.begin("guide")
    await stage.until(
        lambda: script.condition.startswith("inactive") and stage.agents["guide"].description().busy
    )
    await stage.enslave("guide", "robot", "c1")
    await stage.until(lambda: script.condition == "active" and script._run.engine.happened)
    await stage.call("guide", "person_seen", who="Anna Maria", place="kitchen")
    await stage.until(lambda: len(robot.done) == 4)
    assert robot.done == [
        "wave 1",
        "say Welcome, Anna Maria [plain]",
        "go_to kitchen at 0.5",
        "say Here is the kitchen. [plain]",
    ]
    await stage.call("guide", "finish")
    assert await running == "finished on request"
    assert script.condition == "ready"
