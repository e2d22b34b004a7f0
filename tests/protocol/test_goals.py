"""Stories of goals: both sides with a wire between them that the test plays, and the client alone."""

from __future__ import annotations

import math
from collections.abc import Iterable

import pytest

from robotree.protocol import Frame
from robotree.protocol.messages import AnyMessage, Goal, GoalCancel, GoalState, GoalStatus, Reason, Verb
from robotree.protocol.services.goal_client import (
    LINGER,
    LONGEST_SILENCE,
    POLL,
    RESEND,
    GoalClient,
    GoalEnded,
    GoalProgress,
    GoalSilent,
)
from robotree.protocol.services.goal_server import (
    CAPACITY,
    FORGOTTEN,
    PROGRESS_PERIOD,
    Abandon,
    Begin,
    GoalId,
    GoalServer,
    Refusal,
)
from robotree.protocol.services.peer import Peer, Send


def pursuing(ttl: float = 0.0) -> GoalClient:
    """A client that has said goal 7 at 0 s, which lives for `ttl` [s]; 0: for ever."""
    client = GoalClient(1, 1, via="link 1")
    client.start(7, Verb.GO_TO, (0.5, 0.0, 0.2), epoch=3, now=0.0, ttl=ttl)
    return client


def sent(effects: Iterable[object]) -> list[AnyMessage]:
    """The messages that are to be sent."""
    return [each.message for each in effects if isinstance(each, Send)]


PROXY = Peer("link 1", 255, 190)
OTHER = Peer("link 2", 254, 190)
ID = GoalId(255, 190, 7)


def _refuse_far_points(goal: Goal) -> Refusal | None:
    return (Reason.OUT_OF_REACH, "x is 9 m away; the arm reaches 0.9 m.") if goal.args[0] > 1 else None


@pytest.fixture
def server() -> GoalServer:
    return GoalServer([Verb.GO_TO, Verb.HOLD], _refuse_far_points)


def _goal(key: int = 7, *, epoch: int = 1, ttl_ms: int = 0, x: float = 0.5, verb: int = Verb.GO_TO) -> Goal:
    return Goal(key, epoch, ttl_ms, (x, math.nan, 0.0, 0.0, 0.0, 0.0, 0.0), verb, 1, 1)


def _statuses(effects: list[object]) -> list[GoalStatus]:
    messages = [each.message for each in effects if isinstance(each, Send)]
    return [message for message in messages if isinstance(message, GoalStatus)]


def _one(effects: list[object]) -> GoalStatus:
    (status,) = _statuses(effects)
    return status


def test_a_new_goal_is_accepted_and_begun_once(server: GoalServer) -> None:
    effects = server.receive(_goal(), PROXY, 0.0)
    assert [each for each in effects if isinstance(each, Begin)] == [Begin(ID, Verb.GO_TO, effects[1].args)]  # type: ignore[union-attr]  # Begin
    status = _one([*effects])
    assert (status.state, status.target_system, status.target_component) == (GoalState.ACCEPTED, 255, 190)
    assert effects[0] == Send(status, "link 1")


def test_the_same_goal_again_replays_its_status_and_does_not_move(server: GoalServer) -> None:
    first = _one([*server.receive(_goal(), PROXY, 0.0)])
    assert server.receive(_goal(), PROXY, 1.0) == [Send(first, "link 1")]
    server.activate(ID, 1.0)
    server.finish(ID, GoalState.SUCCEEDED, 2.0)
    (replay,) = server.receive(_goal(), PROXY, 3.0)
    assert _one([replay]).state == GoalState.SUCCEEDED
    assert _one([replay]).progress == 1.0


def test_nan_arguments_are_the_same_content(server: GoalServer) -> None:
    server.receive(_goal(), PROXY, 0.0)
    assert _one([*server.receive(_goal(), PROXY, 1.0)]).reason == Reason.NONE


