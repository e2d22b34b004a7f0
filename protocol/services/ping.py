"""PING: round-trip times."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.messages import Ping

if TYPE_CHECKING:
    from robotree.protocol.services.peer import Peer

LOST_AFTER = 5.0
"""[s] after which an answer counts as lost."""
_MICRO = 1_000_000


def answer(question: Ping, asker: Peer) -> list[Ping]:
    """Answer a question; an answer gets none."""
    if question.target_system or question.target_component:
        return []
    return [msgspec.structs.replace(question, target_system=asker.system, target_component=asker.component)]


class PingAnswer(msgspec.Struct, frozen=True):
    """A ping that came back."""

    number: int
    round_trip: float
    """[s]"""
    system: int
    component: int


class _Question(msgspec.Struct):
    asked: float
    answered: bool = False


class Pinger:
    """Asks, and measures what comes back.

    Args:
        system: who we are.
        component: which part of it asks.
    """

    def __init__(self, system: int, component: int) -> None:
        self._us = system, component
        self._number = 0
        self._questions: dict[int, _Question] = {}
        self.lost = 0
        """Questions that nobody answered in time."""

    def ask(self, now: float) -> Ping:
        """The next question, to everyone."""
        self._number = self._number + 1 & 0xFFFFFFFF
        self._questions[self._number] = _Question(now)
        return Ping(round(now * _MICRO), self._number)

    def receive(self, reply: Ping, peer: Peer, now: float) -> PingAnswer | None:
        """Take an answer; None: it is none of ours. Several peers may answer the same question."""
        question = self._questions.get(reply.seq)
        if question is None or (reply.target_system, reply.target_component) != self._us:
            return None
        question.answered = True
        return PingAnswer(reply.seq, now - question.asked, peer.system, peer.component)

    def tick(self, now: float) -> list[int]:
        """The numbers of the questions that grew too old without an answer."""
        old = [number for number, each in self._questions.items() if now - each.asked >= LOST_AFTER]
        missing = [number for number in old if not self._questions.pop(number).answered]
        self.lost += len(missing)
        return missing


class RoundTrips(msgspec.Struct, frozen=True):
    """Statistics of some pings. Times are round trips, [s]; None: nothing came back."""

    asked: int
    answered: int
    loss: float
    """Share of the pings without an answer."""
    shortest: float | None
    median: float | None
    late: float | None
    """99 of 100 took no longer."""
    longest: float | None


def summary(asked: int, times: list[float]) -> RoundTrips:
    """Statistics of round trips.

    Args:
        asked: how many pings were sent.
        times: of those that were answered, [s].
    """
    ordered = sorted(times)
    count = len(ordered)
    return RoundTrips(
        asked=asked,
        answered=count,
        loss=1 - count / asked if asked else 0.0,
        shortest=ordered[0] if ordered else None,
        median=ordered[count // 2] if ordered else None,
        late=ordered[min(count * 99 // 100, count - 1)] if ordered else None,
        longest=ordered[-1] if ordered else None,
    )
