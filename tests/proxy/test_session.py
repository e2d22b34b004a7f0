"""Laws and stories of a session with a controller: how it begins, lives, stops and ends."""

from __future__ import annotations

from typing import Any

import pytest

from robotree.protocol.frame import Frame
from robotree.protocol.links.loopback import Faults
from robotree.protocol.messages import (
    Claim,
    ClaimStatus,
    ClaimWish,
    CommandAck,
    CommandLong,
    Goal,
    GoalState,
    Heartbeat,
    Joints,
    MavCmd,
    MavResult,
    Mode,
    ModeKind,
    Reason,
    SetMode,
    Tool,
    Verb,
)
from robotree.protocol.services.claim_client import ClaimClient, ClaimDenied, ClaimGranted
from robotree.protocol.services.command_client import RESEND
from robotree.protocol.services.goal_client import GoalEnded
from robotree.protocol.services.heartbeat import SILENCE
from robotree.protocol.services.peer import Peer, Send
from robotree.proxy.desired_mode import RELEASE_TIMEOUT, ReleaseRefused
from robotree.proxy.motion import Request
from robotree.proxy.restart import LONGEST_DELAY
from robotree.proxy.session import DEAD, ControllerSession
from robotree.proxy.translate import COMPONENTS, component_of

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


ELSEWHERE = Peer("another link", 255, 77)


def claiming(*, take_over: bool = False) -> ControllerSession:
    claim = ClaimClient(1, 1, holder=5, name="arm-1, pid 12", take_over=take_over)
    return ControllerSession(component=30, claim=claim)


@pytest.fixture
def claimed(make_talk: type[Talk]) -> Talk:
    """A session that commands a controller."""
    talk = make_talk(session=claiming(), life=9)
    talk.wait(0.3)
    assert talk.turns == [True]
    return talk


def held_by(talk: Talk, holder: int = 6, wish: ClaimWish = ClaimWish.TAKE_OVER) -> None:
    """Somebody else says a claim."""
    epoch = talk.controller.fence.epoch + 1
    claim = Claim(holder, epoch, 3000, talk.controller.life, 1, 1, wish, "arm-2, pid 13")
    talk.controller.claims.receive(claim, ELSEWHERE, talk.now)


def test_a_controller_that_is_heard_but_answers_no_claim_is_not_called_silent(
    make_talk: type[Talk],
) -> None:
    talk = make_talk(session=claiming(), life=9)
    talk.controller.answers_claims = False
    assert talk.session.trouble == "nothing was heard from its controller yet"
    talk.wait(DEAD + 1.0)
    assert talk.session.trouble.startswith("its controller is heard but answers no CLAIM")
    assert not talk.redials, "a new link would not change it"
    talk.controller.mute = True
    talk.wait(SILENCE)
    talk.controller.mute, talk.controller.answers_claims = False, True
    talk.wait(1.0)
    assert (talk.session.trouble, talk.turns) == ("", [True])


@pytest.mark.parametrize("missing", ["HEARTBEAT", "MODE"])
def test_a_session_says_what_it_has_not_heard(missing: str, make_talk: type[Talk]) -> None:
    talk = make_talk(session=claiming(), life=9)
    talk.controller.beats, talk.controller.modes = missing != "HEARTBEAT", missing != "MODE"
    talk.wait(0.9)
    assert talk.session.trouble == f"its controller is heard but has sent no {missing} yet"


@pytest.mark.parametrize("moment", [0.0, 0.1, 0.2, 0.3, 0.7, 1.2])
def test_what_adds_up_begins_once_though_its_status_is_lost_and_the_controller_restarts(
    claimed: Talk, moment: float
) -> None:
    claimed.start()
    claimed.controller.mute = True
    claimed.wait(0.05 + moment)
    assert len(claimed.controller.begun) == 1
    claimed.controller.restart()
    claimed.controller.mute = False
    claimed.wait(5.0)
    assert len(claimed.controller.begun) == 1, "the new life was not asked for it, or did not begin it"
    ends = [each for each in claimed.events if isinstance(each, GoalEnded)]
    assert [(each.state, each.reason) for each in ends] == [(GoalState.UNKNOWN, Reason.OTHER_LIFE)]


def test_a_new_link_repeats_no_goal_before_a_controller_without_lives_has_told_how_it_is(
    make_talk: type[Talk],
) -> None:
    """It has begun the goal, and restarted before its answer came: a repetition would begin it once more."""
    talk = make_talk()
    talk.wait(3.0)
    talk.start()
    talk.controller.mute = True
    talk.wait(0.1)
    assert len(talk.controller.begun) == 1
    talk.cut()
    talk.controller.restart()
    talk.controller.mute = False
    talk.connect()
    talk.wait(5.0)
    assert len(talk.controller.begun) == 1
    ends = [each for each in talk.events if isinstance(each, GoalEnded)]
    assert [(each.state, each.reason) for each in ends] == [(GoalState.UNKNOWN, Reason.OTHER_LIFE)]


