"""Stories of a conversation with a controller, in time that passes by hand."""

from __future__ import annotations

from typing import Any

import pytest

from robotree.protocol.links.loopback import Accidents
from robotree.protocol.messages import (
    CommandAck,
    CommandLong,
    Goal,
    GoalState,
    Heartbeat,
    Joints,
    MavCmd,
    MavResult,
    ModeKind,
    Reason,
    SetMode,
    Tool,
    Verb,
)
from robotree.protocol.services.command_client import RESEND
from robotree.protocol.services.goal_client import PATIENCE, GoalEnded, GoalProgress, GoalSilent
from robotree.protocol.services.heartbeat import SILENCE
from robotree.proxy.motion import Request
from robotree.proxy.outcome import reason_in_words
from robotree.proxy.session import DEAD, HeldChanged, Session
from robotree.proxy.will import RELEASE_WITHIN

Talk = Any
GRIP = Request(Verb.GRIP, (0.02,))


def start(talk: Talk, key: int = 7, epoch: int = 5, ttl: float = 0.0) -> None:
    talk.perform(talk.session.start(key, GRIP, epoch=epoch, ttl=ttl, now=talk.now))


def ends(talk: Talk) -> list[GoalState]:
    return [event.state for event in talk.events if isinstance(event, GoalEnded)]


def test_while_it_moves_for_us_three_heartbeats_in_a_row_may_be_lost(talk: Talk) -> None:
    talk.wait(2.0)
    start(talk)
    heard: list[float] = []

    def note() -> None:
        heard.extend(talk.now for message in talk.controller.heard if isinstance(message, Heartbeat))
        talk.controller.heard.clear()

    talk.wait(10.0, each=note)
    longest = max(later - earlier for earlier, later in zip(heard, heard[4:], strict=False))
    assert longest < 1.0, "the silence that the controller bears, as it tells"
    talk.controller.finish(GoalState.SUCCEEDED)
    talk.wait(1.0)
    talk.controller.heard.clear()
    talk.wait(10.0)
    assert len([message for message in talk.controller.heard if isinstance(message, Heartbeat)]) in {10, 11}


def test_a_robot_is_online_once_its_controller_was_heard(talk: Talk) -> None:
    assert not talk.session.online
    talk.wait(0.1)
    assert talk.session.online
    assert talk.turns == [True]


def test_both_sides_hear_a_heartbeat_every_second(talk: Talk) -> None:
    talk.wait(10.0)
    beats = [message for message in talk.controller.heard if isinstance(message, Heartbeat)]
    assert 10 <= len(beats) <= 11
    assert talk.turns == [True]


def test_a_silent_controller_is_offline_and_its_link_is_given_up(talk: Talk) -> None:
    talk.wait(1.0)
    talk.controller.mute = True
    talk.wait(SILENCE - 1.0)
    assert talk.session.online
    talk.wait(1.1)
    assert not talk.session.online
    assert talk.session.trouble == "its controller has been silent for 3 s"
    assert not talk.redials
    talk.wait(DEAD - SILENCE)
    assert talk.redials


def test_a_link_on_which_nobody_speaks_is_given_up(talk: Talk) -> None:
    talk.controller.mute = True
    talk.wait(DEAD - 0.5)
    assert not talk.redials
    talk.wait(1.0)
    assert talk.redials
    assert talk.turns == []


def test_a_broken_link_is_offline_at_once_and_online_again_with_the_next(talk: Talk) -> None:
    talk.wait(1.0)
    talk.cut()
    assert not talk.session.online
    talk.connect()
    talk.wait(0.1)
    assert talk.turns == [True, False, True]


def test_a_goal_tells_its_progress_and_its_end(talk: Talk) -> None:
    talk.wait(0.1)
    start(talk)
    talk.wait(0.1)
    talk.controller.progress(0.1)
    talk.wait(0.2)
    talk.controller.progress(0.5)
    talk.wait(0.1)
    talk.controller.finish(GoalState.SUCCEEDED)
    talk.wait(0.1)
    assert max(event.progress for event in talk.events if isinstance(event, GoalProgress)) == 0.5
    assert ends(talk) == [GoalState.SUCCEEDED]
    assert talk.controller.begun[0].args[0] == pytest.approx(0.02)


@pytest.mark.parametrize("seed", range(20))
def test_a_bad_link_moves_a_robot_once_and_tells_its_end(make_talk: type[Talk], seed: int) -> None:
    talk = make_talk(Accidents(loss=0.3, duplication=0.3, delay=0.05, jitter=0.2, seed=seed))
    talk.wait(5.0)
    start(talk)
    talk.wait(2.5)
    talk.controller.finish(GoalState.SUCCEEDED)
    talk.wait(10.0)
    assert len(talk.controller.begun) == 1
    assert ends(talk) == [GoalState.SUCCEEDED]