def test_other_content_under_a_used_key_is_refused_and_the_goal_goes_on(server: GoalServer) -> None:
    server.receive(_goal(), PROXY, 0.0)
    status = _one([*server.receive(_goal(x=0.6), PROXY, 1.0)])
    assert (status.state, status.reason) == (GoalState.REFUSED, Reason.KEY_REUSED)
    assert server.unfinished == [ID]
    assert server.asker(ID) == PROXY


def test_who_reuses_a_key_on_another_link_is_not_told_of_the_goal_that_goes_on(server: GoalServer) -> None:
    server.receive(_goal(), PROXY, 0.0)
    server.receive(_goal(x=0.6), Peer("link 3", 255, 190), 0.1)
    (told,) = server.finish(ID, GoalState.SUCCEEDED, 1.0)
    assert isinstance(told, Send)
    assert told.via == PROXY.via


def test_a_goal_may_be_asked_for_again_under_a_newer_lease_and_on_another_link(server: GoalServer) -> None:
    server.receive(_goal(epoch=1), PROXY, 0.0)
    back = Peer("link 3", 255, 190)
    effects = server.receive(_goal(epoch=5), back, 1.0)
    assert effects == [Send(_one([*effects]), "link 3")]
    assert server.epoch == 5
    assert server.finish(ID, GoalState.SUCCEEDED, 2.0)[0] == Send(
        _one([*server.receive(_goal(epoch=5), back, 2.0)]), "link 3"
    )


def test_a_smaller_epoch_is_refused_and_nothing_is_remembered(server: GoalServer) -> None:
    server.receive(_goal(1, epoch=4), PROXY, 0.0)
    status = _one([*server.receive(_goal(2, epoch=3), OTHER, 1.0)])
    assert (status.state, status.reason, status.epoch) == (GoalState.REFUSED, Reason.STALE_EPOCH, 4)
    assert any(isinstance(each, Begin) for each in server.receive(_goal(2, epoch=4), OTHER, 2.0))


def test_two_senders_may_use_the_same_key(server: GoalServer) -> None:
    server.receive(_goal(), PROXY, 0.0)
    assert any(isinstance(each, Begin) for each in server.receive(_goal(x=0.1), OTHER, 0.0))
    assert len(server.unfinished) == 2


@pytest.mark.parametrize(
    ("goal", "reason"),
    [
        (_goal(x=9.0), Reason.OUT_OF_REACH),
        (_goal(x=math.inf), Reason.BAD_ARGUMENT),
        (_goal(0), Reason.BAD_ARGUMENT),
        (_goal(verb=Verb.GRIP), Reason.UNKNOWN_VERB),
        (_goal(verb=999), Reason.UNKNOWN_VERB),
    ],
)
def test_a_goal_that_cannot_be_begun_is_refused_with_its_reason(
    server: GoalServer, goal: Goal, reason: Reason
) -> None:
    effects = server.receive(goal, PROXY, 0.0)
    status = _one([*effects])
    assert (status.state, status.reason) == (GoalState.REFUSED, reason)
    assert status.text.endswith(".")
    assert len(effects) == 1
    assert server.receive(goal, PROXY, 1.0) == effects


def test_a_long_reason_is_cut_between_letters() -> None:
    server = GoalServer([Verb.GO_TO], lambda _: (Reason.FAULT, "ä" * 50))
    assert _one([*server.receive(_goal(), PROXY, 0.0)]).text == "ä" * 40
    Frame.of(_one([*server.receive(_goal(), PROXY, 0.0)]))


def test_the_end_of_the_time_to_live_is_announced_without_being_asked(server: GoalServer) -> None:
    server.receive(_goal(ttl_ms=1500), PROXY, 10.0)
    assert server.tick(11.4) == []
    abandon, send = server.tick(11.5)
    assert abandon == Abandon(ID, Reason.NONE)
    assert _one([send]).state == GoalState.EXPIRED
    assert server.tick(12.0) == []


