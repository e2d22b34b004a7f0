"""A step of which nobody knows: the controller is asked, then the page, then a person; none is repeated.

All is rehearsed: the rover with its proxy and its controller, and the driver, whose process is killed when
the rover has taken a step. Real processes of these kinds are killed in test_campaign.py.
"""

from __future__ import annotations

from typing import Literal

import pytest

from robotree.sim.controller.fence_file import FenceFile
from robotree.sim.firmware import SILENCE
from robotree.sim.kinds import KINDS
from robotree.testing import rehearse, team
from robotree.testing.parts import Stage
from robotree.testing.simulated import Simulated
from robotree.testing.team import Going, Team
from robotree.vr.base.errors import CommandCancelled, EndedInDoubt
from tests.durability.pages import Catcher, Driver, Verifier

LEG = 0.1
"""[m]"""
AWAY = 4.0
"""[s] that the driver is away; it takes half of it to drive a leg at most."""


class Rover(Simulated):
    """A rover whose controller has another life each time that it is started."""

    lives = 0

    def __init__(self) -> None:
        super().__init__("rover")

    def enter(self, team: Stage, path: str, name: str) -> None:
        super().enter(team, path, name)
        self.restart_controller()

    def restart_controller(self) -> None:
        """Have it stand at 0 and know nothing of before."""
        self.cut()
        self.world, self.lives = KINDS["rover"].world(), self.lives + 1
        memory = FenceFile(None)
        memory.life = self.lives
        self._controller = KINDS["rover"]._controller(self.world, 1, SILENCE, memory)
        self._began = self._team.now
        self.mend()

    @property
    def x(self) -> float:
        """Where it is [m]."""
        return float(self.world.rover.state().position[0])


class Road:
    """A driver on top of a rover."""

    def __init__(self, page: type[Driver] = Driver, **settings: str) -> None:
        self.rover = Rover()
        self.team: Team = rehearse(page, settings=settings, rover=self.rover)

    def lost(self, command: str = "drive", **arguments: int) -> Going:
        """Have the driver lose the result of its first leg by its own end, and the controller forget it."""
        self.team.crash(at=1, away=AWAY)
        call = self.team.start(command, within=240.0, **arguments)
        self.team.wait(AWAY / 2)
        self.rover.restart_controller()
        self.restart_proxy()
        return call

    def restart_proxy(self) -> None:
        self.team.lose("rover")
        self.rover.start_proxy("rover")

    def question(self) -> str:
        """Wait until a person is asked; return the question."""
        self.team.wait_until(lambda: "" in self.team._agents and bool(self.team.describe().asks), 60.0)
        return self.team.describe().asks

    def decide(self, answer: Literal["done", "again", "abort"]) -> None:
        self.team._do(lambda: self.team._client().decide(answer))

    def at_rest(self) -> float:
        """Return where the rover has come to rest [m]."""
        self.team.wait(2.0)
        return round(self.rover.x, 2)


def doubted(page: type[Driver] = Driver, command: str = "drive") -> tuple[Road, Going]:
    """Have a person be asked about the first leg of a drive."""
    road = Road(page, **({"verdict": "fails"} if page is Verifier else {}))
    call = road.lost(command, **({"legs": 2} if command == "drive" else {}))
    road.question()
    return road, call


def test_the_controller_tells_a_new_proxy_that_it_was_done() -> None:
    road = Road()
    road.team.crash(at=1, away=AWAY)
    call = road.team.start("drive", legs=2, within=240.0)
    road.team.wait(AWAY / 2)
    road.restart_proxy()
    assert call.result() == 2
    assert road.at_rest() == 2 * LEG


def test_a_child_that_gave_up_its_lease_is_asked_when_it_is_back() -> None:
    road = Road()
    road.team.crash(at=1, away=14.0)  # longer than the child waits
    road.team.start("drive", legs=2, within=240.0)
    road.team.wait(20.0)
    assert not road.team.describe().asks
    assert road.at_rest() == 2 * LEG


