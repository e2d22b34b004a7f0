"""Commands: carried out once although they are repeated, except for questions and stops."""

from __future__ import annotations

import math

import pytest

from robotree.protocol.messages import (
    CommandAck,
    CommandCancel,
    CommandInt,
    CommandLong,
    MavCmd,
    MavResult,
    Message,
    Timesync,
)
from robotree.protocol.services.command import (
    COUNTED_REPETITION,
    MAX_PEERS,
    PROGRESS_PERIOD,
    REPETITION,
    Answer,
    CommandAbandoned,
    CommandServer,
    Request,
)
from robotree.protocol.services.command_client import (
    ATTEMPTS,
    LONGEST_SILENCE,
    RESEND,
    CommandClient,
    CommandDone,
)
from robotree.protocol.services.peer import Peer, Send

PEER, OTHER = Peer("link 1", 255, 190), Peer("link 2", 255, 190)
GRIP, MOVE, ASK, STOP = MavCmd.DO_GRIPPER, MavCmd.DO_SET_ACTUATOR, MavCmd.REQUEST_MESSAGE, 185


class Robot:
    """Counts what it is asked to do."""

    def __init__(self) -> None:
        self.done: list[Request] = []
        self.server = CommandServer({GRIP: self.grip, MOVE: self.move}, {ASK: self.answer, STOP: self.grip})

    def grip(self, request: Request, _: float) -> Answer:
        self.done.append(request)
        return Answer(MavResult.ACCEPTED, detail=7)

    def move(self, request: Request, _: float) -> Answer:
        self.done.append(request)
        return Answer(MavResult.IN_PROGRESS)

    def answer(self, request: Request, _: float) -> Answer:
        self.done.append(request)
        return Answer(MavResult.ACCEPTED, messages=(Timesync(1, 2),))


@pytest.fixture
def robot() -> Robot:
    return Robot()


def _long(command: int, *params: float, confirmation: int = 0) -> CommandLong:
    return CommandLong(1, 1, command, confirmation, *params, *[math.nan] * (7 - len(params)))


def _acks(effects: list[object]) -> list[tuple[object, int, int]]:
    sends = [each for each in effects if isinstance(each, Send)]
    return [
        (each.via, each.message.result, each.message.progress)
        for each in sends
        if isinstance(each.message, CommandAck)
    ]


def test_a_command_is_answered_to_the_one_who_asked_on_the_link_that_asked(robot: Robot) -> None:
    (send,) = robot.server.receive(_long(GRIP, 1.0), OTHER, 0.0)
    assert send == Send(CommandAck(GRIP, MavResult.ACCEPTED, 0, 7, 255, 190), "link 2")
    assert robot.done[0].param(1) == 1.0
    assert robot.done[0].param(2, default=3.0) == 3.0, "NaN means the default"


def test_a_repetition_is_answered_again_and_not_carried_out_again(robot: Robot) -> None:
    first = robot.server.receive(_long(GRIP, 1.0), PEER, 0.0)
    assert robot.server.receive(_long(GRIP, 1.0), PEER, REPETITION * 0.9) == first
    later = (REPETITION + COUNTED_REPETITION) * 0.9
    assert robot.server.receive(_long(GRIP, 1.0, confirmation=3), PEER, later) == first
    assert len(robot.done) == 1
    robot.server.receive(_long(GRIP, 1.0), PEER, later)
    assert len(robot.done) == 2, "without a count it is a new one by then"


def test_a_new_order_whose_first_frame_was_lost_is_carried_out(robot: Robot) -> None:
    first = robot.server.receive(_long(GRIP, 1.0), PEER, 0.0)
    assert robot.server.receive(_long(GRIP, 1.0, confirmation=1), PEER, COUNTED_REPETITION) == first
    assert len(robot.done) == 2
    assert robot.server.receive(_long(GRIP, 1.0, confirmation=2), PEER, COUNTED_REPETITION + 3.0) == first
    assert len(robot.done) == 2, "and once, however often it is repeated"


def test_a_new_order_after_a_failure_long_ago_is_carried_out_though_its_first_frame_was_lost(
    robot: Robot,
) -> None:
    robot.server.receive(_long(MOVE), PEER, 0.0)
    robot.server.finish(PEER, MOVE, MavResult.FAILED, 1.0)
    told = robot.server.receive(_long(MOVE, confirmation=1), PEER, 1.0 + COUNTED_REPETITION)
    assert _acks([*told]) == [("link 1", MavResult.IN_PROGRESS, 255)]
    assert len(robot.done) == 2