def test_progress_is_told_now_and_then_and_every_change_at_once(server: GoalServer) -> None:
    server.receive(_goal(), PROXY, 0.0)
    assert _one([*server.activate(ID, 0.0)]).state == GoalState.ACTIVE
    assert server.activate(ID, 0.0) == []
    told = [_statuses([*server.progress(ID, i / 100, i / 100)]) for i in range(101)]
    assert len([each for each in told if each]) == pytest.approx(1.0 / PROGRESS_PERIOD, abs=1)
    assert _one([*server.finish(ID, GoalState.SUCCEEDED, 1.0)]).progress == 1.0
    numbers = [status.sequence for each in told for status in each]
    assert numbers == sorted(set(numbers))


def test_nothing_follows_the_end(server: GoalServer) -> None:
    server.receive(_goal(), PROXY, 0.0)
    server.finish(ID, GoalState.FAILED, 1.0, Reason.BLOCKED, "The lever is in the way.")
    assert server.progress(ID, 0.5, 2.0) == server.activate(ID, 2.0) == []
    assert server.finish(ID, GoalState.SUCCEEDED, 2.0) == []
    assert server.finish(GoalId(1, 1, 1), GoalState.SUCCEEDED, 2.0) == []
    with pytest.raises(ValueError, match="does not end a goal"):
        server.finish(ID, GoalState.ACTIVE, 2.0)


def test_a_cancelled_goal_is_abandoned_and_the_cancel_may_be_repeated(server: GoalServer) -> None:
    server.receive(_goal(), PROXY, 0.0)
    abandon, send = server.receive(GoalCancel(7, 1, 1, 1), PROXY, 1.0)
    assert abandon == Abandon(ID, Reason.OPERATOR)
    assert _one([send]).state == GoalState.CANCELLED
    assert server.receive(GoalCancel(7, 1, 1, 1), PROXY, 2.0) == [send]


def test_a_cancel_that_overtakes_its_goal_keeps_it_from_beginning(server: GoalServer) -> None:
    assert _one([*server.receive(GoalCancel(7, 1, 1, 1), PROXY, 0.0)]).state == GoalState.UNKNOWN
    assert _one([*server.receive(_goal(), PROXY, 0.1)]).state == GoalState.UNKNOWN
    assert server.unfinished == []


def test_key_zero_cancels_whatever_is_active_unless_the_epoch_is_over(server: GoalServer) -> None:
    server.receive(_goal(epoch=3), PROXY, 0.0)
    stale = server.receive(GoalCancel(0, 2, 1, 1), OTHER, 1.0)
    assert _one([*stale]).reason == Reason.STALE_EPOCH
    assert server.unfinished == [ID]
    effects = server.receive(GoalCancel(0, 3, 1, 1), OTHER, 1.0)
    assert Abandon(ID, Reason.OPERATOR) in effects
    assert _one([*effects]).target_system == PROXY.system


def test_a_stop_abandons_everything(server: GoalServer) -> None:
    for key in (1, 2, 3):
        server.receive(_goal(key), PROXY, 0.0)
    effects = server.abandon_all(Reason.STOPPED, 1.0, "A safe stop is in force.")
    assert [each.id.key for each in effects if isinstance(each, Abandon)] == [1, 2, 3]
    assert {status.state for status in _statuses([*effects])} == {GoalState.CANCELLED}


def test_asking_for_a_status_begins_nothing(server: GoalServer) -> None:
    assert _one([*server.receive(_goal(verb=Verb.STATUS), PROXY, 0.0)]).state == GoalState.UNKNOWN
    server.receive(_goal(), PROXY, 1.0)
    assert _one([*server.receive(_goal(verb=Verb.STATUS), PROXY, 2.0)]).state == GoalState.ACCEPTED


