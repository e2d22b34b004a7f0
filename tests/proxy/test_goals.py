"""Goals of a proxy: how a motion reads on the wire, when it is repeated, how its end comes to the caller."""

from __future__ import annotations

import math
import re
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol.dialect import compile as compiler
from robotree.protocol.frame import Frame, encode
from robotree.protocol.messages import (
    AnyMessage,
    Goal,
    GoalCancel,
    GoalState,
    Heartbeat,
    Mode,
    ModeKind,
    Reason,
    Verb,
)
from robotree.protocol.parser import Parser
from robotree.protocol.services.goal_client import RESEND, GoalClient, GoalEnded
from robotree.protocol.services.peer import Send
from robotree.proxy.arm import GoTo, Grip
from robotree.proxy.connection import Connection
from robotree.proxy.guard import Limits
from robotree.proxy.kinds import KINDS
from robotree.proxy.motion import Hold, Motion, Request
from robotree.proxy.outcome import SENTENCES, error_of, explain, silence_in_words
from robotree.proxy.pending_goals import NotSent, PendingGoals
from robotree.proxy.rover import Move
from robotree.proxy.session import ControllerSession
from robotree.vr.base.errors import (
    CommandCancelled,
    CommandFailed,
    CommandInDoubt,
    DeadlineExceeded,
    StaleEpoch,
    VrError,
)

MOTIONS: dict[Verb, type[Motion]] = {Verb.GO_TO: GoTo, Verb.GRIP: Grip, Verb.MOVE: Move, Verb.HOLD: Hold}
XML = Path(compiler.DIALECT).with_name("robotree.xml")
numbers = st.floats(-10, 10, width=32)


def arguments(verb: Verb) -> list[str]:
    """What the dialect says that the arguments of a verb are, in order, without units."""
    entry = rf'name="ROBOTREE_VERB_{verb.name}">\s*<description>(.*?)</description>'
    (said,) = re.findall(entry, XML.read_text(), re.DOTALL)
    return re.findall(r"\w+", re.sub(r"\[[^]]*\]", "", said.partition("args: ")[2]))


@pytest.mark.parametrize("verb", MOTIONS)
@given(data=st.data())
def test_a_motion_crosses_the_wire_with_the_arguments_of_its_verb_in_the_dialects_order(
    verb: Verb, data: st.DataObject
) -> None:
    names = [field.name for field in fields(MOTIONS[verb])]
    motion = MOTIONS[verb](**{name: data.draw(numbers) for name in names})
    request = motion.request()
    (send,) = GoalClient(1, 1).start(7, request.verb, request.args, epoch=3, now=0.0)
    assert isinstance(send, Send)
    (frame,) = Parser().feed(encode(send.message, sequence=0, system=255, component=190))
    goal = frame.message
    assert isinstance(goal, Goal)
    assert goal.verb == verb
    said = [name.removeprefix("d") for name in arguments(verb)]
    assert said == names, "the dialect names them in this order"
    assert goal.args[: len(said)] == tuple(getattr(motion, name) for name in said)
    assert all(math.isnan(rest) for rest in goal.args[len(said) :])


COUNTS = {"hand", "number"}
"""Limits of whole numbers, which have no unit."""


@pytest.mark.parametrize("limits", [kind.limits for kind in KINDS.values()])
def test_every_limit_of_a_kind_has_a_unit_but_those_of_numbers(limits: Limits) -> None:
    assert limits
    assert {name for name, span in limits.items() if not span.unit} <= COUNTS


class Wire:
    """Pending goals of a controller that is online and answers nothing."""

    def __init__(self) -> None:
        self.session = ControllerSession()
        self.connection = Connection("tcp:127.0.0.1:5760", self.session, on_event=lambda _: None)
        self.pending = PendingGoals(self.connection)
        self.sent: list[AnyMessage] = []
        self.connection._send = self.sent.append
        self.session.opened(0.0)
        for word in (Heartbeat(0, 0, 0, 0, 4), Mode(0, 0, 2000, ModeKind.READY, 0)):
            self.session.receive(Frame.of(word, system=1, component=1), 0.0)


def of_a_command(*, ended: bool) -> Any:
    return SimpleNamespace(cancelled=ended, context=SimpleNamespace(epoch=5), wake=lambda: None)