def test_after_something_else_was_done_only_a_counted_repetition_is_one(robot: Robot) -> None:
    turn = 0
    server = CommandServer({GRIP: robot.grip}, {}, turn=lambda: turn)
    first = server.receive(_long(GRIP, 1.0), PEER, 0.0)
    turn += 1
    assert server.receive(_long(GRIP, 1.0, confirmation=1), PEER, 0.1) == first
    assert len(robot.done) == 1
    assert server.receive(_long(GRIP, 1.0), PEER, 0.2) == first
    assert len(robot.done) == 2, "who orders it again means it"


def test_other_content_another_peer_or_another_link_is_a_new_command(robot: Robot) -> None:
    for message, peer in [(_long(GRIP, 1.0), PEER), (_long(GRIP, 0.0), PEER), (_long(GRIP, 0.0), OTHER)]:
        robot.server.receive(message, peer, 0.0)
    assert len(robot.done) == 3


def test_questions_and_stops_are_carried_out_every_time_for_anyone(robot: Robot) -> None:
    for _ in range(3):
        effects = robot.server.receive(_long(ASK, 1.0), PEER, 0.0)
        assert effects[1] == Send(Timesync(1, 2), "link 1")
        robot.server.receive(_long(STOP, 1.0), PEER, 0.0)
    assert len(robot.done) == 6


def test_what_is_carried_out_every_time_is_told_of_its_repetition_if_its_answer_is_remembered() -> None:
    release, stop, told = 1.0, 0.0, list[bool]()

    def handle(request: Request, _: float) -> Answer:
        told.append(request.repeated)
        result = MavResult.DENIED if len(told) == 1 else MavResult.ACCEPTED
        return Answer(result, remembered=request.param(1) == release)

    server = CommandServer({}, {STOP: handle})
    for moment, param, confirmation, repeated in [
        (0.0, release, 0, False),
        (1.0, release, 1, True),
        (2.0, release, 1, False),
        (3.0, stop, 2, False),
        (4.0, stop, 3, False),
        (5.0, release, 2, True),
        (6.0, release, 0, False),
        (6.0 + COUNTED_REPETITION, release, 1, False),
    ]:
        server.receive(_long(STOP, param, confirmation=confirmation), PEER, moment)
        assert told[-1] is repeated, moment
    server.receive(_long(STOP, release, confirmation=2), OTHER, 6.0 + COUNTED_REPETITION)
    assert told[-1] is False, "that was somebody else's order"


@pytest.mark.parametrize("command", [GRIP, MOVE])
def test_who_says_every_order_with_the_same_confirmation_is_obeyed_each_time(
    robot: Robot, command: int
) -> None:
    """MAVROS says 1, always."""
    for i in range(3):
        now = i * (REPETITION + 1.0)
        robot.server.receive(_long(command, confirmation=1), PEER, now)
        robot.server.receive(_long(command, confirmation=1), PEER, now + 0.1)
        robot.server.finish(PEER, command, MavResult.ACCEPTED, now + 0.2)
    assert len(robot.done) == 3


def test_an_unknown_command_is_unsupported(robot: Robot) -> None:
    assert _acks([*robot.server.receive(_long(31000), PEER, 0.0)]) == [("link 1", MavResult.UNSUPPORTED, 0)]


def test_the_integer_form_says_the_same(robot: Robot) -> None:
    robot.server.receive(CommandInt(1, 1, 0, GRIP, 0, 0, 1.0, 2.0, 3.0, 4.0, 5, 0x7FFFFFFF, 7.0), PEER, 0.0)
    params = robot.done[0].params
    assert params[:5] == (1.0, 2.0, 3.0, 4.0, 5.0)
    assert math.isnan(params[5])
    assert params[6] == 7.0


def test_a_long_command_tells_its_progress_until_the_end(robot: Robot) -> None:
    server = robot.server
    assert _acks([*server.receive(_long(MOVE), PEER, 0.0)]) == [("link 1", MavResult.IN_PROGRESS, 255)]
    assert server.progress(PEER, MOVE, 0.2, PROGRESS_PERIOD / 2) == []
    assert _acks([*server.progress(PEER, MOVE, 0.4, PROGRESS_PERIOD)]) == [
        ("link 1", MavResult.IN_PROGRESS, 40)
    ]
    assert _acks([*server.receive(_long(MOVE, confirmation=1), PEER, 0.6)]) == [
        ("link 1", MavResult.IN_PROGRESS, 40)
    ]
    assert server.tick(0.7) == []
    assert _acks([*server.tick(0.6 + PROGRESS_PERIOD)]) == [("link 1", MavResult.IN_PROGRESS, 40)]
    assert _acks([*server.finish(PEER, MOVE, MavResult.ACCEPTED, 2.0)]) == [("link 1", MavResult.ACCEPTED, 0)]
    assert server.finish(PEER, MOVE, MavResult.FAILED, 2.0) == server.progress(PEER, MOVE, 0.5, 9.0) == []
    assert server.in_progress == server.tick(10.0) == []
    assert _acks([*server.receive(_long(MOVE, confirmation=2), PEER, 2.0 + COUNTED_REPETITION * 0.9)]) == [
        ("link 1", MavResult.ACCEPTED, 0)
    ]
    assert len(robot.done) == 1


