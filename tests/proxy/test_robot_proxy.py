"""A proxy between an agent and a controller over a real socket; the test's hand moves the controller."""

from __future__ import annotations

import asyncio
import random
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial
from typing import Any

import pytest

from robotree.protocol.links.link import Listener
from robotree.protocol.links.url import listen
from robotree.protocol.messages import (
    Goal,
    GoalState,
    Gripper,
    ModeKind,
    Reason,
    Verb,
    WayRequest,
    WayStatus,
)
from robotree.protocol.services.goal_client import GoalClient
from robotree.proxy import outcome, robot_proxy, session
from robotree.proxy.arm import Arm
from robotree.proxy.guard import Span
from robotree.proxy.robot_proxy import RobotProxy
from robotree.proxy.rover import Move, Rover
from robotree.proxy.translate import goal_key
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.author.command import command
from robotree.vr.base.errors import (
    CommandCancelled,
    CommandFailed,
    CommandInDoubt,
    DeadlineExceeded,
    NoSuchCommand,
    Stopped,
)
from robotree.vr.exchange.client import RobotClient
from robotree.vr.world.network import MemoryNetwork
from robotree.vr.world.testing import until

Controller = Any
IN_STOP = "its controller is in safe stop: somebody asked for it"
POINT = {"x": 0.3, "y": 0.1, "z": 0.4, "twist": 0.5}


class Scene:
    """One proxy with its agent, one controller, one caller."""

    def __init__(self, controller: Controller, listener: Listener, robot: RobotProxy) -> None:
        self.controller, self.listener, self.robot = controller, listener, robot
        network = MemoryNetwork()
        self.agent = RobotAgent(robot, network.join("proxy"))
        self.client = RobotClient(network.join("caller"), self.agent.address)

    @property
    def goals(self) -> list[Goal]:
        asked = [message for message in self.controller.heard if isinstance(message, Goal)]
        return [goal for goal in asked if goal.verb != Verb.STATUS]

    def begin(self, command: str, arguments: dict[str, Any], **options: Any) -> asyncio.Task[Any]:
        return asyncio.create_task(self.client.call(command, arguments, **options))

    async def moving(self) -> None:
        await until(lambda: bool(self.controller.begun), "the goal arrives")

    async def online(self) -> None:
        await until(lambda: self.robot.online, "the controller is found")


@asynccontextmanager
async def acting(
    controller: Controller, robot: Callable[[str], RobotProxy] | None = None
) -> AsyncIterator[Scene]:
    listener = await listen("tcp:127.0.0.1:0", controller.accept)
    make = robot or (lambda url: Arm("arm-1", url, chance=random.Random(1)))
    scene = Scene(controller, listener, make(listener.address))
    scene.robot.on_change = scene.agent.notify
    async with AsyncExitStack() as stack:
        stack.push_async_callback(listener.close)
        await scene.agent.start()
        tasks = [
            asyncio.create_task(scene.robot.run()),
            asyncio.create_task(controller.live(telling(controller))),
        ]
        stack.push_async_callback(_end, tasks)
        stack.push_async_callback(scene.agent.close)
        yield scene


def telling(controller: Controller) -> Callable[[], None]:
    """What a controller with an arm tells by itself."""

    def tell() -> None:
        controller.tell_tool()
        controller.tell_place()
        controller.say(Gripper(5, 0.04, 0.04, 1.0, 2))

    return tell


async def _end(tasks: list[asyncio.Task[Any]]) -> None:
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


@pytest.fixture
async def scene(make_controller: type[Controller]) -> AsyncIterator[Scene]:
    async with acting(make_controller()) as scene:
        await scene.online()
        yield scene


async def test_a_command_becomes_a_goal_with_its_key_its_epoch_and_its_time(scene: Scene) -> None:
    call = scene.begin("go_to", POINT, key="command-1", deadline=20.0)
    await scene.moving()
    scene.controller.finish(GoalState.SUCCEEDED)
    assert await call is None
    (goal,) = scene.goals
    assert goal.args[:5] == pytest.approx((0.3, 0.1, 0.4, 0.5, 0.15))
    assert goal.key == goal_key("command-1")
    assert goal.epoch == scene.agent.description().epoch > 0
    assert 18_000 < goal.ttl_ms <= 20_000