def test_what_ends_the_same_and_was_never_answered_is_asked_for_again_in_the_new_life(claimed: Talk) -> None:
    claimed.start(repeatable=True)
    claimed.controller.mute = True
    claimed.wait(0.2)
    claimed.controller.restart()
    claimed.controller.mute = False
    claimed.wait(1.0)
    assert len(claimed.controller.begun) == 2
    claimed.controller.finish(GoalState.SUCCEEDED)
    claimed.wait(0.2)
    assert claimed.ends == [GoalState.SUCCEEDED]


def test_what_was_known_to_move_is_not_asked_for_again_whatever_it_is(claimed: Talk) -> None:
    claimed.start(repeatable=True)
    claimed.wait(0.2)
    claimed.controller.restart()
    claimed.wait(1.0)
    assert len(claimed.controller.begun) == 1
    assert claimed.ends == [GoalState.UNKNOWN]


def test_a_mode_of_a_former_life_that_comes_late_changes_nothing(claimed: Talk) -> None:
    claimed.controller.restart()
    claimed.wait(0.6)
    claimed.start()
    claimed.wait(0.1)
    claimed.controller.say(Mode(10**6, 5, 1000, ModeKind.SAFE_STOP, 0, 2, 9))
    claimed.wait(0.3)
    assert claimed.ends == []
    assert not claimed.session.held


@pytest.mark.parametrize(
    "wrong",
    [
        Mode(400, 5, 1000, ModeKind.READY, 0, 1, 77),
        Mode(2**31, 5, 1000, ModeKind.READY, 0, 1, 9),
        Mode(2**31, 2**32 - 1, 1000, ModeKind.READY, 0, 9, 78),
    ],
    ids=["another life", "a late clock", "all of it"],
)
def test_one_wrong_word_does_not_keep_the_right_ones_out_for_long(claimed: Talk, wrong: Mode) -> None:
    claimed.controller.say(wrong)
    claimed.wait(LONGEST_DELAY + 1.5)
    assert claimed.session.claims
    assert claimed.session.denial == claimed.session.held == ""
    claimed.start()
    claimed.wait(0.3)
    assert len(claimed.controller.begun) == 1


@pytest.mark.parametrize("lives", [(9,), (10, 9), (10, 11, 10)])
def test_a_life_whose_number_comes_again_is_heard(claimed: Talk, lives: tuple[int, ...]) -> None:
    """A controller without memory may draw it again, and one whose memory was set back counts to it."""
    claimed.wait(20.0)
    for life in lives:
        claimed.controller.restart()
        claimed.controller.life = claimed.controller.claims.life = life
        claimed.controller.goals = claimed.controller._goals_of_this_life()
        claimed.wait(LONGEST_DELAY + 1.5)
    claimed.start()
    claimed.wait(0.3)
    assert claimed.controller.begun[-1].verb
    assert claimed.ends == []
    claimed.controller.restart()
    claimed.controller.life = claimed.controller.claims.life = lives[-1]
    claimed.controller.goals = claimed.controller._goals_of_this_life()
    claimed.wait(LONGEST_DELAY + 1.5)
    assert claimed.ends == [GoalState.UNKNOWN], "it may have begun before, although the life has one number"


def test_the_largest_epoch_that_a_controller_can_tell_ends_nothing(make_talk: type[Talk]) -> None:
    talk = make_talk(session=claiming(), life=9)
    talk.controller.say(Mode(1, 2**32 - 1, 1000, ModeKind.READY, 0, 1, 9))
    talk.wait(1.0)
    assert talk.session.claims
    assert (talk.turns, talk.session.denial) == ([True], "")


def test_a_release_that_was_made_for_another_life_releases_nothing(claimed: Talk) -> None:
    claimed.controller.stop()
    claimed.wait(0.2)
    claimed.controller.mute = True
    claimed.controller.restart()
    claimed.controller.stop()
    claimed.perform(claimed.session.release(5, claimed.now))
    claimed.controller.mute = False
    claimed.wait(0.4)
    assert claimed.controller.mode == ModeKind.SAFE_STOP
    refusals = [each.reason for each in claimed.events if isinstance(each, ReleaseRefused)]
    assert refusals == [Reason.OTHER_LIFE]


def test_the_claim_is_said_often_enough_that_three_in_a_row_may_be_lost_while_something_moves(
    claimed: Talk,
) -> None:
    claimed.start()
    said: list[float] = []

    def note() -> None:
        said.extend(claimed.now for each in claimed.controller.heard if isinstance(each, Claim))
        claimed.controller.heard.clear()

    claimed.wait(0.3)
    claimed.wait(10.0, each=note)
    bears = 1.0  # [s] the silence that this controller tells
    assert max(b - a for a, b in zip(said, said[4:], strict=False)) <= bears + 0.1


def test_it_is_online_only_once_the_controller_has_answered_its_claim(make_talk: type[Talk]) -> None:
    talk = make_talk(session=claiming(), life=9)
    talk.controller.claims.receive = lambda *_: []
    talk.wait(SILENCE - 0.5)
    assert talk.turns == []
    del talk.controller.claims.receive
    talk.wait(0.5)
    assert talk.turns == [True]