def test_a_child_that_comes_back_no_more_is_not_said_to_have_been_started_again() -> None:
    road = Road()
    road.team.crash(at=1, away=75.0)  # longer than its lease can return
    road.team.start("drive", legs=2, within=240.0)
    road.team.wait(80.0)
    asked = road.question()
    assert "the lease ended; enslave it again" in asked
    assert "started again" not in asked
    assert road.at_rest() == LEG


def test_a_controller_that_was_started_again_does_not_know_so_a_person_is_asked() -> None:
    road, call = doubted()
    asked = road.question()
    assert asked.startswith("rover.move(x=0.1, y=0.0) may have been carried out or not")
    assert "rover reads x " in asked
    assert "s ago" in asked
    assert not call.done
    road.decide("again")
    assert call.result() == 2
    assert road.at_rest() == 2 * LEG, "the controller began anew at 0"
    assert not road.team.describe().asks


def test_a_person_ends_it() -> None:
    road, call = doubted()
    road.decide("abort")
    with pytest.raises(EndedInDoubt, match="a person has ended"):
        call.result()
    assert road.at_rest() == 0.0


def test_the_question_is_asked_again_after_another_crash_of_the_host() -> None:
    road, call = doubted()
    road.team.crash()
    road.question()
    road.decide("done")
    assert call.result() == 2
    assert road.at_rest() == LEG


def test_what_is_done_again_is_known_after_another_crash() -> None:
    road, call = doubted()
    road.decide("again")
    road.team.wait_until(lambda: road.rover.x > LEG / 3)
    road.team.crash()
    assert call.result() == 2, "the proxy knows the second attempt"
    assert road.at_rest() == 2 * LEG


@pytest.mark.parametrize(("verdict", "driven"), [("done", LEG), ("not done", 2 * LEG)])
def test_the_page_verifies_and_nobody_is_asked(verdict: str, driven: float) -> None:
    road = Road(Verifier, verdict=verdict)
    assert road.lost(legs=2).result() == 2
    assert road.at_rest() == driven
    assert road.team.page.asked == ["rover.move x=0.1 at 0.0"]  # type: ignore[attr-defined]


def test_a_page_that_cannot_tell_leaves_it_to_a_person() -> None:
    road, call = doubted(Verifier)
    road.decide("done")
    assert call.result() == 2
    assert road.at_rest() == LEG


def test_a_page_that_catches_it_gets_it() -> None:
    road = Road(Catcher)
    assert road.lost(legs=2).result() == 2
    assert "rover.move may have been carried out or not" in road.team.page.caught  # type: ignore[attr-defined]
    assert road.at_rest() == LEG


def test_a_part_of_a_group_is_asked_about_too() -> None:
    road, call = doubted(command="both")
    road.decide("done")
    assert call.result() == 2


def test_without_a_crash_of_the_host_a_controller_that_restarts_leaves_it_in_doubt() -> None:
    road = Road()
    call = road.team.start("drive", legs=1, within=240.0)
    road.team.wait_until(lambda: road.rover.x > LEG / 3)
    road.rover.restart_controller()
    road.question()
    road.decide("again")
    assert call.result() == 1
    assert road.at_rest() == LEG


def test_a_cancelled_command_asks_no_longer() -> None:
    road, call = doubted()
    road.team.cancel()
    with pytest.raises(CommandCancelled):
        call.result()
    assert not road.team.describe().asks


def test_again_without_a_child_keeps_the_question() -> None:
    road, call = doubted()
    road.team.release("rover")
    road.decide("again")
    road.team.wait_until(lambda: "nothing was done" in road.team.describe().asks, 60.0)
    assert not call.done
    team = road.team
    team._do(lambda: team._client().enslave("rover", team._agents["rover"].address))
    road.decide("again")
    assert call.result() == 2
    assert road.at_rest() == 2 * LEG


def test_who_waits_behind_a_question_is_told_how_to_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(team, "OPERATOR", "anna@desk")
    road, _ = doubted()
    behind = road.team.start("drive", legs=1, within=240.0)
    road.team.wait(2.0)
    assert "it asks: `robotree decide driver done|again|abort`" in behind.progress[-1][1]