async def test_a_robot_is_real_whose_controller_does_not_say_that_it_is_a_simulation(scene: Scene) -> None:
    assert scene.agent.description().attributes["simulated"] == "no"


async def test_progress_is_passed_up(scene: Scene) -> None:
    seen: list[float] = []
    call = scene.begin("go_to", POINT, on_progress=lambda fraction, _: seen.append(fraction))
    await scene.moving()
    scene.controller.progress(0.25)
    await asyncio.sleep(0.15)
    scene.controller.progress(0.5)
    await until(lambda: 0.5 in seen, "progress arrives")
    scene.controller.finish(GoalState.SUCCEEDED)
    await call
    assert seen[-1] == 0.5
    assert seen == sorted(seen)


async def test_the_reason_of_a_refusal_reaches_the_caller(scene: Scene) -> None:
    scene.controller.refusal = (Reason.OUT_OF_REACH, "It is 0.72 m away, the arm reaches 0.60 m.")
    with pytest.raises(
        CommandFailed, match=r"arm-1\.go_to failed: It is 0\.72 m away, the arm reaches 0\.60 m$"
    ):
        await scene.client.call("go_to", POINT)


async def test_a_cancelled_command_ends_its_goal(scene: Scene) -> None:
    call = scene.begin("go_to", POINT)
    await scene.moving()
    call.cancel()
    await until(lambda: bool(scene.controller.abandoned), "the goal is abandoned")
    assert scene.controller.abandoned[0].reason == Reason.OPERATOR
    await until(lambda: not scene.agent.description().busy, "the robot is free for the next command")


async def test_halt_does_not_wait_for_the_motion_that_it_ends(scene: Scene) -> None:
    call = scene.begin("go_to", POINT)
    await scene.moving()
    halt = scene.begin("halt", {})
    await until(lambda: len(scene.controller.begun) == 2, "the halt is not queued")
    assert scene.goals[-1].verb == Verb.HOLD
    scene.controller.finish(GoalState.SUCCEEDED)
    await halt
    call.cancel()


async def test_the_old_name_of_halt_is_answered_with_the_new_one(scene: Scene) -> None:
    with pytest.raises(
        NoSuchCommand, match=r"arm-1 has no command 'stop'; it has: .*; stop is called halt now$"
    ):
        await scene.client.call("stop", {})


async def test_a_deadline_ends_the_goal_at_the_controller_too(scene: Scene) -> None:
    with pytest.raises(DeadlineExceeded):
        await scene.client.call("go_to", POINT, deadline=0.3)
    await until(lambda: bool(scene.controller.abandoned), "the goal is abandoned")


async def test_get_info_tells_the_present_moment(scene: Scene) -> None:
    info = await scene.client.call("get_info", {})
    assert info["x"] == pytest.approx(0.1)
    assert info["fz"] == pytest.approx(3.0)
    assert info["holding"] is True
    assert set(info) >= {"y", "z", "twist", "fx", "fy", "tx", "ty", "tz", "width", "busy"}


