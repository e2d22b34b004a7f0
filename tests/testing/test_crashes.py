"""The process of a page is killed in the middle of a command, and the command goes on at its next step."""

from __future__ import annotations

import time

import pytest

from robotree.proxy.arm import Arm
from robotree.testing import Fake, Page, cell, rehearse, rehearse_seeds
from robotree.testing.team import Team
from robotree.vr import Child, CommandFailed, Failed, SlotEmpty, VirtualRobot, command, state
from robotree.vr.base.errors import Diverged
from tests.testing.pages import Careless, Crowd, Deaf, Hoist, Lift, Sending, Swallowing


class Tour(VirtualRobot):
    """Brings cups back."""

    arm = Child("Arm")
    carried: int = state(0)
    rests: float = 2.0
    gaps: list[float] = state([])

    @command
    def bring(self, rounds: int) -> int:
        for _ in range(rounds):
            self.arm.go_to(x=0.3, y=0.0, z=0.4, twist=0.0)
            self.arm.grip(action="close")
            self.carried += 1
            self.sleep(self.rests)
        return self.carried

    def on_resume(self, gap: float) -> None:
        self.gaps.append(gap)
        if gap > 8:
            raise Failed("too long ago")


class Stray(VirtualRobot):
    """Does another thing the second time."""

    arm = Child("Arm")
    lives = 0

    def __init__(self, name: str) -> None:
        super().__init__(name)
        type(self).lives += 1

    @command
    def go(self) -> None:
        self.arm.grip(action="close" if self.lives == 1 else "open")
        self.arm.grip(action="close")


ONE_ROUND = ["arm.go_to", "arm.grip"]


@pytest.mark.parametrize("at", range(1, 7))
def test_a_command_goes_on_wherever_it_crashes(at: int) -> None:
    team = rehearse(Tour, arm=Fake(Arm))
    team.crash(at=at)
    assert team.call("bring", rounds=3) == 3
    assert team.commanded.names == ONE_ROUND * 3


@pytest.mark.parametrize("after", [0.1, 0.3, 1.9, 2.5, 4.0])
def test_a_crash_comes_at_any_time(after: float) -> None:
    team = rehearse(Tour, arm=Fake(Arm, takes=1.0))
    team.crash(after=after)
    assert team.call("bring", rounds=2) == 2
    assert team.commanded.names == ONE_ROUND * 2


def test_two_crashes_one_after_the_other() -> None:
    team = rehearse(Tour, arm=Fake(Arm))
    team.crash(at=2)
    team.crash(at=3)
    assert team.call("bring", rounds=2) == 2
    assert team.commanded.names == ONE_ROUND * 2


def test_what_a_page_keeps_is_there_again_and_it_hears_how_long_it_was_away() -> None:
    team = rehearse(Tour, arm=Fake(Arm))
    team.call("bring", rounds=1)
    before = team.page
    team.crash(away=5.0)
    assert team.page is not before
    assert team.call("bring", rounds=1) == 2
    team.crash(at=6, away=7.0)
    team.call("bring", rounds=1)
    assert isinstance(team.page, Tour)
    assert [round(gap) for gap in team.page.gaps] == [7]


def test_the_page_may_end_a_command_that_was_away_for_too_long() -> None:
    team = rehearse(Tour, arm=Fake(Arm))
    team.crash(at=2, away=9.0)
    with pytest.raises(Failed, match="too long ago"):
        team.call("bring", rounds=2)
    assert team.commanded.names == ONE_ROUND


def test_who_has_called_gives_up_in_the_end() -> None:
    team = rehearse(Tour, arm=Fake(Arm))
    team.crash(at=2, away=20.0)
    with pytest.raises(CommandFailed, match="ended in the middle"):
        team.call("bring", rounds=2)


def test_a_page_that_takes_another_step_is_found_out() -> None:
    team = rehearse(Stray, arm=Fake(Arm))
    team.crash(at=2)
    with pytest.raises(Diverged, match="grip"):
        team.call("go")