def test_a_second_command_of_the_kind_is_rejected_while_one_is_in_progress(robot: Robot) -> None:
    robot.server.receive(_long(MOVE, 1.0), PEER, 0.0)
    for message, peer in [(_long(MOVE, 2.0), PEER), (_long(MOVE, 1.0), OTHER)]:
        ((_, result, _),) = _acks([*robot.server.receive(message, peer, 0.1)])
        assert result == MavResult.TEMPORARILY_REJECTED
    assert len(robot.done) == 1


def test_a_refusal_is_not_replayed_when_what_was_in_the_way_is_gone() -> None:
    results = [MavResult.TEMPORARILY_REJECTED, MavResult.ACCEPTED]
    server = CommandServer({1: lambda _, __: Answer(results.pop(0))}, {})
    for expected in (MavResult.TEMPORARILY_REJECTED, MavResult.ACCEPTED, MavResult.ACCEPTED):
        (told,) = server.receive(CommandLong(1, 1, 1, 0, *(0.0,) * 7), Peer("link", 255, 190), 0.0)
        assert isinstance(told, Send)
        assert isinstance(told.message, CommandAck)
        assert told.message.result == expected


def test_a_cancel_stops_what_is_in_progress_and_may_be_repeated(robot: Robot) -> None:
    cancel = CommandCancel(1, 1, MOVE)
    assert robot.server.receive(cancel, PEER, 0.0) == []
    robot.server.receive(_long(MOVE), PEER, 0.0)
    assert robot.server.receive(cancel, OTHER, 0.1) == [], "only who asked may cancel"
    abandoned, send = robot.server.receive(cancel, PEER, 0.2)
    assert abandoned == CommandAbandoned(PEER, MOVE)
    assert _acks([send]) == [("link 1", MavResult.CANCELLED, 0)]
    assert robot.server.receive(cancel, PEER, 0.3) == [send]


@pytest.mark.parametrize("end", [MavResult.CANCELLED, MavResult.FAILED, MavResult.DENIED])
def test_what_ended_badly_is_not_repeated_by_time_but_ordered_anew(robot: Robot, end: MavResult) -> None:
    robot.server.receive(_long(MOVE), PEER, 0.0)
    robot.server.finish(PEER, MOVE, end, 0.2)
    told = robot.server.receive(_long(MOVE, confirmation=1), PEER, 0.3)
    assert _acks([*told]) == [("link 1", end, 0)], "a repetition that says so is one"
    told = robot.server.receive(_long(MOVE), PEER, 0.4)
    assert _acks([*told]) == [("link 1", MavResult.IN_PROGRESS, 255)]
    assert len(robot.done) == 2


def test_stored_results_are_bounded_and_what_is_in_progress_stays(robot: Robot) -> None:
    robot.server.receive(_long(MOVE), PEER, 0.0)
    for system in range(2 * MAX_PEERS):
        robot.server.receive(_long(GRIP), Peer(f"link {system}", 1, 1), 0.0)
    assert len(robot.server._records) == MAX_PEERS
    assert robot.server.in_progress == [(PEER, MOVE)]


# The side that asks.


@pytest.fixture
def client() -> CommandClient:
    return CommandClient(1, 1, via="link 1")


def _sent(effects: list[object]) -> list[Message]:
    return [each.message for each in effects if isinstance(each, Send) and isinstance(each.message, Message)]


def test_an_unanswered_command_is_repeated_and_then_given_up(client: CommandClient) -> None:
    effects: list[object] = [*client.send(GRIP, (1.0,), 0.0)]
    for i in range(1, 60):
        effects += client.tick(i * RESEND / 4)
    confirmations = [message.confirmation for message in _sent(effects) if isinstance(message, CommandLong)]
    assert confirmations == [*range(ATTEMPTS)]
    assert effects[-1] == CommandDone(GRIP, None)
    assert client.tick(100.0) == []


