"""What ends a stop and a release that are wanted, and what does not, word by word."""

from __future__ import annotations

import pytest

from robotree.protocol.messages import Mode, ModeKind, Reason
from robotree.proxy.desired_mode import (
    RELEASE_TIMEOUT,
    REPEAT_PERIOD,
    DesiredMode,
    ModeAnswer,
    ReleaseConfirmed,
    ReleaseRefused,
    ReleaseUnanswered,
    StopConfirmed,
)
from robotree.proxy.translate import Target

EPOCH = 5


def sent(desired: DesiredMode, now: float) -> list[tuple[int, int]]:
    """Which modes are asked for, and of which stop."""
    return [(message.mode, message.stops) for message in desired.messages_due(now)]


def receive(
    desired: DesiredMode, mode: ModeKind, stops: int, reason: Reason = Reason.NONE, *, restarted: bool = False
) -> list[ModeAnswer]:
    return desired.receive(
        Mode(1000, EPOCH, 1000, mode, reason, stops), restarted=restarted, was_stopped=restarted
    )


@pytest.fixture
def desired() -> DesiredMode:
    return DesiredMode(Target(1, 1))


@pytest.fixture
def stopped(desired: DesiredMode) -> DesiredMode:
    """One whose stop, the second of its controller, is confirmed."""
    desired.stop()
    assert sent(desired, 0.0) == [(ModeKind.SAFE_STOP, 0)]
    assert receive(desired, ModeKind.SAFE_STOP, 2) == [StopConfirmed()]
    return desired


def test_a_release_waits_until_its_stop_is_confirmed_and_names_it(desired: DesiredMode) -> None:
    desired.stop()
    sent(desired, 0.0)
    desired.release(EPOCH, reported=1, now=0.1)
    assert sent(desired, 0.1) == []
    assert not desired.releasing
    assert receive(desired, ModeKind.READY, 1) == [], "that was told before the stop was heard"
    assert sent(desired, REPEAT_PERIOD) == [(ModeKind.SAFE_STOP, 0)]
    assert receive(desired, ModeKind.SAFE_STOP, 2) == [StopConfirmed()]
    assert sent(desired, 0.5) == [(ModeKind.READY, 2)]
    assert desired.releasing


@pytest.mark.parametrize("late", [ModeKind.READY, ModeKind.ACTIVE])
def test_a_word_from_before_the_stop_ends_no_release_of_it(stopped: DesiredMode, late: ModeKind) -> None:
    stopped.release(EPOCH, reported=2, now=1.0)
    sent(stopped, 1.0)
    assert receive(stopped, late, 1) == []
    assert sent(stopped, 1.0 + REPEAT_PERIOD) == [(ModeKind.READY, 2)]
    assert receive(stopped, late, 2) == [ReleaseConfirmed()]
    assert not stopped.stopped


def test_a_controller_that_counts_no_stops_is_believed(desired: DesiredMode) -> None:
    desired.stop()
    sent(desired, 0.0)
    desired.release(EPOCH, reported=0, now=0.1)
    assert receive(desired, ModeKind.READY, 0) == []
    receive(desired, ModeKind.SAFE_STOP, 0)
    assert sent(desired, 0.2) == [(ModeKind.READY, 0)]
    assert receive(desired, ModeKind.READY, 0) == [ReleaseConfirmed()]


def test_a_restart_ends_the_stop_that_was_to_be_released(stopped: DesiredMode) -> None:
    stopped.release(EPOCH, reported=2, now=1.0)
    stopped.opened()
    assert receive(stopped, ModeKind.READY, 1, restarted=True) == [ReleaseConfirmed()]
    assert sent(stopped, 2.0) == []


def test_a_release_that_is_somebody_elses_leaves_the_stop_to_them(stopped: DesiredMode) -> None:
    stopped.release(EPOCH, reported=2, now=1.0)
    sent(stopped, 1.0)
    assert receive(stopped, ModeKind.SAFE_STOP, 2, Reason.NOT_IN_CONTROL) == [
        ReleaseRefused(Reason.NOT_IN_CONTROL)
    ]
    receive(stopped, ModeKind.READY, 2)
    assert sent(stopped, 2.0) == [], "the holder has released it, and is not stopped again from here"


@pytest.mark.parametrize("reason", [Reason.STOPPED, Reason.STALE_EPOCH, Reason.BAD_EPOCH])
def test_a_release_that_was_refused_leaves_the_stop_wanted(stopped: DesiredMode, reason: Reason) -> None:
    stopped.release(EPOCH, reported=2, now=1.0)
    sent(stopped, 1.0)
    assert receive(stopped, ModeKind.SAFE_STOP, 3, reason) == [ReleaseRefused(reason)]
    assert stopped.stopped
    assert sent(stopped, 2.0) == []
    receive(stopped, ModeKind.READY, 3)
    assert sent(stopped, 2.0) == [(ModeKind.SAFE_STOP, 0)], "somebody else has released it"


def test_a_release_that_nobody_answers_is_given_up_and_leaves_the_stop_wanted(stopped: DesiredMode) -> None:
    stopped.release(EPOCH, reported=2, now=1.0)
    assert stopped.expire(1.0 + RELEASE_TIMEOUT - 0.01) == []
    assert stopped.expire(1.0 + RELEASE_TIMEOUT) == [ReleaseUnanswered()]
    assert stopped.expire(9.0) == []
    stopped.opened()
    assert sent(stopped, 9.0) == [(ModeKind.SAFE_STOP, 0)]


def test_a_stop_takes_a_release_back_and_is_confirmed_anew(stopped: DesiredMode) -> None:
    stopped.release(EPOCH, reported=2, now=1.0)
    sent(stopped, 1.0)
    stopped.stop()
    assert sent(stopped, 1.01) == [(ModeKind.SAFE_STOP, 0)]
    assert receive(stopped, ModeKind.READY, 2) == [], "the answer to the release that was taken back"
    assert sent(stopped, 1.01 + REPEAT_PERIOD) == [(ModeKind.SAFE_STOP, 0)]
    assert receive(stopped, ModeKind.SAFE_STOP, 3) == [StopConfirmed()]


@pytest.mark.parametrize("end", ["taken back", "given up"])
def test_a_withdrawn_release_that_was_sent_is_followed_by_a_stop(desired: DesiredMode, end: str) -> None:
    receive(desired, ModeKind.SAFE_STOP, 2)
    desired.release(EPOCH, reported=2, now=1.0)
    assert sent(desired, 1.0) == [(ModeKind.READY, 2)]
    if end == "taken back":
        desired.withdraw()
    else:
        desired.expire(1.0 + RELEASE_TIMEOUT)
    assert sent(desired, 4.0) == [(ModeKind.SAFE_STOP, 0)]
    assert receive(desired, ModeKind.READY, 2) == [], "the release arrived late"
    assert sent(desired, 5.0) == [(ModeKind.SAFE_STOP, 0)]


def test_a_release_that_never_left_makes_a_stop_of_somebody_else_not_ours(desired: DesiredMode) -> None:
    receive(desired, ModeKind.SAFE_STOP, 2)
    desired.release(EPOCH, reported=2, now=1.0)
    desired.withdraw()
    assert not desired.stopped
    assert sent(desired, 4.0) == []


def test_a_release_that_never_left_does_not_hide_one_that_did(desired: DesiredMode) -> None:
    receive(desired, ModeKind.SAFE_STOP, 2)
    desired.release(EPOCH, reported=2, now=1.0)
    sent(desired, 1.0)
    desired.release(EPOCH, reported=2, now=1.1)
    desired.withdraw()
    assert desired.stopped