def test_a_page_below_the_page_crashes_alone() -> None:
    team = rehearse(Hoist, lift=Page(Lift, arm=Fake(Arm, get_info={"z": 0.3})))
    team.crash("lift", at=2)
    before = team["lift"].robot
    team.call("twice")
    assert team["lift"].robot is not before
    assert team.commanded.of("lift.arm").names == ["lift.arm.grip", "lift.arm.go_to"] * 2


def test_a_robot_below_may_be_lost_at_the_same_moment() -> None:
    team = rehearse(Tour, arm=Fake(Arm).lose("go_to"))
    team.crash(at=1)
    with pytest.raises(SlotEmpty, match="arm"):
        team.call("bring", rounds=1)
    assert team.commanded.names == ["arm.go_to"]


def test_the_members_of_a_group_are_those_that_they_were() -> None:
    team = rehearse(Crowd, arms=[Fake(Arm), Fake(Arm)])
    team.crash(at=2)
    assert team.call("hold") == 2
    assert team.commanded.names == ["arms[0].hold", "arms[1].hold"]


def test_the_simulated_arm_moves_once() -> None:
    team = rehearse(Tour, arm=cell("arm"))
    team.crash(at=1)
    assert team.call("bring", rounds=1) == 1
    assert team.commanded.names == ONE_ROUND
    assert "the page is killed" in team.story()
    assert "the page is started again" in team.story()


# -- the laws that a page must keep under every seed, and pages that break each of them ------------


@pytest.mark.speed
def test_a_good_page_keeps_the_laws_under_100_seeds_in_two_seconds_of_processor_time() -> None:
    began = time.process_time()
    rehearse_seeds(Lift, "lift", {"height": "10 cm"}, arm=Fake(Arm, get_info={"z": 0.3}))
    assert time.process_time() - began < 4.0


def test_a_page_that_makes_a_mistake_when_a_child_fails_is_found() -> None:
    with pytest.raises(AssertionError, match="the page itself makes a mistake: AttributeError") as caught:
        rehearse_seeds(Careless, "lift", arm=Fake(Arm))
    assert "rehearse_seeds(..., seeds=[" in str(caught.value)
    assert "* arm: refuse at command" in str(caught.value)
    assert "no_such_detail" in str(caught.value)


def test_a_page_that_does_not_end_is_found() -> None:
    with pytest.raises(AssertionError, match=r"code that cannot be ended|goes on with"):
        rehearse_seeds(Swallowing, "lift", arm=Fake(Arm))


def test_a_page_that_tries_again_is_none_that_breaks_a_law() -> None:
    rehearse_seeds(Deaf, "lift", arm=Fake(Arm), seeds=50)


def test_what_a_page_has_detached_may_go_on() -> None:
    rehearse_seeds(Sending, "send", arm=Fake(Arm, takes=30.0), seeds=30)


def test_a_page_that_fails_in_peace_is_found_at_once() -> None:
    with pytest.raises(AssertionError, match=r"Lift.stumble fails though nothing goes wrong: .*'shelf'"):
        rehearse_seeds(Lift, "stumble", arm=Fake(Arm))


def test_the_seed_that_breaks_a_law_can_be_played_again() -> None:
    with pytest.raises(AssertionError) as first:
        rehearse_seeds(Careless, "lift", arm=Fake(Arm))
    seed = int(str(first.value).partition("seed ")[2].partition(":")[0])
    with pytest.raises(AssertionError) as again:
        rehearse_seeds(Careless, "lift", arm=Fake(Arm), seeds=[seed])
    assert str(again.value).splitlines()[0] == str(first.value).splitlines()[0]


def test_a_check_of_the_test_is_made_under_every_seed() -> None:
    looked: list[int] = []

    def check(team: Team) -> None:
        looked.append(len(team.commanded))

    rehearse_seeds(Lift, "lift", arm=Fake(Arm), seeds=20, check=check)
    assert len(looked) == 21

    def wrong(team: Team) -> None:
        assert len(team.commanded) == 2, "it was not lifted"

    with pytest.raises(AssertionError, match="the test's own check fails: it was not lifted"):
        rehearse_seeds(Lift, "lift", arm=Fake(Arm), seeds=20, check=wrong)
