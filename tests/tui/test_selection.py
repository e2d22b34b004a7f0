"""One selection: it stays on its robot, and nobody commands another one by a key that was meant for it."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from robotree.tui.seen.selection import LOOK, Selection

NAMES = st.lists(st.sampled_from("abcdefgh"), unique=True)


@given(before=NAMES.filter(bool), after=NAMES, chosen=st.integers(0, 7))
def test_it_stays_on_its_robot_or_goes_to_a_neighbour(
    before: list[str], after: list[str], chosen: int
) -> None:
    name = before[chosen % len(before)]
    selection = Selection().choose(name).among(before, after, 1.0)
    if name in after:
        assert selection.name == name
        assert selection.refusal(1.0) == ""
    else:
        below = [one for one in before[before.index(name) :] if one in after]
        assert selection.name == (below[0] if below else after[-1] if after else "")
        assert name in selection.refusal(1.0 + 0.9 * LOOK)
        assert selection.refusal(1.0 + LOOK) == ""


@given(before=NAMES.filter(bool))
def test_sorting_and_refreshing_change_nothing(before: list[str]) -> None:
    selection = Selection().choose(before[0])
    assert selection.among(before, sorted(before, reverse=True), 5.0) == selection


@given(shown=NAMES.filter(lambda names: len(names) > 1))
def test_a_filter_that_hides_the_chosen_robot_gives_it_back(shown: list[str]) -> None:
    chosen = Selection().choose(shown[0])
    hidden = chosen.among(shown, shown[1:], 1.0)
    assert hidden.name == shown[1]
    assert hidden.among(shown[1:], shown, 9.0).name == shown[0]
    assert hidden.choose(shown[1]).among(shown[1:], shown, 9.0).name == shown[1], "a person has chosen since"


def test_it_goes_to_what_was_just_made_and_the_next_key_must_have_been_pressed_after_that() -> None:
    made = Selection().choose("arm-1").go_to("mover", 10.0)
    assert made.name == "mover"
    assert made.refusal(10.0 + LOOK / 2) == "the selection has just gone from arm-1 to mover: press again"
    assert made.choose("mover").refusal(10.1) == "", "a person has put the cursor there"


def test_the_first_robot_of_all_is_no_change() -> None:
    assert Selection().among([], ["a", "b"], 1.0).refusal(1.0) == ""


def test_two_changes_in_one_moment_are_told_as_one() -> None:
    """A robot that was just made is selected before its row is there."""
    made = Selection().choose("rover-1").go_to("mover", 10.0)
    hidden = made.among(["arm-1", "rover-1"], ["arm-1", "rover-1"], 10.1)
    shown = hidden.among(["arm-1", "rover-1"], ["arm-1", "mover", "rover-1"], 10.2)
    assert shown.name == "mover"
    assert shown.refusal(10.3) == "the selection has just gone from rover-1 to mover: press again"


def test_a_robot_that_was_out_of_the_list_for_a_moment_can_be_commanded_at_once() -> None:
    away = Selection().choose("b").among(["a", "b"], ["a"], 10.0)
    assert "from b to a" in away.refusal(10.1)
    back = away.among(["a"], ["a", "b"], 10.2)
    assert (back.name, back.refusal(10.3)) == ("b", "")
