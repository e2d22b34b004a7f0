"""Stories of releases: of a stop that has yet to be confirmed, over a bad link, and over none."""

from __future__ import annotations

from typing import Any

import pytest

from robotree.protocol.links.loopback import Accidents
from robotree.protocol.messages import ModeKind
from robotree.proxy.will import RELEASE_WITHIN, ReleaseConfirmed, ReleaseUnanswered

Talk = Any


@pytest.mark.parametrize(("delay", "pause"), [(0.1, 0.0), (0.3, 0.05), (0.3, 0.5), (0.3, 1.0)])
def test_a_release_within_a_round_trip_of_our_own_stop_ends_that_stop(
    make_talk: type[Talk], delay: float, pause: float
) -> None:
    talk = make_talk(Accidents(delay=delay))
    talk.wait(2.0)
    talk.perform(talk.session.stop(talk.now))
    talk.wait(pause)
    talk.perform(talk.session.release(1, talk.now))
    talk.wait(RELEASE_WITHIN)
    assert (talk.controller.mode, talk.session.held) == (ModeKind.READY, "")
    assert talk.controller.stops == 2, "it was stopped once"
    assert talk.events.count(ReleaseConfirmed()) == 1


@pytest.mark.parametrize("seed", range(20))
def test_over_a_bad_link_a_release_ends_as_it_is_told(make_talk: type[Talk], seed: int) -> None:
    talk = make_talk(Accidents(loss=0.4, delay=0.2, seed=seed))
    talk.wait(3.0)
    talk.perform(talk.session.stop(talk.now))
    talk.wait(0.1)
    talk.perform(talk.session.release(1, talk.now))
    talk.wait(RELEASE_WITHIN + 4.0)
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
    for away, released in ((RELEASE_WITHIN + 1.0, False), (1.0, True)):
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
