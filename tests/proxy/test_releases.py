"""Stories of releases: refused, overtaken by a stop, of one that is not confirmed, and over bad links."""

from __future__ import annotations

from typing import Any

import pytest

from robotree.protocol.links.loopback import Faults
from robotree.protocol.messages import ModeKind, Reason, SetMode
from robotree.proxy.desired_mode import RELEASE_TIMEOUT, ReleaseConfirmed, ReleaseUnanswered
from robotree.proxy.outcome import reason_in_words
from robotree.proxy.session import OnlineChanged

Talk = Any


@pytest.mark.parametrize(("delay", "pause"), [(0.1, 0.0), (0.3, 0.05), (0.3, 0.5), (0.3, 1.0)])
def test_a_release_within_a_round_trip_of_our_own_stop_ends_that_stop(
    make_talk: type[Talk], delay: float, pause: float
) -> None:
    talk = make_talk(Faults(delay=delay))
    talk.wait(2.0)
    talk.perform(talk.session.stop(talk.now))
    talk.wait(pause)
    talk.perform(talk.session.release(1, talk.now))
    talk.wait(RELEASE_TIMEOUT)
    assert (talk.controller.mode, talk.session.held) == (ModeKind.READY, "")
    assert talk.controller.stops == 2, "it was stopped once"
    assert talk.events.count(ReleaseConfirmed()) == 1


@pytest.mark.parametrize("seed", range(20))
def test_over_a_bad_link_a_release_ends_as_it_is_told(make_talk: type[Talk], seed: int) -> None:
    talk = make_talk(Faults(loss=0.4, delay=0.2, seed=seed))
    talk.wait(3.0)
    talk.perform(talk.session.stop(talk.now))
    talk.wait(0.1)
    talk.perform(talk.session.release(1, talk.now))
    talk.wait(RELEASE_TIMEOUT + 4.0)
    released = ReleaseConfirmed() in talk.events
    assert released != (ReleaseUnanswered() in talk.events)
    assert (talk.controller.mode == ModeKind.READY) == released
    assert talk.session.stopped != released


@pytest.mark.parametrize("life", ["the same", "a new one"])
def test_a_release_while_the_link_is_down_is_for_a_short_time_and_its_loss_is_told(
    talk: Talk, life: str
) -> None:
    talk.wait(1.0)
    talk.perform(talk.session.stop(talk.now))
    talk.wait(1.0)
    for away, released in ((RELEASE_TIMEOUT + 1.0, False), (1.0, True)):
        talk.events.clear()
        talk.cut()
        if life == "a new one":
            talk.controller.restart()
        talk.perform(talk.session.release(1, talk.now))
        talk.wait(away)
        assert (ReleaseUnanswered() in talk.events) is not released
        talk.connect()
        talk.wait(1.0)
        assert (ReleaseConfirmed() in talk.events) is released
        assert (talk.controller.mode == ModeKind.READY) is released
        assert talk.session.stopped is not released


def test_a_release_with_a_stale_epoch_is_given_up(talk: Talk) -> None:
    talk.wait(0.1)
    talk.start(epoch=9)
    talk.wait(0.1)
    talk.perform(talk.session.stop(talk.now))
    talk.wait(0.5)
    talk.perform(talk.session.release(8, talk.now))
    talk.wait(10.0)
    assert talk.controller.mode == ModeKind.SAFE_STOP
    asked = len([m for m in talk.controller.heard if isinstance(m, SetMode) and m.mode == ModeKind.READY])
    assert 8 <= asked <= 10


@pytest.mark.parametrize("objection", [Reason.STOPPED, Reason.STALE_EPOCH, Reason.NOT_IN_CONTROL])
def test_a_release_that_was_refused_is_not_said_again(talk: Talk, objection: Reason) -> None:
    talk.wait(0.5)
    talk.perform(talk.session.stop(talk.now))
    talk.wait(1.0)
    talk.controller.objection = objection
    talk.perform(talk.session.release(1, talk.now))
    talk.wait(0.1)
    assert talk.session.held == f"its controller is in safe stop: {reason_in_words(objection)}"
    talk.controller.objection = Reason.NONE  # whatever was in the way is gone; the operator has yet to ask
    talk.wait(RELEASE_TIMEOUT + 1.0)
    assert talk.controller.mode == ModeKind.SAFE_STOP
    talk.perform(talk.session.release(1, talk.now))
    talk.wait(0.1)
    assert (talk.controller.mode, talk.session.held) == (ModeKind.READY, "")


def test_a_release_whose_answer_was_lost_ends_no_stop_that_began_meanwhile(talk: Talk) -> None:
    talk.wait(0.5)
    talk.perform(talk.session.stop(talk.now))
    talk.wait(1.0)
    talk.controller.mute = True
    talk.perform(talk.session.release(1, talk.now))
    talk.wait(0.1)
    assert talk.controller.mode == ModeKind.READY
    talk.controller.stop()
    talk.wait(1.0)
    assert talk.controller.mode == ModeKind.SAFE_STOP
    talk.controller.mute = False
    talk.wait(1.0)
    assert "its controller is in safe stop" in talk.session.held
    talk.perform(talk.session.release(1, talk.now))
    talk.wait(0.1)
    assert (talk.controller.mode, talk.session.held) == (ModeKind.READY, "")


@pytest.mark.parametrize("ended", ["taken back", "given up"])
def test_a_release_that_lay_in_a_link_until_nobody_waited_for_it_leaves_the_robot_stopped(
    make_talk: type[Talk], ended: str
) -> None:
    """A stop of somebody else, over a link that holds up what it carries for longer than anybody waits."""
    talk = make_talk(Faults(delay=1.0 if ended == "taken back" else 1.0 + RELEASE_TIMEOUT / 2))
    talk.wait(3.0)
    talk.controller.stop()
    talk.wait(3.0)
    talk.perform(talk.session.release(1, talk.now))
    talk.wait(0.5)
    if ended == "taken back":
        talk.perform(talk.session.withdraw(talk.now))
    modes: set[ModeKind] = set()
    talk.wait(10.0, lambda: modes.add(talk.controller.mode))
    assert modes == {ModeKind.READY, ModeKind.SAFE_STOP}, "the release arrived"
    assert (talk.controller.mode, talk.session.stopped) == (ModeKind.SAFE_STOP, True)
    assert ReleaseConfirmed() not in talk.events


def test_where_no_stop_is_known_of_a_release_is_done_also_while_the_controller_is_away(talk: Talk) -> None:
    talk.wait(1.0)
    talk.cut()
    talk.controller.stop()
    talk.perform(talk.session.release(1, talk.now))
    assert talk.events[-1] == ReleaseConfirmed()
    talk.wait(1.0)
    talk.connect()
    talk.wait(1.0)
    assert not [message for message in talk.controller.heard if isinstance(message, SetMode)]
    assert talk.session.held, "a stop that nobody could know of stays in force"


def test_of_a_controller_that_was_never_heard_it_is_not_known_whether_it_is_stopped(talk: Talk) -> None:
    talk.cut()
    talk.perform(talk.session.release(1, talk.now))
    talk.wait(RELEASE_TIMEOUT + 0.1)
    assert [event for event in talk.events if not isinstance(event, OnlineChanged)] == [ReleaseUnanswered()]
    assert not talk.session.stopped
