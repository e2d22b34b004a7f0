"""A client that pursues a goal, and what it says."""

from __future__ import annotations

from collections.abc import Iterable

from robotree.protocol.messages import AnyMessage, Verb
from robotree.protocol.services.goal_client import GoalClient
from robotree.protocol.services.peer import Send


def pursuing(ttl: float = 0.0) -> GoalClient:
    """A client that has said goal 7 at 0 s, which lives for `ttl` [s]; 0: for ever."""
    client = GoalClient(1, 1, via="link 1")
    client.start(7, Verb.GO_TO, (0.5, 0.0, 0.2), epoch=3, now=0.0, ttl=ttl)
    return client


def sent(effects: Iterable[object]) -> list[AnyMessage]:
    """The messages that are to be sent."""
    return [each.message for each in effects if isinstance(each, Send)]
