"""Stories of goals as seen by the client that asks for them: the answers are the test's."""

from __future__ import annotations

import math

import pytest

from robotree.protocol.messages import Goal, GoalCancel, GoalState, GoalStatus, Reason, Verb
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
from robotree.protocol.services.peer import Send
from tests.protocol.goals import pursuing, sent


def _status(state: GoalState, *, key: int = 7, sequence: int = 1, reason: Reason = Reason.NONE) -> GoalStatus:
    return GoalStatus(key, 1, 0.5, sequence, reason, 255, 190, state, "")


@pytest.fixture
def client() -> GoalClient:
    return pursuing()


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
