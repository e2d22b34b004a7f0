"""Whether an errand leaves the desk."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from robotree.protocol.frame import Frame
from robotree.protocol.messages import Heartbeat, Verb
from robotree.proxy.connection import Connection
from robotree.proxy.errand import Desk, NotSent
from robotree.proxy.motion import Request
from robotree.proxy.session import Session


@pytest.mark.parametrize("cancelled", [True, False])
def test_what_a_command_asks_for_after_it_was_ended_never_leaves(*, cancelled: bool) -> None:
    session = Session()
    desk = Desk(Connection("tcp:127.0.0.1:5760", session, on_event=lambda _: None))
    session.opened(0.0)
    session.hear(Frame.of(Heartbeat(0, 0, 0, 0, 4), system=1, component=1), 0.0)
    activity: Any = SimpleNamespace(cancelled=cancelled, context=SimpleNamespace(epoch=5))
    errand = desk.send_out(7, Request(Verb.HOLD, ()), activity=activity, ttl=1.0)
    assert isinstance(errand.end, NotSent) is cancelled
    assert session._goals.pursued == ([] if cancelled else [7])
