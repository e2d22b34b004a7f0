"""The prompt completes what it knows, and never changes what was typed."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.tui.line.action import Where
from robotree.tui.line.actions import shapes
from robotree.tui.line.completion import Words, candidates, complete

WORDS = Words(
    {
        "NAME": ["arm-1", "mover"],
        "CHILD": ["arm-1"],
        "PARENT.SLOT": ["mover.arm"],
        "ROBOT.COMMAND": ["arm-1.go_to", "arm-1.grip"],
        "HOST": ["host-1"],
    }
)


@pytest.mark.parametrize(
    ("typed", "completed"),
    [
        ("ens", "enslave"),
        ("enslave mo", "enslave mover.arm"),
        ("enslave mover.arm a", "enslave mover.arm arm-1"),
        ("call arm-1.gr", "call arm-1.grip"),
        ("call a", "call arm-1.g"),
        ("sh", "show"),
        ("delete mo", "delete mover"),
        ("create a.py a", "create a.py as"),
        ("create a.py as b on h", "create a.py as b on host-1"),
        ("ls --vi", "ls --views"),
        ("look cell --cam", "look cell --camera"),
    ],
)
def test_the_next_word_is_suggested(typed: str, completed: str) -> None:
    assert complete(typed, WORDS) == completed


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("re", ("reload", "release", "resume", "restart", "readings")),
        ("call arm-1.g", ("arm-1.go_to", "arm-1.grip")),
        ("delete ", ("arm-1", "mover")),
        *((typed, ()) for typed in ("delete mover", "", "fly a", "delete arm-1 m", "delete zz", "ls")),
    ],
)
def test_where_there_is_a_choice_it_is_offered_whole(typed: str, offered: tuple[str, ...]) -> None:
    assert candidates(typed, WORDS) == offered
    assert complete(typed, WORDS) is None


@given(typed=st.text(max_size=30))
def test_a_suggestion_begins_with_what_was_typed(typed: str) -> None:
    found = complete(typed, WORDS)
    assert found is None or (found.startswith(typed) and len(found) > len(typed))


def test_verbs_of_two_words_and_values_of_options_are_completed() -> None:
    words = Words(
        {"NAME": ["arm-1"], "CAMERA": ["wrist"], "VIEW": ["cell"]},
        shapes(Where.SHELL),
        everywhere={"realm": "NAME", "json": ""},
    )
    assert complete("wire mo", words) == "wire monitor"
    assert complete("look cell --camera w", words) == "look cell --camera wrist"
    assert complete("rel --re", words) is None
    assert candidates("show --realm lab ", words)[:1] == ("arm-1",)


def test_parameters_are_offered_until_they_have_a_value() -> None:
    words = Words(parameters={"arm-1.go_to": ["x", "y"], "team": ["speed"]})
    assert candidates("call arm-1.go_to x=0.3 ", words)[:1] == ("y=",)
    assert complete("set team s", words) == "set team speed="