def test_the_controller_is_told_the_epoch_and_the_time_to_live(talk: Talk) -> None:
    talk.wait(0.1)
    start(talk, epoch=9, ttl=2.0)
    talk.wait(0.1)
    (goal,) = [message for message in talk.controller.heard if isinstance(message, Goal)]
    assert (goal.epoch, goal.ttl_ms) == (9, 2000)
    assert talk.session.obeyed < 9
    talk.wait(2.5)
    assert ends(talk) == [GoalState.EXPIRED]
    assert talk.session.obeyed == 9


def test_a_goal_of_an_older_epoch_is_refused(talk: Talk) -> None:
    talk.wait(0.1)
    start(talk, key=1, epoch=9)
    start(talk, key=2, epoch=8)
    talk.wait(0.1)
    (end,) = [event for event in talk.events if isinstance(event, GoalEnded)]
    assert (end.key, end.state, end.reason) == (2, GoalState.REFUSED, Reason.STALE_EPOCH)


def test_a_cancelled_goal_ends_where_the_robot_is(talk: Talk) -> None:
    talk.wait(0.1)
    start(talk)
    talk.wait(0.1)
    talk.perform(talk.session.cancel(7, epoch=5, now=talk.now))
    talk.wait(0.1)
    assert ends(talk) == [GoalState.CANCELLED]
    assert [abandoned.reason for abandoned in talk.controller.abandoned] == [Reason.OPERATOR]


def test_a_goal_survives_a_short_break_of_its_link(talk: Talk) -> None:
    talk.wait(0.1)
    start(talk)
    talk.wait(0.1)
    talk.controller.progress(0.3)
    talk.cut()
    talk.wait(1.0)
    talk.controller.finish(GoalState.SUCCEEDED)
    talk.connect()
    talk.wait(1.5)
    assert ends(talk) == [GoalState.SUCCEEDED]
    assert len(talk.controller.begun) == 1


def test_a_goal_that_a_restarted_controller_forgot_is_not_begun_again(talk: Talk) -> None:
    talk.wait(0.1)
    start(talk)
    talk.wait(0.1)
    talk.cut()
    talk.controller.restart()
    talk.connect()
    talk.wait(2.0)
    assert ends(talk) == [GoalState.UNKNOWN]
    assert len(talk.controller.begun) == 1


def test_a_goal_of_which_nothing_is_heard_is_told_silent(talk: Talk) -> None:
    talk.wait(0.1)
    start(talk)
    talk.wait(0.1)
    talk.cut()
    talk.wait(PATIENCE + 0.2)
    assert [event.key for event in talk.events if isinstance(event, GoalSilent)] == [7]


def test_a_stop_is_repeated_until_it_is_confirmed(make_talk: type[Talk]) -> None:
    for seed in range(10):
        talk = make_talk(Accidents(loss=0.6, seed=seed))
        talk.wait(1.0)
        talk.perform(talk.session.stop(talk.now))
        talk.wait(10.0)
        assert talk.controller.mode == ModeKind.SAFE_STOP
        sent = len([message for message in talk.controller.heard if isinstance(message, SetMode)])
        assert 1 <= sent < 15, "confirmed stops are not repeated"


def test_a_stop_outlives_the_controller_and_ends_only_with_its_release(talk: Talk) -> None:
    talk.wait(0.1)
    start(talk)
    talk.wait(0.1)
    talk.perform(talk.session.stop(talk.now))
    talk.wait(0.1)
    assert ends(talk) == [GoalState.CANCELLED]
    talk.cut()
    talk.controller.restart()
    assert talk.controller.mode == ModeKind.READY
    talk.connect()
    talk.wait(1.0)
    assert talk.controller.mode == ModeKind.SAFE_STOP
    assert talk.session.stopped
    talk.perform(talk.session.release(6, talk.now))
    talk.wait(1.0)
    assert talk.controller.mode == ModeKind.READY
    assert not talk.session.stopped


def test_a_stop_that_was_asked_for_while_the_link_was_down_comes_with_the_link(talk: Talk) -> None:
    talk.cut()
    talk.perform(talk.session.stop(talk.now))
    assert talk.controller.mode == ModeKind.READY
    talk.connect()
    talk.wait(0.1)
    assert talk.controller.mode == ModeKind.SAFE_STOP


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


def test_a_stop_is_repeated_also_where_one_of_somebody_else_is_in_force(talk: Talk) -> None:
    """Who knows whether it still is, when this one arrives."""
    talk.wait(0.5)
    talk.controller.stop()
    talk.wait(0.5)
    talk.controller.mute = True
    talk.perform(talk.session.stop(talk.now))
    talk.wait(2.0)
    assert 7 <= len([message for message in talk.controller.heard if isinstance(message, SetMode)]) <= 9