def test_progress_is_waited_through(client: CommandClient) -> None:
    client.send(MOVE, (), 0.0)
    assert client.receive(CommandAck(MOVE, MavResult.IN_PROGRESS, 255), 0.1) == []
    for i in range(1, 20):
        assert client.tick(float(i)) == []
        assert client.receive(CommandAck(MOVE, MavResult.IN_PROGRESS, 5 * i), float(i)) == []
    end = client.receive(CommandAck(MOVE, MavResult.ACCEPTED, 0, 9), 20.0)
    assert end == [CommandDone(MOVE, MavResult.ACCEPTED, 9)]
    assert client.receive(CommandAck(MOVE, MavResult.ACCEPTED), 20.1) == []


def test_silence_in_the_middle_is_not_waited_for_for_ever(client: CommandClient) -> None:
    client.send(MOVE, (), 0.0)
    client.receive(CommandAck(MOVE, MavResult.IN_PROGRESS, 10), 1.0)
    assert client.tick(1.0 + LONGEST_SILENCE * 0.9) == []
    cancel, done = client.tick(1.0 + LONGEST_SILENCE)
    assert _sent([cancel]) == [CommandCancel(1, 1, MOVE)], "it may run all the same"
    assert done == CommandDone(MOVE, None)


def test_commands_of_a_kind_wait_for_each_other_and_other_kinds_do_not(client: CommandClient) -> None:
    assert len(client.send(GRIP, (1.0,), 0.0)) == 1
    assert client.send(GRIP, (0.0,), 0.0) == []
    assert len(client.send(MOVE, (), 0.0)) == 1
    done, following = client.receive(CommandAck(GRIP, MavResult.ACCEPTED), 0.1)
    assert done == CommandDone(GRIP, MavResult.ACCEPTED)
    (message,) = _sent([following])
    assert isinstance(message, CommandLong)
    assert message.param1 == 0.0


@pytest.mark.parametrize("when", ["before", "after"])
def test_the_answer_to_a_repetition_does_not_end_the_next_command_of_its_kind(
    client: CommandClient, when: str
) -> None:
    client.send(GRIP, (1.0,), 0.0)
    if when == "before":
        client.send(GRIP, (0.0,), 0.0)
    client.tick(RESEND)
    ack = CommandAck(GRIP, MavResult.ACCEPTED)
    assert client.receive(ack, RESEND + 0.1) == [CommandDone(GRIP, MavResult.ACCEPTED)]
    if when == "after":
        assert client.send(GRIP, (0.0,), RESEND + 0.15) == []
    assert client.receive(ack, RESEND + 0.2) == []
    assert client.tick(2 * RESEND) == []
    (message,) = _sent([*client.tick(2 * RESEND + 0.1)])
    assert isinstance(message, CommandLong)
    assert (message.param1, message.confirmation) == (0.0, 0)
    assert client.receive(ack, 2 * RESEND + 0.2) == [CommandDone(GRIP, MavResult.ACCEPTED)]
    assert len(client.send(GRIP, (1.0,), 2 * RESEND + 0.3)) == 1, "this one was said once, so nothing waits"


@pytest.mark.parametrize("told", [(), (MavResult.IN_PROGRESS,) * 20])
def test_the_end_of_a_command_that_was_given_up_does_not_end_the_next_one_of_its_kind(
    client: CommandClient, told: tuple[MavResult, ...]
) -> None:
    effects: list[object] = [*client.send(MOVE, (1.0,), 0.0)]
    while CommandDone(MOVE, None) not in effects:
        effects += client.tick(len(effects) * RESEND)
    given_up = ATTEMPTS * RESEND
    assert client.send(MOVE, (2.0,), given_up + 0.1) == []
    for second, result in enumerate(told):
        assert client.tick(given_up + second) == []
        assert client.receive(CommandAck(MOVE, result), given_up + second) == []
    end = given_up + max(len(told), 2)
    assert client.receive(CommandAck(MOVE, MavResult.ACCEPTED), end) == [], "the first one, after all"
    assert client.tick(given_up + max(len(told) - 1, 0) + LONGEST_SILENCE - 0.1) == []
    (message,) = _sent([*client.tick(end + LONGEST_SILENCE)])
    assert isinstance(message, CommandLong)
    assert message.param1 == 2.0
    end += LONGEST_SILENCE + 0.1
    assert client.receive(CommandAck(MOVE, MavResult.DENIED), end) == [CommandDone(MOVE, MavResult.DENIED)]
