"""A paused command is still paused after its host, or that of a child, was killed, and takes single steps."""

from __future__ import annotations

from typing import Any

import pytest

from robotree.testing import Page, rehearse
from robotree.testing.team import Going, Team
from robotree.vr.base.errors import CommandCancelled
from robotree.vr.exchange.client import RobotClient
from tests.durability.pages import Helper
from tests.durability.rehearsed import Arms
from tests.durability.stage import PAGES

STEPS = 6
PATIENCE = 60.0
"""[s] of virtual time."""


@pytest.fixture
def team() -> Team:
    """A tourist and its helper, each in a process of its own."""
    return rehearse(f"{PAGES}:Tourist", arm=Arms(), helper=Page(Helper, arm=Arms()))


def ordered(team: Team, order: Any) -> str:
    """Give an order to the tourist as an operator does; returns what it says."""
    client: RobotClient = team._client()
    return str(team._do(lambda: order(client)))


def paused(team: Team) -> tuple[Going, str]:
    """Begin a tour, pause it in the middle; return it, and the step before which it is."""
    tour = team.start("tour", steps=STEPS, pause=0.05, within=240.0)
    team.wait_until(lambda: bool(numbers(team)))
    ordered(team, RobotClient.pause)
    return tour, held(team)


def held(team: Team, path: str = "") -> str:
    """Wait until a robot is before a step; return it in words."""
    team.wait_until(lambda: path in team._agents and bool(team.describe(path).held), PATIENCE)
    robot = team.describe(path)
    assert robot.paused
    return robot.held


def numbers(team: Team) -> list[int]:
    return [step.arguments["n"] for step in team.steps if step.robot.endswith("arm")]


def test_a_killed_host_comes_back_paused_before_the_same_step_and_shows_its_line(team: Team) -> None:
    tour, before = paused(team)
    line = PAGES.read_text().splitlines()[int(before.rpartition(", line ")[2]) - 1]
    assert "sleep" in before
    assert line.strip() == "self.sleep(pause)"
    done = numbers(team)
    for _ in range(2):
        team.crash()
        assert held(team) == before
    team.wait(5.0)
    assert numbers(team) == done
    assert ordered(team, RobotClient.step) == f"tourist takes {before}"
    held(team)
    assert len(numbers(team)) <= len(done) + 1
    ordered(team, RobotClient.go_on)
    assert tour.result() == [STEPS, STEPS]
    assert numbers(team) == list(range(STEPS))


def test_a_cancel_of_a_paused_command_is_obeyed_after_a_kill(team: Team) -> None:
    tour, _ = paused(team)
    done = numbers(team)
    team.crash()
    held(team)
    team.cancel()
    with pytest.raises(CommandCancelled):
        tour.result()
    assert numbers(team) == done


def test_a_command_of_a_child_in_another_process_is_paused_and_outlives_both(team: Team) -> None:
    """Each of both is killed while the helper is before its step."""
    tour, _ = paused(team)
    while "helper.act" not in held(team):
        ordered(team, RobotClient.step)
        team.wait(1.0)
    ordered(team, RobotClient.step)
    before, done = held(team, "helper"), numbers(team)
    for path in ("helper", ""):
        team.crash(path)
        assert held(team, "helper") == before
    team.wait(5.0)  # the parent's next process holds the child again, and asks it
    assert numbers(team) == done
    assert ordered(team, RobotClient.step) == f"helper takes {before}"
    team.wait_until(lambda: len(numbers(team)) == len(done) + 1, PATIENCE)
    ordered(team, RobotClient.go_on)
    assert tour.result() == [STEPS, STEPS]
    assert numbers(team) == list(range(STEPS))