def test_a_release_with_a_stale_epoch_is_given_up(talk: Talk) -> None:
    talk.wait(0.1)
    start(talk, epoch=9)
    talk.wait(0.1)
    talk.perform(talk.session.stop(talk.now))
    talk.wait(0.5)
    talk.perform(talk.session.release(8, talk.now))
    talk.wait(10.0)
    assert talk.controller.mode == ModeKind.SAFE_STOP
    asked = len([m for m in talk.controller.heard if isinstance(m, SetMode) and m.mode == ModeKind.READY])
    assert 10 <= asked <= 13


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
    talk.wait(RELEASE_WITHIN + 1.0)
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


def held(talk: Talk) -> list[bool]:
    return [bool(event.reason) for event in talk.events if isinstance(event, HeldChanged)]


def test_a_stop_of_somebody_else_is_told_with_its_reason_until_somebody_releases_it(talk: Talk) -> None:
    talk.wait(1.0)
    assert (talk.session.held, held(talk)) == ("", [])
    talk.controller.stop()
    talk.wait(0.1)
    assert talk.session.held == "its controller is in safe stop: somebody asked for it"
    assert not talk.session.stopped, "it is not ours to insist on"
    talk.controller.release()
    talk.wait(5.0)
    assert (talk.session.held, held(talk)) == ("", [True, False])
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
    assert all(held(talk)), "it is never told to be free"
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
    start(talk, epoch=9)
    talk.wait(0.1)
    talk.controller.stop()
    talk.wait(0.1)
    talk.perform(talk.session.release(8, talk.now))
    assert talk.session.held == ""
    talk.wait(RELEASE_WITHIN + 0.5)
    assert talk.controller.mode == ModeKind.SAFE_STOP
    assert held(talk) == [True, False, True]


def test_a_stop_is_told_before_it_is_confirmed(talk: Talk) -> None:
    talk.wait(0.1)
    talk.controller.mute = True
    talk.perform(talk.session.stop(talk.now))
    assert talk.session.held == "its controller has yet to confirm the stop"


def test_what_is_heard_is_remembered_beyond_the_end_of_the_link(talk: Talk) -> None:
    talk.wait(0.1)
    talk.controller.tell_tool()
    talk.wait(0.1)
    talk.cut()
    talk.wait(5.0)
    readings = talk.session.twin.readings(talk.now)
    assert readings["x"] == pytest.approx(0.1)
    assert readings["age"] == pytest.approx(5.0, abs=0.1)


def asked(talk: Talk) -> list[CommandLong]:
    return [message for message in talk.controller.heard if isinstance(message, CommandLong)]


def test_telemetry_that_is_wanted_less_often_is_asked_for_at_that_rate_on_every_link(
    make_talk: type[Talk],
) -> None:
    talk = make_talk(session=Session(rates={Tool: 10.0, Joints: 4.0}))
    tool, joints = (kind.codec.definition.id for kind in (Tool, Joints))
    talk.wait(0.2)
    (first,) = asked(talk)
    assert (first.command, first.param1, first.param2) == (MavCmd.SET_MESSAGE_INTERVAL, tool, 100_000.0)
    talk.wait(RESEND)
    assert [each.param1 for each in asked(talk)] == [tool, tool], "what nobody answers is said again"
    talk.controller.say(CommandAck(MavCmd.SET_MESSAGE_INTERVAL, MavResult.DENIED, 0, 0, 255, 42))
    talk.wait(0.1)
    assert len(asked(talk)) == 2, "that was the answer to somebody else"
    answer = CommandAck(MavCmd.SET_MESSAGE_INTERVAL, MavResult.DENIED, 0, 0, 255, 190)
    talk.controller.say(answer)
    talk.wait(2 * RESEND, lambda: talk.controller.say(answer) if len(asked(talk)) > 2 else None)
    assert [each.param1 for each in asked(talk)] == [tool, tool, joints]
    talk.wait(10.0)
    assert len(asked(talk)) == 3
    talk.cut()
    talk.connect()
    talk.wait(0.2)
    assert [each.param1 for each in asked(talk)[3:]] == [tool]


def test_a_controller_that_restarts_before_it_is_missed_is_asked_for_its_rates_again(
    make_talk: type[Talk],
) -> None:
    talk = make_talk(session=Session(rates={Tool: 10.0}))
    talk.wait(0.2)
    talk.controller.say(CommandAck(MavCmd.SET_MESSAGE_INTERVAL, MavResult.ACCEPTED, 0, 0, 255, 190))
    talk.wait(5.0)
    assert len(asked(talk)) == 1
    talk.controller.restart()
    talk.wait(0.6)
    talk.controller.say(CommandAck(MavCmd.SET_MESSAGE_INTERVAL, MavResult.ACCEPTED, 0, 0, 255, 190))
    talk.wait(5.0)
    assert talk.turns == [True]
    assert len({message.confirmation for message in asked(talk)}) == 1, "none is a repetition"
    assert len(asked(talk)) == 2


def test_a_proxy_takes_all_telemetry_as_it_comes(talk: Talk) -> None:
    talk.wait(2.0)
    assert asked(talk) == []
