"""Readings of children as they publish them: a loop over them, and `wait_until`."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import ClassVar

import pytest

from robotree.testing import Page, rehearse
from robotree.testing.team import Team
from robotree.vr import (
    Child,
    CommandCancelled,
    CommandFailed,
    DeadlineExceeded,
    SlotEmpty,
    VirtualRobot,
    command,
)


class Lift(VirtualRobot):
    """Goes up by 0.1 m in a second."""

    reading_units: ClassVar = {"height": "m"}

    def readings(self) -> dict[str, float]:
        """Return its height."""
        return {"height": getattr(self, "_height", 0.0)}

    @command
    def rise(self, seconds: float) -> None:
        """Go up."""
        for step in range(round(seconds / 0.05)):
            self.sleep(0.05)
            self._height = 0.005 * (step + 1)

    @command(effect="read")
    def where(self) -> float:
        """Return its height."""
        return getattr(self, "_height", 0.0)


class Watcher(VirtualRobot):
    """Watches a lift."""

    lift = Child("Lift")

    @command
    def heights(self, hz: float, seconds: float) -> list[list[float]]:
        """Return when which height was read, while the lift goes up."""
        moving = self.lift.rise.start(seconds=seconds)
        begun, found = self.now(), []
        for reading in self.lift.readings(hz=hz):
            found.append([self.now() - begun, reading.height])
            if moving.done:
                return found
        return found

    @command
    def until(self, height: float, limit: float) -> float:
        """Return after how many seconds the lift was as high, and end its motion."""
        moving = self.lift.rise.start(seconds=5)
        begun = self.now()
        self.wait_until(lambda: self.lift.readings.height >= height, within=limit)
        moving.cancel()
        return self.now() - begun

    @command
    def wait_for_height(self, height: float) -> None:
        """Wait without a limit."""
        self.wait_until(lambda: self.lift.readings["height"] >= height)

    @command
    def follow(self) -> None:
        """Read for ever."""
        for _ in self.lift.readings():
            pass

    @command
    def latest(self) -> float:
        """Return the latest height."""
        return self.lift.readings.height

    @command
    def count_steps(self) -> None:
        """Wait, ask, read three times, ask."""
        self.lift.rise.start(seconds=2)
        self.wait_until(lambda: self.lift.readings.height > 0.1)
        self.lift.where()
        for number, _ in enumerate(self.lift.readings(), 1):
            if number == 3:
                break
        self.lift.where()

    @command
    def ask_in_the_condition(self) -> None:
        """Ask in the condition."""
        self.wait_until(lambda: self.lift.where() > 0)

    @command
    def look_at_nothing(self) -> None:
        """Look at something that nobody publishes."""
        self.wait_until(lambda: False)


@pytest.fixture
def team() -> Team:
    """Return a watcher above a lift, each in a process of its own."""
    return rehearse(Watcher, lift=Page(Lift))


def keys(team: Team, name: str) -> list[str]:
    return [step.key.rpartition("/")[2] for step in team.steps if step.command == name]


def test_each_reading_is_new_and_there_are_not_more_than_asked_for(team: Team) -> None:
    quick = team.call("heights", hz=50, seconds=3)
    times = [at for at, _ in quick]
    heights = [height for _, height in quick]
    assert 20 <= len(quick) <= 32, "the lift publishes ten times a second"
    assert heights == sorted(heights)
    assert heights[-1] == pytest.approx(0.3, abs=0.02)
    slow = [at for at, _ in team.call("heights", hz=2, seconds=3)]
    assert all(later - at >= 0.5 - 1e-6 for at, later in pairwise(slow))
    assert 4 <= len(slow) <= 8
    assert len(times) > len(slow)


def test_nobody_asks_the_child_for_its_readings(team: Team) -> None:
    asked: list[str] = []
    team.world.network.on_message = lambda _source, _target, kind, _key, _body: asked.append(kind)
    team.call("until", height=0.1, limit=4)
    before = asked.count("ask")
    team.call("heights", hz=50, seconds=3)
    assert asked.count("sample") >= 30
    assert asked.count("ask") - before < 12, "the call, and renewals of the lease"


def test_the_wait_ends_when_the_child_publishes_it(team: Team) -> None:
    assert team.call("until", height=0.1, limit=4) == pytest.approx(1.1, abs=0.15)


def test_a_wait_is_one_step_and_a_reading_is_one_step(team: Team) -> None:
    team.call("count_steps")
    assert keys(team, "rise") == ["1"]
    assert keys(team, "where") == ["3", "7"]


def test_what_does_not_become_true_in_time_is_told_with_the_limit(team: Team) -> None:
    with pytest.raises(CommandFailed, match=r"TimeoutError: the condition was not true within 0\.5 s"):
        team.call("until", height=9.0, limit=0.5)
    with pytest.raises(DeadlineExceeded):
        team.call("wait_for_height", height=9.0, within=2.0)


@pytest.mark.parametrize("name", ["follow", "wait_for_height"])
@pytest.mark.parametrize(
    ("act", "error"),
    [
        (lambda team: team.cancel(), CommandCancelled),
        (lambda team: team.stop(), CommandCancelled),
        (lambda team: team.lose("lift"), SlotEmpty),
        (lambda team: team.release("lift"), SlotEmpty),
    ],
)
def test_it_ends_with_the_command_and_with_the_child(
    team: Team, name: str, act: Callable[[Team], None], error: type[Exception]
) -> None:
    going = team.start(name, **({"height": 9.0} if name == "wait_for_height" else {}))
    team.wait(1.5)
    act(team)
    team.wait(5.0)
    assert going.done
    with pytest.raises(error):
        going.result()


def test_nothing_is_taken_when_the_command_has_ended(team: Team) -> None:
    runtime = team._agents[""].runtime
    team.call("latest")
    team.wait(0.1)
    assert not any(runtime._bereft.values())
    assert not any("state" in pattern for pattern, _ in team._processes[""].transport._subscriptions.values())


def test_the_condition_calls_nothing_and_reads_something(team: Team) -> None:
    with pytest.raises(CommandFailed, match="only reads; call commands before or after it"):
        team.call("ask_in_the_condition")
    with pytest.raises(CommandFailed, match="has read no readings of a child"):
        team.call("look_at_nothing")
    assert team.call("latest") == 0.0