@pytest.mark.parametrize("cancelled", [True, False])
def test_what_a_command_asks_for_after_it_was_ended_never_leaves(*, cancelled: bool) -> None:
    wire, activity = Wire(), of_a_command(ended=cancelled)
    pending = wire.pending.start(7, Request(Verb.HOLD, ()), activity=activity, ttl=1.0, repeatable=False)
    assert isinstance(pending.end, NotSent) is cancelled
    assert wire.session._goals.pursued == ([] if cancelled else [7])


def test_what_was_asked_for_is_taken_back_once_its_command_is_ended_and_never_asked_for_again() -> None:
    wire, ended, goes_on = Wire(), of_a_command(ended=False), of_a_command(ended=False)
    wire.pending.start(7, Request(Verb.HOLD, ()), activity=ended, ttl=1.0, repeatable=False)
    wire.pending.start(8, Request(Verb.GRIP, (0.02,)), activity=goes_on, ttl=1.0, repeatable=False)
    ended.cancelled = True
    wire.sent.clear()
    wire.pending.cancel_ended()
    wire.connection.perform(wire.session.tick(wire.connection.now() + RESEND))
    asked = [(type(each), each.key) for each in wire.sent if isinstance(each, Goal | GoalCancel)]
    assert asked == [(GoalCancel, 7), (GoalCancel, 7), (Goal, 8)]


def ended(state: GoalState, reason: int = Reason.NONE, text: str = "") -> VrError | None:
    end = GoalEnded(1, state, reason, text)
    return error_of(end, robot="arm-1", command="go_to", epoch=7, obeyed=9)


def test_every_reason_of_the_dialect_has_a_sentence() -> None:
    assert set(SENTENCES) == set(Reason)


@pytest.mark.parametrize(
    ("state", "reason", "error"),
    [
        (GoalState.REFUSED, Reason.OUT_OF_REACH, CommandFailed),
        (GoalState.REFUSED, Reason.STALE_EPOCH, StaleEpoch),
        (GoalState.FAILED, Reason.BLOCKED, CommandFailed),
        (GoalState.CANCELLED, Reason.SUPERSEDED, CommandCancelled),
        (GoalState.EXPIRED, Reason.NONE, DeadlineExceeded),
        (GoalState.UNKNOWN, Reason.NONE, CommandInDoubt),
        (GoalState.UNKNOWN, Reason.OTHER_LIFE, CommandInDoubt),
    ],
)
def test_each_end_raises_its_error(state: GoalState, reason: Reason, error: type[VrError]) -> None:
    assert type(ended(state, reason)) is error


def test_a_goal_that_was_reached_raises_nothing() -> None:
    assert ended(GoalState.SUCCEEDED) is None


def test_the_controllers_own_sentence_reaches_the_caller() -> None:
    error = ended(GoalState.REFUSED, Reason.OUT_OF_REACH, "0.72 m from the foot is more than 0.60 m.")
    assert str(error) == "arm-1.go_to failed: 0.72 m from the foot is more than 0.60 m"


def test_a_stale_epoch_says_which_one_is_obeyed() -> None:
    assert "no longer obeys epoch 7, it is at 9" in str(ended(GoalState.REFUSED, Reason.STALE_EPOCH))


@given(state=st.sampled_from(GoalState), reason=st.integers(0, 65535), text=st.text(max_size=80))
def test_no_end_from_a_wire_is_without_a_sentence(state: GoalState, reason: int, text: str) -> None:
    error = ended(state, reason, text)
    assert (error is None) == (state == GoalState.SUCCEEDED)
    assert explain(GoalEnded(1, state, reason, text))


@pytest.mark.parametrize(
    ("acknowledged", "heard", "sentence"),
    [
        (False, 0.1, "its controller is online but answers no goals; is it a Arm? Look whether"),
        (True, 0.1, "its controller is online but reports it no more; look whether"),
        (False, 2.5, "its controller has fallen silent; look whether"),
        (True, 60.0, "its controller has fallen silent; look whether"),
    ],
)
def test_a_controller_that_is_heard_is_not_called_silent(
    *, acknowledged: bool, heard: float, sentence: str
) -> None:
    assert silence_in_words(acknowledged=acknowledged, heard=heard, kind="Arm").startswith(sentence)
