"""Stories of stops in a conversation with a controller: our own, and those of somebody else."""

from __future__ import annotations

from typing import Any

import pytest

from robotree.protocol.messages import Mode, ModeKind, SetMode
from robotree.proxy.desired_mode import RELEASE_TIMEOUT

Talk = Any


@pytest.mark.parametrize("asked", ["before the link was lost", "while it was down"])
def test_a_stop_is_confirmed_only_by_what_is_heard_after_it_and_on_its_link(talk: Talk, asked: str) -> None:
    talk.wait(1.0)
    if asked == "before the link was lost":
        talk.perform(talk.session.stop(talk.now))
    else:
        talk.controller.stop()
    talk.wait(1.0)
    talk.cut()
    talk.controller.release()
    talk.perform([] if talk.session.stopped else talk.session.stop(talk.now))
    talk.controller.mute = True
    talk.connect()
    talk.controller.heard.clear()
    talk.wait(2.0)
    sent = len([message for message in talk.controller.heard if isinstance(message, SetMode)])
    assert 7 <= sent <= 9, "whatever was heard before, this is said until an answer comes"
    talk.controller.mute = False
    talk.wait(0.5)
    talk.controller.heard.clear()
    talk.wait(2.0)
    assert not [message for message in talk.controller.heard if isinstance(message, SetMode)]


def test_a_stop_of_somebody_else_is_told_with_its_reason_until_somebody_releases_it(talk: Talk) -> None:
    talk.wait(1.0)
    assert (talk.session.held, talk.holds) == ("", [])
    talk.controller.stop()
    talk.wait(0.1)
    assert talk.session.held == "its controller is in safe stop: somebody asked for it"
    assert not talk.session.stopped, "it is not ours to insist on"
    talk.controller.release()
    talk.wait(5.0)
    assert (talk.session.held, talk.holds) == ("", [True, False])
    assert talk.controller.mode == ModeKind.READY


def test_a_stop_that_was_in_force_before_the_link_is_told_as_soon_as_the_robot_is_online(
    make_talk: type[Talk],
) -> None:
    talk = make_talk()
    talk.controller.mode = ModeKind.SAFE_STOP
    talk.wait(0.1)
    assert talk.session.online
    assert talk.session.held


def test_a_controller_that_cannot_move_is_held_too(talk: Talk) -> None:
    talk.controller.mode = ModeKind.FAULT
    talk.wait(0.1)
    assert talk.session.held == "its controller cannot move: the controller gave no reason"


@pytest.mark.parametrize(("uptime", "age"), [(5.0, 1.0), (3.0, 4.5), (60.0, 90.0)])
def test_a_stop_of_somebody_else_outlives_a_restart_of_the_controller(
    talk: Talk, uptime: float, age: float
) -> None:
    talk.wait(uptime)
    talk.controller.stop()
    talk.wait(0.1)
    talk.cut()
    talk.wait(1.0)
    talk.controller.restart()
    talk.wait(age)
    talk.connect()
    talk.wait(1.0)
    assert talk.controller.mode == ModeKind.SAFE_STOP
    assert all(talk.holds), "it is never told to be free"
    talk.perform(talk.session.release(6, talk.now))
    talk.wait(1.0)
    assert talk.controller.mode == ModeKind.READY


def test_a_release_by_somebody_else_while_the_link_was_down_is_no_restart(talk: Talk) -> None:
    talk.wait(5.0)
    talk.controller.stop()
    talk.wait(0.1)
    talk.cut()
    talk.controller.release()
    talk.wait(60.0)
    talk.connect()
    talk.wait(1.0)
    assert talk.controller.mode == ModeKind.READY
    assert talk.session.held == ""


def test_a_release_holds_nothing_up_while_it_is_on_the_way_and_is_taken_back_if_it_fails(talk: Talk) -> None:
    talk.wait(0.1)
    talk.start(epoch=9)
    talk.wait(0.1)
    talk.controller.stop()
    talk.wait(0.1)
    talk.perform(talk.session.release(8, talk.now))
    assert talk.session.held == ""
    talk.wait(RELEASE_TIMEOUT + 0.5)
    assert talk.controller.mode == ModeKind.SAFE_STOP
    assert talk.holds == [True, False, True]


def test_a_stop_is_told_before_it_is_confirmed(talk: Talk) -> None:
    talk.wait(0.1)
    talk.controller.mute = True
    talk.perform(talk.session.stop(talk.now))
    assert talk.session.held == "its controller has yet to confirm the stop"


def test_nor_does_one_of_before_the_stop_show_the_robot_free(talk: Talk) -> None:
    talk.wait(1.0)
    late = talk.session.twin.latest(Mode)
    talk.controller.stop()
    talk.wait(0.1)
    talk.controller.say(late)
    talk.wait(0.1)
    assert talk.holds == [True]
