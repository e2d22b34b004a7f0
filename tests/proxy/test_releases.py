"""Stories of releases: refused, overtaken by a stop, of one that is not confirmed, and over bad links."""

from __future__ import annotations

from typing import Any

import pytest

from robotree.protocol.links.loopback import Faults
from robotree.protocol.messages import ModeKind, SetMode
from robotree.proxy.desired_mode import RELEASE_TIMEOUT, ReleaseConfirmed, ReleaseUnanswered
from robotree.proxy.session import OnlineChanged

Talk = Any


@pytest.mark.parametrize("seed", range(5))
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
