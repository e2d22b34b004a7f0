from __future__ import annotations

import pytest

from robotree.vr.confirmation import Confirmations
from robotree.vr.errors import NoAnswer, NotConfirmed, Stopped, Unreachable


def test_all_who_confirmed_are_named_once_and_in_order() -> None:
    confirmations = Confirmations("the protective stop")
    for name in ("b", "a", "b"):
        confirmations.take(name, None)
    assert confirmations.settle() == ["a", "b"]
    assert Confirmations("the protective stop").settle() == []


def test_one_error_names_both_sides_the_reasons_and_what_to_do() -> None:
    confirmations = Confirmations("the protective stop")
    confirmations.take("a", None)
    confirmations.take("b", NoAnswer(key="robot/b/1", seconds=3.0))
    confirmations.take("c", Unreachable(key="robot/c/1"))
    for name in ("d", "e"):
        confirmations.miss(name, "process 7", "`kill -CONT 7` wakes it")
    with pytest.raises(NotConfirmed) as caught:
        confirmations.settle()
    assert str(caught.value) == (
        "the protective stop is confirmed by a but NOT by b (it did not answer); "
        "c (it ended or cannot be reached); d (in process 7, which hangs); e (in process 7, which hangs); "
        "press the emergency stop of whatever they drive, then: `kill -CONT 7` wakes it"
    )


def test_what_a_parent_tells_of_its_children_is_told_once_and_with_their_names() -> None:
    below = Confirmations("the release of the stop")
    below.take("arm", Stopped(robot="arm", reason="a hand; a foot", commander="lever"))
    below.take("rover", None)
    with pytest.raises(NotConfirmed) as inner:
        below.settle()
    above = Confirmations("the release of the stop")
    above.take("lever", inner.value)
    above.take("other", inner.value)
    with pytest.raises(NotConfirmed) as outer:
        above.settle()
    assert outer.value.data["told"] == "lever, other, rover"
    assert outer.value.data["untold"].count("arm (arm is stopped (a hand, a foot)") == 1
    assert "look at them, then release it again" in str(outer.value)


def test_what_is_no_answer_of_a_robot_is_not_taken_for_one() -> None:
    with pytest.raises(ZeroDivisionError):
        Confirmations("the protective stop").take("a", ZeroDivisionError())
