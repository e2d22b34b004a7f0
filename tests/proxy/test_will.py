"""What ends a stop and a release that are wanted, and what does not, word by word."""

from __future__ import annotations

import pytest

from robotree.protocol.messages import Mode, ModeKind, Reason
from robotree.proxy.translate import Target
from robotree.proxy.will import (
    INSIST,
    RELEASE_WITHIN,
    Answer,
    ReleaseConfirmed,
    ReleaseRefused,
    ReleaseUnanswered,
    StopConfirmed,
    Will,
)

EPOCH = 5


def said(will: Will, now: float) -> list[tuple[int, int]]:
    """Which modes are asked for, and of which stop."""
    return [(message.mode, message.stops) for message in will.say(now)]


def hear(
    will: Will, mode: ModeKind, stops: int, reason: Reason = Reason.NONE, *, anew: bool = False
) -> list[Answer]:
    return will.hear(Mode(1000, EPOCH, 1000, mode, reason, stops), anew=anew, lost=anew)


@pytest.fixture
def will() -> Will:
    return Will(Target(1, 1))


@pytest.fixture
def stopped(will: Will) -> Will:
    """One whose stop, the second of its controller, is confirmed."""
    will.stop()
    assert said(will, 0.0) == [(ModeKind.SAFE_STOP, 0)]
    assert hear(will, ModeKind.SAFE_STOP, 2) == [StopConfirmed()]
    return will


def test_a_release_waits_until_its_stop_is_confirmed_and_names_it(will: Will) -> None:
    will.stop()
    said(will, 0.0)
    will.release(EPOCH, told=1, now=0.1)
    assert said(will, 0.1) == []
    assert not will.releasing
    assert hear(will, ModeKind.READY, 1) == [], "that was told before the stop was heard"
    assert said(will, INSIST) == [(ModeKind.SAFE_STOP, 0)]
    assert hear(will, ModeKind.SAFE_STOP, 2) == [StopConfirmed()]
    assert said(will, 0.5) == [(ModeKind.READY, 2)]
    assert will.releasing


@pytest.mark.parametrize("late", [ModeKind.READY, ModeKind.ACTIVE])
def test_a_word_from_before_the_stop_ends_no_release_of_it(stopped: Will, late: ModeKind) -> None:
    stopped.release(EPOCH, told=2, now=1.0)
    said(stopped, 1.0)
    assert hear(stopped, late, 1) == []
    assert said(stopped, 1.0 + INSIST) == [(ModeKind.READY, 2)]
    assert hear(stopped, late, 2) == [ReleaseConfirmed()]
    assert not stopped.stopped


def test_a_controller_that_counts_no_stops_is_believed(will: Will) -> None:
    will.stop()
    said(will, 0.0)
    will.release(EPOCH, told=0, now=0.1)
    assert hear(will, ModeKind.READY, 0) == []
    hear(will, ModeKind.SAFE_STOP, 0)
    assert said(will, 0.2) == [(ModeKind.READY, 0)]
    assert hear(will, ModeKind.READY, 0) == [ReleaseConfirmed()]


def test_a_restart_ends_the_stop_that_was_to_be_released(stopped: Will) -> None:
    stopped.release(EPOCH, told=2, now=1.0)
    stopped.opened()
    assert hear(stopped, ModeKind.READY, 1, anew=True) == [ReleaseConfirmed()]
    assert said(stopped, 2.0) == []


def test_a_release_that_is_somebody_elses_leaves_the_stop_to_them(stopped: Will) -> None:
    stopped.release(EPOCH, told=2, now=1.0)
    said(stopped, 1.0)
    assert hear(stopped, ModeKind.SAFE_STOP, 2, Reason.NOT_IN_CONTROL) == [
        ReleaseRefused(Reason.NOT_IN_CONTROL)
    ]
    hear(stopped, ModeKind.READY, 2)
    assert said(stopped, 2.0) == [], "the holder has released it, and is not stopped again from here"


@pytest.mark.parametrize("reason", [Reason.STOPPED, Reason.STALE_EPOCH, Reason.BAD_EPOCH])
def test_a_release_that_was_refused_leaves_the_stop_wanted(stopped: Will, reason: Reason) -> None:
    stopped.release(EPOCH, told=2, now=1.0)
    said(stopped, 1.0)
    assert hear(stopped, ModeKind.SAFE_STOP, 3, reason) == [ReleaseRefused(reason)]
    assert stopped.stopped
    assert said(stopped, 2.0) == []
    hear(stopped, ModeKind.READY, 3)
    assert said(stopped, 2.0) == [(ModeKind.SAFE_STOP, 0)], "somebody else has released it"


def test_a_release_that_nobody_answers_is_given_up_and_leaves_the_stop_wanted(stopped: Will) -> None:
    stopped.release(EPOCH, told=2, now=1.0)
    assert stopped.expire(1.0 + RELEASE_WITHIN - 0.01) == []
    assert stopped.expire(1.0 + RELEASE_WITHIN) == [ReleaseUnanswered()]
    assert stopped.expire(9.0) == []
    stopped.opened()
    assert said(stopped, 9.0) == [(ModeKind.SAFE_STOP, 0)]


def test_a_stop_takes_a_release_back_and_is_confirmed_anew(stopped: Will) -> None:
    stopped.release(EPOCH, told=2, now=1.0)
    said(stopped, 1.0)
    stopped.stop()
    assert said(stopped, 1.01) == [(ModeKind.SAFE_STOP, 0)]
    assert hear(stopped, ModeKind.READY, 2) == [], "the answer to the release that was taken back"
    assert said(stopped, 1.01 + INSIST) == [(ModeKind.SAFE_STOP, 0)]
    assert hear(stopped, ModeKind.SAFE_STOP, 3) == [StopConfirmed()]


@pytest.mark.parametrize("end", ["taken back", "given up"])
def test_where_a_release_was_said_the_stop_is_said_after_it_whoever_had_asked_for_it(
    will: Will, end: str
) -> None:
    hear(will, ModeKind.SAFE_STOP, 2)
    will.release(EPOCH, told=2, now=1.0)
    assert said(will, 1.0) == [(ModeKind.READY, 2)]
    if end == "taken back":
        will.take_back()
    else:
        will.expire(1.0 + RELEASE_WITHIN)
    assert said(will, 4.0) == [(ModeKind.SAFE_STOP, 0)]
    assert hear(will, ModeKind.READY, 2) == [], "the release arrived late"
    assert said(will, 5.0) == [(ModeKind.SAFE_STOP, 0)]


def test_a_release_that_never_left_makes_a_stop_of_somebody_else_not_ours(will: Will) -> None:
    hear(will, ModeKind.SAFE_STOP, 2)
    will.release(EPOCH, told=2, now=1.0)
    will.take_back()
    assert not will.stopped
    assert said(will, 4.0) == []


def test_a_release_that_never_left_does_not_hide_one_that_did(will: Will) -> None:
    hear(will, ModeKind.SAFE_STOP, 2)
    will.release(EPOCH, told=2, now=1.0)
    said(will, 1.0)
    will.release(EPOCH, told=2, now=1.1)
    will.take_back()
    assert will.stopped
