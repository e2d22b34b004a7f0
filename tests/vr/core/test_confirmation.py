from __future__ import annotations

from typing import Any

import pytest

from robotree.vr.base.errors import NoAnswer, NotConfirmed, Stopped, Unreachable, VrError
from robotree.vr.base.requests import Raised, decode_reply, encode
from robotree.vr.core.confirmation import LEAST, LONGEST, NO_ANSWER, TURN, Budget, Confirmations, unmeasured


def decode(failed: Raised) -> Raised:
    came = decode_reply(encode(failed), key="robot/lever/1")
    assert isinstance(came, Raised)
    return came


def test_all_who_confirmed_are_named_once_and_in_order() -> None:
    confirmations = Confirmations("the protective stop")
    for name in ("b", "a", "b"):
        confirmations.take(name, ())
    assert confirmations.settle() == ["a", "b"]
    assert Confirmations("the protective stop").settle() == []


def test_one_error_names_both_sides_the_reasons_and_what_to_do() -> None:
    confirmations = Confirmations("the protective stop")
    confirmations.take("a", ())
    confirmations.take("b", NoAnswer(key="robot/b/1", seconds=3.0))
    confirmations.take("c", Unreachable(key="robot/c/1"))
    for name in ("d", "e"):
        confirmations.miss(name, "in process 7, which hangs", "`kill -CONT 7` wakes it")
    with pytest.raises(NotConfirmed) as caught:
        confirmations.settle()
    assert str(caught.value) == (
        "the protective stop is confirmed by a but NOT by b (it did not answer); "
        "c (it ended or cannot be reached); d (in process 7, which hangs); e (in process 7, which hangs); "
        "press the emergency stop of whatever they drive, then: `kill -CONT 7` wakes it"
    )


def test_what_a_parent_tells_of_its_children_is_told_once_and_with_their_names() -> None:
    below = Confirmations("the resume")
    below.take("arm", Stopped(robot="arm", reason="a hand; a foot", commander="lever"))
    below.take("rover", ())
    with pytest.raises(NotConfirmed) as inner:
        below.settle()
    above = Confirmations("the resume")
    above.take("lever", inner.value)
    above.take("other", inner.value)
    with pytest.raises(NotConfirmed) as outer:
        above.settle()
    assert outer.value.data["told"] == ["lever", "other", "rover"]
    assert str(outer.value).count("arm (arm is stopped (a hand; a foot)") == 1
    assert "look at them, then resume again" in str(outer.value)


def test_words_of_people_never_make_two_robots_of_one_and_advice_comes_all_the_way_up() -> None:
    below = Confirmations("the protective stop")
    below.miss(
        "arm", "in process 7 (a; b), left, which hangs", "`kill -CONT 7` wakes it; if not, `kill -9 7`"
    )
    with pytest.raises(NotConfirmed) as inner:
        below.settle()
    over_the_network = Raised.of(inner.value)
    above = Confirmations("the protective stop")
    above.take("lever", decode(over_the_network).revive())
    with pytest.raises(NotConfirmed) as outer:
        above.settle()
    assert outer.value.data == {
        "order": "the protective stop",
        "told": ["lever"],
        "untold": [["arm", "in process 7 (a; b), left, which hangs"]],
        "advice": [*inner.value.data["advice"]],
    }
    assert str(outer.value).endswith("they drive, then: `kill -CONT 7` wakes it; if not, `kill -9 7`")


@pytest.mark.parametrize("untold", ["arm (it did not answer)", [["arm"]], [7], None])
def test_data_of_another_version_is_an_error_that_tells_it(untold: object) -> None:
    data: dict[str, Any] = {"order": "the protective stop", "told": [], "untold": untold, "advice": []}
    error = VrError.revive("NotConfirmed", data)
    assert type(error) is VrError
    assert str(untold) in str(error)


def test_what_is_no_answer_of_a_robot_is_not_taken_for_one() -> None:
    with pytest.raises(ZeroDivisionError):
        Confirmations("the protective stop").take("a", ZeroDivisionError())


def test_what_a_robot_says_itself_counts_more_than_what_its_parent_says_of_it() -> None:
    below = Confirmations("the protective stop")
    below.take("arm", NoAnswer(key="robot/arm/1", seconds=0.1))
    with pytest.raises(NotConfirmed) as hearsay:
        below.settle()
    for order in (["lever", "arm"], ["arm", "lever"]):
        above = Confirmations("the protective stop")
        for name in order:
            above.take(name, () if name == "arm" else hearsay.value)
        assert above.settle() == ["arm", "lever"]


def test_what_a_robot_says_against_itself_stands_whoever_says_else() -> None:
    own = Confirmations("the protective stop")
    own.deny("arm", "its controller has not confirmed it")
    with pytest.raises(NotConfirmed) as doubt:
        own.settle()
    above = Confirmations("the protective stop")
    above.take("lever", ["arm"])
    above.take("arm", doubt.value)
    with pytest.raises(NotConfirmed, match=r"by lever but NOT by arm \(its controller"):
        above.settle()
    assert NO_ANSWER not in str(doubt.value)


@pytest.mark.parametrize("depth", [0, 1, 7, 30, 100])
@pytest.mark.parametrize("way", [0.0001, 0.005, 0.02])
def test_every_level_hears_of_the_one_below_before_its_own_time_is_over(depth: int, way: float) -> None:
    """Whatever the level below takes of its time, its answer is there when this one waits for it."""
    within = unmeasured(3.0)
    for level in range(depth, 0, -1):
        budget = Budget(within, depth=level, round_trips=level * way)
        below = budget.below(way)
        assert below > LEAST, "there is time left at the foot of the tree"
        assert way + below < budget.wait < within
        assert within - below <= way + TURN + 1e-9, "no level keeps more than its turn"
        within = below


def test_hardware_at_the_foot_of_thirty_levels_has_almost_a_second() -> None:
    """With less, a busy machine makes a stop that all have confirmed look as if one had not."""
    within = unmeasured(3.0)
    for level in range(30, 0, -1):
        within = Budget(within, depth=level, round_trips=level * 0.001).below(0.001)
    assert Budget(within).wait > 0.9


@pytest.mark.parametrize("within", [0.0, -1.0, float("nan"), float("inf"), 1e9])
def test_a_time_that_is_none_is_as_long_as_anybody_waits(within: float) -> None:
    assert 0 < Budget(within, depth=-3).wait < LONGEST