def test_the_table_is_bounded_and_a_forgotten_key_still_begins_nothing(server: GoalServer) -> None:
    for key in range(1, CAPACITY + FORGOTTEN):
        server.receive(_goal(key), PROXY, 0.0)
        server.finish(GoalId(255, 190, key), GoalState.SUCCEEDED, 0.0)
    assert len(server._records) <= CAPACITY
    assert sum(map(len, server._forgotten.values())) <= FORGOTTEN
    assert _one([*server.receive(_goal(1), PROXY, 1.0)]).state == GoalState.UNKNOWN
    assert server.unfinished == []


@pytest.mark.parametrize("speakers", [1, 50])
def test_no_flood_of_cancels_makes_a_goal_begin_that_another_called_off(
    server: GoalServer, speakers: int
) -> None:
    for key in (6, 7):
        server.receive(GoalCancel(key, 1, 1, 1), PROXY, 0.0)
    for key in range(1, FORGOTTEN + 200):
        server.receive(GoalCancel(key, 1, 1, 1), Peer("link 2", 254, key % speakers), 0.0)
    assert sum(map(len, server._forgotten.values())) == FORGOTTEN
    server.receive(_goal(7), PROXY, 1.0)
    assert server.unfinished == []


def test_a_table_full_of_unfinished_goals_refuses_the_next(server: GoalServer) -> None:
    for key in range(1, CAPACITY + 1):
        server.receive(_goal(key), PROXY, 0.0)
    status = _one([*server.receive(_goal(CAPACITY + 1), PROXY, 0.0)])
    assert (status.state, status.reason) == (GoalState.REFUSED, Reason.FAULT)
    server.finish(GoalId(255, 190, 5), GoalState.SUCCEEDED, 1.0)
    assert any(isinstance(each, Begin) for each in server.receive(_goal(CAPACITY + 1), PROXY, 1.0))


# Both sides.


@pytest.fixture
def client() -> GoalClient:
    return pursuing()


@pytest.fixture
def brief() -> GoalClient:
    """Pursues a goal that lives for 1 s."""
    return pursuing(ttl=1.0)


def test_a_repeated_goal_carries_the_time_that_is_left_and_is_the_same_goal(
    brief: GoalClient, server: GoalServer
) -> None:
    repeated = [each for i in range(1, 40) for each in sent([*brief.tick(i * RESEND / 10)])]
    goals = [each for each in repeated if isinstance(each, Goal)]
    assert [goal.ttl_ms for goal in goals] == [750, 500, 250]
    assert [each for goal in goals for each in server.receive(goal, PROXY, 1.0) if isinstance(each, Begin)]
    assert server.unfinished == [ID]
    assert {each.reason for goal in goals for each in _statuses([*server.receive(goal, PROXY, 1.0)])} == {0}


def test_a_goal_whose_time_is_over_before_it_was_heard_is_called_off_and_has_expired(
    brief: GoalClient, server: GoalServer
) -> None:
    (late,) = sent([*brief.tick(RESEND)])
    (cancel,) = sent([*brief.tick(1.0)])
    assert cancel == GoalCancel(7, 3, 1, 1)
    assert sent([*brief.tick(1.0 + RESEND)]) == [cancel], "the goal is repeated no more"
    assert isinstance(cancel, GoalCancel)
    assert isinstance(late, Goal)
    unknown = _one([*server.receive(cancel, PROXY, 1.3)])
    assert brief.receive(unknown, 1.4) == [GoalEnded(7, GoalState.EXPIRED, Reason.NONE, "")]
    assert brief.pursued == []
    server.receive(late, PROXY, 1.5)
    assert server.unfinished == [], "one that is still under way begins nothing"


def test_a_goal_that_was_reached_in_time_is_so_though_the_answers_were_lost(
    brief: GoalClient, server: GoalServer
) -> None:
    (goal,) = sent([*brief.tick(RESEND)])
    assert isinstance(goal, Goal)
    server.receive(goal, PROXY, 0.3)
    server.finish(ID, GoalState.SUCCEEDED, 0.5)
    (cancel,) = sent([*brief.tick(1.0)])
    assert isinstance(cancel, GoalCancel)
    (end,) = brief.receive(_one([*server.receive(cancel, PROXY, 1.1)]), 1.2)
    assert end == GoalEnded(7, GoalState.SUCCEEDED, Reason.NONE, "")