def test_who_holds_it_is_told_and_when_that_one_is_gone_it_is_ours(make_talk: type[Talk]) -> None:
    talk = make_talk(session=claiming(), life=9)
    held_by(talk)
    talk.wait(1.0)
    assert talk.turns == [True], "telemetry and stops work"
    assert "'arm-2, pid 13' holds its controller" in talk.session.denial
    held_by(talk, wish=ClaimWish.RELEASE)
    talk.wait(1.5)
    assert talk.session.denial == ""
    told = [each for each in talk.events if isinstance(each, ClaimDenied | ClaimGranted)]
    assert [type(each) for each in told] == [ClaimDenied, ClaimGranted]


def test_a_person_has_it_taken_over_once_and_not_again_and_again(make_talk: type[Talk]) -> None:
    talk = make_talk(session=claiming(take_over=True), life=9)
    held_by(talk)
    talk.wait(1.0)
    (granted,) = [each for each in talk.events if isinstance(each, ClaimDenied | ClaimGranted)]
    assert granted == ClaimGranted("arm-2, pid 13")
    held_by(talk)
    talk.wait(2.5)  # the other one is not heard again, and its term is 3 s
    assert talk.session.denial, "who takes it back keeps it"


def test_a_claim_that_is_granted_goes_with_each_heartbeat(claimed: Talk) -> None:
    """So a proxy whose robot rests wakes up, and wakes its controller, once a second for the two."""
    claimed.wait(2.0)
    said: list[tuple[float, type[Any]]] = []
    perform = claimed.perform

    def watched(effects: list[Any]) -> None:
        said.extend((claimed.now, type(each.message)) for each in effects if isinstance(each, Send))
        perform(effects)

    claimed.perform = watched
    claimed.wait(3.0)
    moments = sorted({moment for moment, _ in said})
    assert len(moments) == 3
    assert said == [(moment, kind) for moment in moments for kind in (Claim, Heartbeat)]


def test_a_holder_that_is_away_is_waited_for_before_anything_is_said_to_be_online(
    make_talk: type[Talk],
) -> None:
    talk = make_talk(session=claiming(), life=9)
    held_by(talk)
    talk.controller.claims.link_closed(ELSEWHERE.via, talk.now)
    talk.wait(0.3)
    assert (talk.turns, talk.session.denial) == ([], "")
    talk.wait(0.7)
    assert (talk.turns, talk.session.denial) == ([True], "")


def test_who_finds_a_namesake_on_the_wire_gives_way_unless_it_holds_the_claim(make_talk: type[Talk]) -> None:
    namesake = Frame.of(Goal(1, 1, 0, (0.0,) * 7, Verb.STATUS, 1, 1), system=255, component=30)
    session = claiming()
    session.receive(namesake, 0.0)
    assert session.component in COMPONENTS
    assert session.component != 30
    talk = make_talk(session=claiming(), life=9)
    talk.wait(0.3)
    talk.session.receive(namesake, talk.now)
    assert talk.session.component == 30


def test_the_component_of_a_proxy_is_that_of_its_next_incarnation_too() -> None:
    assert component_of("arm-1") == component_of("arm-1")
    taken = {component_of(f"arm-{number}") for number in range(40)}
    assert len(taken) > 20
    assert taken <= set(range(25, 100)), "MAVLink leaves these to its users"


def test_who_ends_in_order_gives_the_controller_up(claimed: Talk) -> None:
    claimed.perform(claimed.session.release_claim())
    claimed._loopback.advance(claimed.now + 0.1)
    assert claimed.controller.claims.holding is None


def test_on_a_new_link_the_claim_goes_before_a_goal_that_is_repeated() -> None:
    """The controller reports our claim to everybody, also over a link from which it has not heard it."""
    session = claiming()
    said: list[type[Any]] = []

    def hear(now: float, *messages: Any) -> None:
        effects = [
            effect
            for message in messages
            for effect in session.receive(Frame.of(message, system=1, component=1), now)
        ]
        effects += session.tick(now + 0.01)
        said.extend(type(each.message) for each in effects if isinstance(each, Send))

    beat, ours = Heartbeat(0, 0, 0, 0, 4), ClaimStatus(5, 1, 3000, 9, 0, 0, 255, 30, 0, "arm-1, pid 12")
    session.opened(0.0)
    hear(0.1, beat, Mode(100, 1, 2000, ModeKind.READY, 0, 0, 9), ours)
    session.start(7, Request(Verb.HOLD, ()), epoch=1, ttl=10.0, now=0.2)
    session.closed("it was cut")
    said[:] = [type(each.message) for each in session.opened(1.0) if isinstance(each, Send)]
    for later in (1.1, 1.2, 1.3, 2.0):
        hear(later, ours, Mode(round(1000 * later), 1, 2000, ModeKind.READY, 0, 0, 9), beat)
    assert Goal in said
    assert Claim in said[: said.index(Goal)]
