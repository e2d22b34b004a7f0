"""When a pending goal is sent, sent again or cancelled."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from robotree.protocol.frame import Frame
from robotree.protocol.messages import AnyMessage, Goal, GoalCancel, Heartbeat, Mode, ModeKind, Verb
from robotree.protocol.services.goal_client import RESEND
from robotree.proxy.connection import Connection
from robotree.proxy.motion import Request
from robotree.proxy.pending_goals import NotSent, PendingGoals
from robotree.proxy.session import ControllerSession


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