def test_who_may_not_command_is_refused_raises_no_epoch_and_may_ask_again() -> None:
    allowed: set[int] = set()
    denial = (Reason.NOT_IN_CONTROL, "System 9 is in control.")
    server = GoalServer([Verb.HOLD], lambda _: None, lambda peer: None if peer.system in allowed else denial)
    asked = Goal(1, 5, 0, (0.0,) * 7, Verb.HOLD, 1, 1)
    (refused,) = server.receive(asked, Peer("link", 255, 190), 0.0)
    assert isinstance(refused, Send)
    assert isinstance(refused.message, GoalStatus)
    assert (refused.message.state, refused.message.reason) == (GoalState.REFUSED, Reason.NOT_IN_CONTROL)
    assert server.epoch == 0
    allowed.add(255)
    assert any(isinstance(each, Begin) for each in server.receive(asked, Peer("link", 255, 190), 0.0))


# Operator control: OWNER is in control, BACK has its ids on another link, STRANGER others.

OWNER, BACK, STRANGER = PROXY, Peer("link 3", 255, 190), OTHER


@pytest.fixture
def owned() -> GoalServer:
    """A server on which one peer is in control, with a goal of this peer under epoch 1."""
    denial = (Reason.NOT_IN_CONTROL, "System 255 is in control; ask it, or wait.")
    server = GoalServer([Verb.GO_TO], lambda _: None, lambda peer: None if peer == OWNER else denial)
    server.receive(_goal(), OWNER, 0.0)
    return server


@pytest.mark.parametrize("peer", [STRANGER, BACK])
def test_who_is_not_in_control_cancels_whatever_runs_and_raises_no_epoch(
    owned: GoalServer, peer: Peer
) -> None:
    effects = owned.receive(GoalCancel(0, 9, 1, 1), peer, 1.0)
    assert Abandon(ID, Reason.OPERATOR) in effects
    assert owned.epoch == 1
    assert any(isinstance(each, Begin) for each in owned.receive(_goal(8), OWNER, 2.0))


@pytest.mark.parametrize("word", [_goal(epoch=9), _goal(verb=Verb.STATUS, epoch=9), _goal(epoch=0)])
def test_who_is_not_in_control_is_answered_and_takes_no_goal_over(owned: GoalServer, word: Goal) -> None:
    (told,) = owned.receive(word, BACK, 1.0)
    assert isinstance(told, Send)
    assert (told.via, _one([told]).state) == (BACK.via, GoalState.ACCEPTED)
    assert owned.asker(ID) == OWNER
    assert owned.epoch == 1


def test_who_is_in_control_hears_that_another_one_has_cancelled_its_goal(owned: GoalServer) -> None:
    abandon, *told = owned.receive(GoalCancel(7, 0, 1, 1), BACK, 1.0)
    assert abandon == Abandon(ID, Reason.OPERATOR)
    assert [each.via for each in told if isinstance(each, Send)] == [OWNER.via, BACK.via]
    assert {status.state for status in _statuses([*told])} == {GoalState.CANCELLED}
    (again,) = owned.receive(GoalCancel(7, 0, 1, 1), BACK, 2.0)
    assert isinstance(again, Send)
    assert again.via == BACK.via


def test_who_calls_a_goal_of_a_former_life_off_hears_that_it_may_have_begun() -> None:
    server = GoalServer([Verb.GO_TO], lambda _: None, life=2)
    for _ in range(2):
        effects = server.receive(GoalCancel(7, 1, 1, 1, 1), PROXY, 0.0)
        (status,) = _statuses([*effects])
        assert (status.state, status.reason) == (GoalState.UNKNOWN, Reason.OTHER_LIFE)


