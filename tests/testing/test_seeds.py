"""The laws that a page must keep under every seed, and pages that break each of them."""

from __future__ import annotations

import time

import pytest

from robotree.proxy.arm import Arm
from robotree.testing import Fake, rehearse_seeds
from robotree.testing.team import Team
from tests.testing.pages import Careless, Deaf, Lift, Sending, Swallowing


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
