"""Stories of a conversation with a controller, in time that passes by hand."""

from __future__ import annotations

from typing import Any

import pytest

from robotree.protocol.links.loopback import Faults
from robotree.protocol.messages import (
    CommandAck,
    CommandLong,
    Goal,
    GoalState,
    Heartbeat,
    Joints,
    MavCmd,
    MavResult,
    Tool,
)
from robotree.protocol.services.command_client import RESEND
from robotree.protocol.services.heartbeat import SILENCE
from robotree.proxy.session import DEAD, ControllerSession

Talk = Any


def test_while_it_moves_for_us_three_heartbeats_in_a_row_may_be_lost(talk: Talk) -> None:
    talk.wait(2.0)
    talk.start()
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
    assert len(talk.redials) == 1, "and once, also if it takes its time to close"
    assert talk.session.due > talk.now
    assert talk.turns == []
    talk.connect()
    talk.wait(DEAD + 0.5)
    assert len(talk.redials) == 2


@pytest.mark.parametrize("seed", range(20))
def test_a_bad_link_moves_a_robot_once_and_tells_its_end(make_talk: type[Talk], seed: int) -> None:
    talk = make_talk(Faults(loss=0.3, duplication=0.3, delay=0.05, jitter=0.2, seed=seed))
    talk.wait(5.0)
    talk.start()
    talk.wait(2.5)
    talk.controller.finish(GoalState.SUCCEEDED)
    talk.wait(10.0)
    assert len(talk.controller.begun) == 1
    assert talk.ends == [GoalState.SUCCEEDED]


def test_the_controller_is_told_the_epoch_and_the_time_to_live(talk: Talk) -> None:
    talk.wait(0.1)
    talk.start(epoch=9, ttl=2.0)
    talk.wait(0.1)
    (goal,) = [message for message in talk.controller.heard if isinstance(message, Goal)]
    assert (goal.epoch, goal.ttl_ms) == (9, 2000)
    assert talk.session.obeyed < 9
    talk.wait(2.5)
    assert talk.ends == [GoalState.EXPIRED]
    assert talk.session.obeyed == 9


def test_a_goal_survives_a_short_break_of_its_link(talk: Talk) -> None:
    talk.wait(0.1)
    talk.start()
    talk.wait(0.1)
    talk.controller.progress(0.3)
    talk.cut()
    talk.wait(1.0)
    talk.controller.finish(GoalState.SUCCEEDED)
    talk.connect()
    talk.wait(1.5)
    assert talk.ends == [GoalState.SUCCEEDED]
    assert len(talk.controller.begun) == 1


def asked(talk: Talk) -> list[CommandLong]:
    return [message for message in talk.controller.heard if isinstance(message, CommandLong)]


def test_telemetry_that_is_wanted_less_often_is_asked_for_at_that_rate_on_every_link(
    make_talk: type[Talk],
) -> None:
    talk = make_talk(session=ControllerSession(rates={Tool: 10.0, Joints: 4.0}))
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
    talk = make_talk(session=ControllerSession(rates={Tool: 10.0}))
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