def _status(state: GoalState, *, key: int = 7, sequence: int = 1, reason: Reason = Reason.NONE) -> GoalStatus:
    return GoalStatus(key, 1, 0.5, sequence, reason, 255, 190, state, "")


def test_a_goal_is_padded_with_as_it_is_now() -> None:
    (send,) = GoalClient(1, 2).start(7, Verb.GO_TO, (0.5,), epoch=3, now=0.0, ttl=2.0)
    assert isinstance(send, Send)
    goal = send.message
    assert isinstance(goal, Goal)
    assert (goal.key, goal.epoch, goal.ttl_ms) == (7, 3, 2000)
    assert (goal.target_system, goal.target_component) == (1, 2)
    assert goal.args[0] == 0.5
    assert all(map(math.isnan, goal.args[1:]))


def test_an_unanswered_goal_is_repeated_with_its_key(client: GoalClient) -> None:
    assert client.tick(RESEND * 0.9) == []
    (again,) = sent([*client.tick(RESEND)])
    assert isinstance(again, Goal)
    assert (again.key, again.verb) == (7, Verb.GO_TO)
    assert client.tick(RESEND) == []


def test_the_shortest_time_to_live_is_not_for_ever() -> None:
    (send,) = GoalClient(1, 2).start(7, Verb.GO_TO, (0.5,), epoch=3, now=0.0, ttl=0.0001)
    assert isinstance(send, Send)
    assert isinstance(send.message, Goal)
    assert send.message.ttl_ms == 1


def test_an_acknowledged_goal_is_only_asked_for(client: GoalClient) -> None:
    assert client.receive(_status(GoalState.ACCEPTED), 0.1) == [GoalProgress(7, GoalState.ACCEPTED, 0.5)]
    assert client.tick(0.1 + POLL * 0.9) == []
    (question,) = sent([*client.tick(0.1 + POLL)])
    assert isinstance(question, Goal)
    assert question.verb == Verb.STATUS


def test_old_news_is_no_news_but_the_end_is(client: GoalClient) -> None:
    assert client.receive(_status(GoalState.ACTIVE, sequence=65535), 0.1)
    assert client.receive(_status(GoalState.ACTIVE, sequence=65535), 0.2) == []
    assert client.receive(_status(GoalState.ACTIVE, sequence=65530), 0.3) == []
    newer = client.receive(_status(GoalState.ACTIVE, sequence=2), 0.4)
    assert newer == [GoalProgress(7, GoalState.ACTIVE, 0.5)]
    end = client.receive(_status(GoalState.FAILED, sequence=1, reason=Reason.BLOCKED), 0.5)
    assert end == [GoalEnded(7, GoalState.FAILED, Reason.BLOCKED, "")]
    assert client.pursued == []
    assert client.receive(_status(GoalState.FAILED, sequence=3), 0.6) == []


def test_silence_is_told_once_and_ends_with_the_next_word(client: GoalClient) -> None:
    client.receive(_status(GoalState.ACTIVE), 0.1)
    heard = [each for i in range(80) for each in client.tick(i / 10) if isinstance(each, GoalSilent)]
    assert heard == [GoalSilent(7, acknowledged=True)]
    assert client.receive(_status(GoalState.ACTIVE, sequence=2), 8.0)
    assert not any(isinstance(each, GoalSilent) for each in client.tick(8.0 + LONGEST_SILENCE * 0.9))
    assert any(isinstance(each, GoalSilent) for each in client.tick(8.0 + LONGEST_SILENCE))


def test_a_link_that_comes_back_late_does_not_start_a_movement(client: GoalClient) -> None:
    effects = [each for i in range(200) for each in client.tick(i / 10)]
    assert GoalSilent(7, acknowledged=False) in effects
    late = [each for i in range(31, 200) for each in sent([*client.tick(20 + i / 10)])]
    assert {each.verb for each in late if isinstance(each, Goal)} == {Verb.STATUS}
    assert client.receive(_status(GoalState.UNKNOWN, sequence=0), 60.0) == [
        GoalEnded(7, GoalState.UNKNOWN, Reason.NONE, "")
    ]


