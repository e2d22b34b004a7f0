"""Less than every state of every robot, for a line that may be slow. Pure.

A robot publishes its state once a second though nothing changes. Of these the other site is sent one
sentence a second: which of the states that it has are still so. What changed leaves at once, but for the
readings of a robot that carries nothing out: sensors are never quite still. They share `SHARE` of the line,
at least `LEAST` bytes per second, the one that has waited longest first.

The other site publishes again what is still so, so its screens hear each robot as often as here. A state that
was lost on the way is asked for again: each sentence says by a checksum which state is meant.
"""

from __future__ import annotations

import itertools
import zlib
from collections.abc import Iterable, Sequence

import msgspec

from robotree.vr.base.errors import VrError
from robotree.vr.base.requests import State, decode_event
from robotree.vr.sites.frames import SiteState, StillSo

PERIOD = 1.0
"""[s] between two sentences about what is still so."""

LEAST = 1000.0
"""[bytes/s] for the readings of idle robots on the slowest line: of 100 robots each comes every 20 s."""

AROUND = 50
"""[bytes] that are sent around a state and its key."""

SHARE = 0.1
"""Of the line."""

MOST = 1 << 14
"""States of another site that are kept."""


def is_state(key: str) -> bool:
    """Whether what is published under a key is the state of a robot."""
    return key.startswith("robot/") and key.endswith("/state")


class _Sent:
    """The state of a robot that was sent last."""

    __slots__ = ("at", "body", "number", "repeated", "rest", "waiting")

    def __init__(self, number: int, body: bytes, rest: State | None, at: float) -> None:
        self.number, self.body, self.rest, self.at = number, body, rest, at
        self.repeated = False
        """Whether the robot has said the same since the last sentence."""
        self.waiting = b""
        """A newer one, in which only readings differ."""


class Summaries:
    """The states that leave for one other site."""

    def __init__(self, now: float) -> None:
        """Begin at this moment [s]."""
        self._sent: dict[str, _Sent] = {}
        self._keys: dict[int, str] = {}
        self._numbers = itertools.count(1)
        self._told = self._filled = now
        self._credit = LEAST

    def take(self, key: str, body: bytes, now: float) -> SiteState | None:
        """Take a state that a robot has published; returns what leaves at once, if anything does.

        Args:
            key: under which it was published.
            body: as published.
            now: [s]
        """
        known = self._sent.get(key)
        if known is None:
            number = next(self._numbers)
            self._sent[key], self._keys[number] = _Sent(number, body, _rest(body), now), key
            return SiteState(number, key, body)
        known.repeated = True
        if body == known.body:
            known.waiting = b""
            return None
        rest = _rest(body)
        if rest is not None and not rest.busy and rest == known.rest:
            known.waiting = body
            return None
        return self._send(key, known, body, rest, now)

    def due(self, now: float, rate: float) -> list[SiteState | StillSo]:
        """Return what leaves now by the clock.

        Args:
            now: [s]
            rate: [bytes/s] that the line carries, about.
        """
        budget = max(LEAST, SHARE * rate)
        waiting = sorted((sent.at, key) for key, sent in self._sent.items() if sent.waiting)
        most = max(budget, *(_cost(key, self._sent[key]) for _, key in waiting[:1]), 0)
        self._credit = min(most, self._credit + (now - self._filled) * budget)
        self._filled = now
        leaving: list[SiteState | StillSo] = []
        for _, key in waiting:
            sent = self._sent[key]
            cost = _cost(key, sent)
            if cost > self._credit:
                break
            self._credit -= cost
            leaving.append(self._send(key, sent, sent.waiting, sent.rest, now))
        if now - self._told >= PERIOD:
            self._told = now
            still = [(sent.number, _sum(sent.body)) for sent in self._sent.values() if sent.repeated]
            for sent in self._sent.values():
                sent.repeated = False
            if still:
                leaving.append(StillSo(still))
        return leaving

    def again(self, numbers: Iterable[int]) -> list[SiteState]:
        """Return states that the other site does not have."""
        keys = (self._keys.get(number, "") for number in numbers)
        return [SiteState(self._sent[key].number, key, self._sent[key].body) for key in keys if key]

    def forget(self, agent: str) -> None:
        """Forget the state of a robot that has gone."""
        if (sent := self._sent.pop(f"{agent}/state", None)) is not None:
            del self._keys[sent.number]

    def _send(self, key: str, known: _Sent, body: bytes, rest: State | None, now: float) -> SiteState:
        known.body, known.rest, known.at, known.waiting = body, rest, now, b""
        known.repeated = False  # it is on its way: said to be so before it has come, it would be asked for
        return SiteState(known.number, key, body)


class Mirrors:
    """The states that have come from one other site."""

    def __init__(self) -> None:
        """Begin with none."""
        self._states: dict[int, tuple[str, bytes]] = {}
        self._numbers: dict[str, int] = {}

    def take(self, state: SiteState) -> None:
        """Keep a state that has come."""
        if state.number in self._states or len(self._states) < MOST:
            self._states[state.number] = state.key, state.body
            self._numbers[state.key] = state.number

    def still(self, said: StillSo) -> tuple[Sequence[tuple[str, bytes]], Sequence[int]]:
        """Return what is still so, by key, and the numbers of those states that have been lost."""
        same: list[tuple[str, bytes]] = []
        lost: list[int] = []
        for number, checksum in said.states:
            key, body = self._states.get(number, ("", b""))
            if key and _sum(body) == checksum:
                same.append((key, body))
            else:
                lost.append(number)
        return same, lost

    def forget(self, agent: str) -> None:
        """Forget the state of a robot that has gone."""
        if (number := self._numbers.pop(f"{agent}/state", None)) is not None:
            self._states.pop(number, None)


def _cost(key: str, sent: _Sent) -> int:
    """Return the bytes of a state that waits."""
    return len(sent.waiting) + len(key) + AROUND


def _sum(body: bytes) -> int:
    return zlib.crc32(body) & 0xFFFF


def _rest(body: bytes) -> State | None:
    """Return a state without its readings; None: it cannot be read."""
    try:
        state = decode_event(body, key="")
    except VrError:
        return None
    return msgspec.structs.replace(state, readings={}) if isinstance(state, State) else None