async def test_the_frame_that_a_reading_waits_for_wakes_it(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(robot_proxy, "READING_TIMEOUT", 60.0)
    async with asyncio.timeout(10.0):
        for x in (0.2, 0.3, 0.4):
            scene.controller.x = x
            info = await scene.client.call("get_info", {})
            assert info["x"] == pytest.approx(x), "it is heard after the question"


async def test_a_controller_that_has_just_come_back_is_read_before_the_robot_is_shown_as_online(
    scene: Scene,
) -> None:
    await scene.online()
    scene.robot.online = False  # the session is ahead of it by one event
    assert await scene.client.call("get_info", {})


async def test_a_dead_controller_fails_commands_at_once_and_leaves_old_readings(scene: Scene) -> None:
    await until(lambda: "x" in scene.robot.readings(), "something is known")
    await scene.listener.close()
    await until(lambda: not scene.agent.description().online, "the agent says offline")
    for name, arguments in (("go_to", POINT), ("get_info", {})):
        with pytest.raises(
            CommandFailed, match=r"controller .*; look after the controller, the proxy goes on"
        ):
            async with asyncio.timeout(10.0):
                await scene.client.call(name, arguments)
    readings = scene.robot.readings()
    assert readings["x"] == pytest.approx(0.1)
    await until(lambda: scene.robot.readings()["age"] > readings["age"], "they grow old")
    listener = await listen(scene.listener.address, scene.controller.accept)
    await until(lambda: scene.agent.description().online, "the agent says online")
    assert await scene.client.call("get_info", {})
    await listener.close()


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """A goal without an answer fails soon, and its controller counts as silent."""
    monkeypatch.setattr(session, "GoalClient", partial(GoalClient, patience=0.3))
    monkeypatch.setattr(outcome, "PERIOD", 0.1)


@pytest.mark.usefixtures("impatient")
async def test_what_adds_up_and_is_not_heard_of_any_more_is_in_doubt(
    make_controller: type[Controller],
) -> None:
    controller = make_controller()
    controller.place = (0.0, 0.0)
    async with acting(controller, lambda url: Rover("rover-1", url, chance=random.Random(1))) as scene:
        await scene.online()
        call = scene.begin("move", {"x": 0.3, "y": 0.0})
        await scene.moving()
        await scene.listener.close()
        with pytest.raises(CommandInDoubt, match="fallen silent; look whether the robot still moves"):
            await call


async def test_a_safe_stop_reaches_the_controller_and_its_release_too(scene: Scene) -> None:
    call = scene.begin("go_to", POINT)
    await scene.moving()
    await scene.client.safe_stop("somebody is in the cell")
    await until(lambda: scene.controller.mode == ModeKind.SAFE_STOP, "the controller stops")
    with pytest.raises(CommandCancelled):
        await call
    with pytest.raises(Stopped, match="somebody is in the cell"):
        await scene.client.call("go_to", POINT)
    await scene.client.resume()
    await until(lambda: scene.controller.mode == ModeKind.READY, "the controller is released")


async def test_a_stop_on_another_link_ends_what_runs_and_what_waits_until_it_is_released_there(
    scene: Scene,
) -> None:
    running, waiting = scene.begin("go_to", POINT), scene.begin("grip", {"action": "open"})
    await scene.moving()
    scene.controller.stop()
    for call in (running, waiting):
        with pytest.raises((CommandCancelled, Stopped)):
            await call
    assert scene.agent.description().stop_reason == IN_STOP
    scene.controller.release()
    await until(lambda: not scene.agent.description().stopped, "the release is told")
    call = scene.begin("hold", {})
    await until(lambda: len(scene.controller.begun) == 2, "it obeys again")
    assert [goal.verb for goal in scene.goals] == [Verb.GO_TO, Verb.HOLD], "what waited has not moved it"
    scene.controller.finish(GoalState.SUCCEEDED)
    await call


class Stepper(Rover):
    """A rover that takes steps."""

    @command
    def step(self, times: int) -> None:
        """Take the same step several times."""
        for _ in range(times):
            self.carry_out(Move(x=0.2, y=0.0, speed=0.3))


async def test_every_motion_of_a_command_moves_and_each_once_when_the_command_is_sent_again(
    make_controller: type[Controller],
) -> None:
    controller = make_controller()

    async def step(number: int) -> None:
        await until(lambda: len(controller.begun) == number, "the step is begun")
        controller.finish(GoalState.SUCCEEDED)

    async with acting(controller, lambda url: Stepper("rover-1", url)) as scene:
        await scene.online()
        lost = scene.begin("step", {"times": 3}, key="thrice", deadline=30.0)
        await step(1)
        await step(2)
        await until(lambda: len(controller.begun) == 3, "the third step is begun")
        lost.cancel()
        await until(lambda: bool(controller.abandoned), "the third step is ended")
    before = list(controller.begun)
    async with acting(controller, lambda url: Stepper("rover-1", url)) as scene:
        await scene.online()
        with pytest.raises(CommandCancelled):
            await scene.client.call("step", {"times": 3}, key="thrice", deadline=30.0)
        assert controller.begun == before, "the first two were done, the third was ended: none moves again"
        again = scene.begin("step", {"times": 2}, key="another")
        await step(4)
        await step(5)
        await again


class Thinker(Rover):
    """A rover that computes between two steps."""

    def __init__(self, name: str, url: str) -> None:
        super().__init__(name, url)
        self.decided = threading.Event()

    @command
    def ponder(self) -> None:
        """Take a step, think, take another."""
        self.carry_out(Move(x=0.2, y=0.0, speed=0.3))
        self.decided.wait(10.0)
        self.carry_out(Move(x=0.2, y=0.0, speed=0.3))


async def test_a_command_that_a_stop_has_ended_begins_no_further_motion_after_the_resume(
    make_controller: type[Controller],
) -> None:
    robots: list[Thinker] = []

    def make(url: str) -> Thinker:
        robots.append(Thinker("rover-1", url))
        return robots[0]

    async with acting(make_controller(), make) as scene:
        await scene.online()
        call = scene.begin("ponder", {})
        await scene.moving()
        scene.controller.finish(GoalState.SUCCEEDED)
        await until(lambda: robots[0].settled_at > 0.0, "the first step has ended")
        await scene.client.safe_stop("a hand in the cell")
        await scene.client.resume()
        robots[0].decided.set()
        with pytest.raises(CommandCancelled, match="a hand in the cell"):
            await call
        assert len(scene.goals) == 1


async def test_a_proxy_of_the_wrong_kind_says_so(make_controller: type[Controller]) -> None:
    async with acting(make_controller(), lambda url: Rover("rover-1", url)) as scene:
        await scene.online()
        with pytest.raises(CommandFailed, match="sends no LOCAL_POSITION_NED; is it a Rover"):
            await scene.client.call("get_info", {})


def questions(scene: Scene) -> list[WayRequest]:
    return [message for message in scene.controller.heard if isinstance(message, WayRequest)]


async def test_a_preview_is_what_the_controller_says_and_begins_nothing(scene: Scene) -> None:
    await scene.online()
    asked = scene.begin("preview_go_to", POINT)
    await until(lambda: bool(questions(scene)), "the question arrives")
    (question,) = questions(scene)
    assert question.verb == Verb.GO_TO
    assert question.args[:4] == pytest.approx((0.3, 0.1, 0.4, 0.5))
    nothing = (0.0,) * 10
    for number in (question.number + 1, question.number):  # the first answers somebody else
        way = WayStatus(
            number,
            (0.1, 0.3, *nothing),
            (0.0, 0.1, *nothing),
            (0.4, 0.4, *nothing),
            1.5,
            Reason.NONE,
            1,
            1,
            2,
            "",
        )
        scene.controller.say(way)
    told = await asked
    assert (told["checked"], told["refusal"], told["duration"]) == (True, "", 1.5)
    assert told["x"] == pytest.approx([0.1, 0.3])
    assert scene.goals == []


async def test_a_refusal_is_the_result_of_a_preview_in_the_words_of_the_controller(scene: Scene) -> None:
    await scene.online()
    asked = scene.begin("preview_go_to", POINT)
    await until(lambda: bool(questions(scene)), "the question arrives")
    number, none = questions(scene)[0].number, (0.0,) * 12
    scene.controller.say(
        WayStatus(number, none, none, none, 0.0, Reason.OUT_OF_REACH, 1, 1, 0, "It is too far away.")
    )
    assert (await asked)["refusal"] == "It is too far away"


async def test_a_preview_beyond_the_limits_asks_nobody(make_controller: type[Controller]) -> None:
    async with acting(make_controller(), lambda url: Arm("arm-1", url, {"x": Span(0.0, 0.2, "m")})) as scene:
        await scene.online()
        told = await scene.client.call("preview_go_to", POINT)
        assert told["refusal"] == "x 0.3 m is outside 0 to 0.2 m"
        assert questions(scene) == []


async def test_a_controller_that_tells_no_ways_has_only_its_limits_compared(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(robot_proxy, "READING_TIMEOUT", 0.1)
    await scene.online()
    told = await scene.client.call("preview_go_to", POINT)
    assert (told["checked"], told["refusal"], told["x"]) == (False, "", [])