def test_a_cancel_is_repeated_until_the_end_is_heard(client: GoalClient) -> None:
    client.receive(_status(GoalState.ACTIVE), 0.1)
    (cancel,) = sent([*client.cancel(7, epoch=4, now=0.2)])
    assert cancel == GoalCancel(7, 4, 1, 1)
    assert sent([*client.tick(0.2 + RESEND)]) == [cancel]
    client.receive(_status(GoalState.CANCELLED, sequence=2), 0.5)
    assert client.tick(5.0) == []


def test_a_cancelled_goal_of_which_nothing_is_heard_is_let_go_after_its_time(client: GoalClient) -> None:
    client.start(8, Verb.GO_TO, (0.5, 0.0, 0.2), epoch=3, now=0.0, ttl=60.0)
    client.start(9, Verb.GO_TO, (0.5, 0.0, 0.2), epoch=3, now=0.0, ttl=60.0)
    client.receive(_status(GoalState.ACTIVE, key=9), 0.1)
    for key in (7, 8, 9):
        client.cancel(key, epoch=3, now=1.0)
    for second in range(1, 100):
        client.tick(float(second))
        client.receive(_status(GoalState.ACTIVE, key=9, sequence=second), second + 0.5)
        assert (8 in client.pursued) == (second < 60.0 + LINGER), "till then it might still move"
    assert client.pursued == [7, 9], "one may move for ever, the other one moves"


def test_a_controller_that_answers_no_goals_is_not_asked_about_ever_more_of_them() -> None:
    client, said = GoalClient(1, 1), 0
    for second in range(1000):
        client.start(second + 1, Verb.HOLD, (), epoch=3, now=float(second), ttl=5.0)
        said = len(sent([*client.tick(second + 0.5)]))
    assert said <= 5.0 + LINGER + 1
    assert len(client.pursued) <= 5.0 + LINGER + 1


def test_what_is_not_ours_or_makes_no_sense_is_passed_over(client: GoalClient) -> None:
    assert client.receive(_status(GoalState.ACTIVE, key=8), 0.1) == []
    assert client.receive(GoalStatus(7, 1, 0.5, 1, 0, 255, 190, 99, ""), 0.1) == []
    assert client.receive(_status(GoalState.UNKNOWN), 0.1) == []
    assert client.pursued == [7]
    client.forget(7)
    assert client.tick(100.0) == []


def test_a_goal_that_was_refused_for_another_holder_is_called_off_before_its_end_is_told(
    client: GoalClient,
) -> None:
    refused = _status(GoalState.REFUSED, sequence=0, reason=Reason.NOT_IN_CONTROL)
    (cancel,) = sent([*client.receive(refused, 0.1)])
    assert isinstance(cancel, GoalCancel)
    assert client.receive(refused, 0.15) == [], "the answer to a repetition that was on its way"
    (again,) = sent([*client.tick(0.2 + RESEND)])
    assert isinstance(again, GoalCancel)
    assert client.receive(_status(GoalState.UNKNOWN, sequence=0), 0.4) == [
        GoalEnded(7, GoalState.REFUSED, Reason.NOT_IN_CONTROL, "")
    ]
    assert client.pursued == []


def test_a_repetition_that_began_after_the_refusal_ends_as_what_it_was(client: GoalClient) -> None:
    client.receive(_status(GoalState.REFUSED, sequence=0, reason=Reason.NOT_IN_CONTROL), 0.1)
    cancelled = _status(GoalState.CANCELLED, sequence=3, reason=Reason.OPERATOR)
    assert client.receive(cancelled, 0.2) == [GoalEnded(7, GoalState.CANCELLED, Reason.OPERATOR, "")]
