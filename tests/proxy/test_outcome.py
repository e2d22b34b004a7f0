"""How the end of a goal reaches the caller."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol.messages import GoalState, Reason
from robotree.protocol.services.goal_client import GoalEnded
from robotree.proxy.outcome import SENTENCES, error_of, explain, silence_in_words
from robotree.vr.base.errors import (
    CommandCancelled,
    CommandFailed,
    CommandInDoubt,
    DeadlineExceeded,
    StaleEpoch,
    VrError,
)


def ended(state: GoalState, reason: int = Reason.NONE, text: str = "") -> VrError | None:
    end = GoalEnded(1, state, reason, text)
    return error_of(end, robot="arm-1", command="go_to", epoch=7, obeyed=9)


def test_every_reason_of_the_dialect_has_a_sentence() -> None:
    assert set(SENTENCES) == set(Reason)


@pytest.mark.parametrize(
    ("state", "reason", "error"),
    [
        (GoalState.REFUSED, Reason.OUT_OF_REACH, CommandFailed),
        (GoalState.REFUSED, Reason.STALE_EPOCH, StaleEpoch),
        (GoalState.FAILED, Reason.BLOCKED, CommandFailed),
        (GoalState.CANCELLED, Reason.SUPERSEDED, CommandCancelled),
        (GoalState.EXPIRED, Reason.NONE, DeadlineExceeded),
        (GoalState.UNKNOWN, Reason.NONE, CommandInDoubt),
        (GoalState.UNKNOWN, Reason.OTHER_LIFE, CommandInDoubt),
    ],
)
def test_each_end_raises_its_error(state: GoalState, reason: Reason, error: type[VrError]) -> None:
    assert type(ended(state, reason)) is error


def test_a_goal_that_was_reached_raises_nothing() -> None:
    assert ended(GoalState.SUCCEEDED) is None


def test_the_controllers_own_sentence_reaches_the_caller() -> None:
    error = ended(GoalState.REFUSED, Reason.OUT_OF_REACH, "0.72 m from the foot is more than 0.60 m.")
    assert str(error) == "arm-1.go_to failed: 0.72 m from the foot is more than 0.60 m"


def test_a_stale_epoch_says_which_one_is_obeyed() -> None:
    assert "no longer obeys epoch 7, it is at 9" in str(ended(GoalState.REFUSED, Reason.STALE_EPOCH))


@given(state=st.sampled_from(GoalState), reason=st.integers(0, 65535), text=st.text(max_size=80))
def test_no_end_from_a_wire_is_without_a_sentence(state: GoalState, reason: int, text: str) -> None:
    error = ended(state, reason, text)
    assert (error is None) == (state == GoalState.SUCCEEDED)
    assert explain(GoalEnded(1, state, reason, text))


@pytest.mark.parametrize(
    ("acknowledged", "heard", "sentence"),
    [
        (False, 0.1, "its controller is online but answers no goals; is it a Arm? Look whether"),
        (True, 0.1, "its controller is online but reports it no more; look whether"),
        (False, 2.5, "its controller has fallen silent; look whether"),
        (True, 60.0, "its controller has fallen silent; look whether"),
    ],
)
def test_a_controller_that_is_heard_is_not_called_silent(
    *, acknowledged: bool, heard: float, sentence: str
) -> None:
    assert silence_in_words(acknowledged=acknowledged, heard=heard, kind="Arm").startswith(sentence)
