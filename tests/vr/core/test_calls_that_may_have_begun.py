"""A parent's call that ends at once is answered with one message; else what was sent may have begun."""

from __future__ import annotations

from typing import Any

import pytest

from robotree.vr import Child, VirtualRobot, VrError, command
from robotree.vr.base.requests import Call, Progress
from robotree.vr.running.child_call import ChildCall
from robotree.vr.running.robot_runtime import RobotRuntime
from tests.vr.core.crew import Rover

A_WHILE = 1.0


class Asker(VirtualRobot):
    """Calls its child and says what came of it."""

    left = Child("Rover")

    @command
    def ask(self, x: float) -> str:
        """Have the child move."""
        try:
            self.left.move(x=x)
        except VrError as error:
            return type(error).__name__
        return "moved"

    @command
    def look(self) -> str:
        """Have the child look, which changes nothing."""
        try:
            self.left.get_info()
        except VrError as error:
            return type(error).__name__
        return "looked"

    @command
    def send(self) -> None:
        """Have the child move and go on after this."""
        self.left.move.start(x=1).detach()


@pytest.fixture
def replies(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What the calls of children in other processes are answered with, without progress."""
    found: list[str] = []
    take = ChildCall.take_reply

    def noted(call: ChildCall, reply: Any) -> None:
        if reply is not None and not isinstance(reply, Progress):
            found.append(type(reply).__name__)
        take(call, reply)

    monkeypatch.setattr(ChildCall, "take_reply", noted)
    return found


async def test_what_ends_at_once_is_answered_with_one_message(realm: Any, replies: list[str]) -> None:
    asker = await realm.team(Asker("asker"), left=Rover("rover"))
    assert await realm.client(asker).call("look", {}) == "looked"
    assert replies == ["Returned"]


async def test_what_takes_longer_is_accepted_first(realm: Any, replies: list[str]) -> None:
    asker = await realm.team(Asker("asker"), left=Rover("rover"))
    assert await realm.client(asker).call("ask", {"x": A_WHILE}) == "moved"
    assert replies == ["Accepted", "Returned"]


async def test_what_is_to_go_on_alone_waits_until_the_child_has_it(realm: Any, replies: list[str]) -> None:
    asker = await realm.team(Asker("asker"), left=Rover("rover"))
    await realm.client(asker).call("send", {})
    assert replies == ["Accepted"]
    await realm.until(lambda: asker.left.robot.x == pytest.approx(1))


async def test_a_motion_whose_robot_dies_before_it_says_anything_may_have_begun(
    realm: Any, replies: list[str]
) -> None:
    asker = await realm.team(Asker("asker"), left=Rover("rover"))
    rover = asker.left
    realm.runner.at(realm.runner.now() + 0.02, lambda: realm.kill(rover))
    assert await realm.client(asker).call("ask", {"x": A_WHILE}) in {"CommandInDoubt", "SlotEmpty"}
    assert replies == []
    assert rover.robot.keys, "it had begun"


@pytest.mark.parametrize(
    ("command", "after", "error"),
    [
        ("ask", 0.02, "CommandInDoubt"),
        ("ask", 0.0, "Unreachable"),  # nobody serves the key: nothing has left
        ("look", 0.02, "Unreachable"),  # to ask again changes nothing
    ],
)
async def test_what_is_lost_on_its_way_is_in_doubt_if_it_moves(
    realm: Any, monkeypatch: pytest.MonkeyPatch, command: str, after: float, error: str
) -> None:
    asker = await realm.team(Asker("asker"), left=Rover("rover"))
    ask = RobotRuntime.ask

    def lost(runtime: RobotRuntime, key: str, request: Any, on_reply: Any, **options: Any) -> None:
        if not isinstance(request, Call):
            ask(runtime, key, request, on_reply, **options)
        elif after:
            realm.runner.at(realm.runner.now() + after, lambda: on_reply(None))
        else:
            on_reply(None)

    monkeypatch.setattr(RobotRuntime, "ask", lost)
    given = {"x": A_WHILE} if command == "ask" else {}
    assert await realm.client(asker).call(command, given) == error
