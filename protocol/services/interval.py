"""The rate of each message on one connection, and messages that are sent on request.

Every connection has its own rates: one client does not change what another one gets. A request for too high a
rate gets the highest possible one, which GET_MESSAGE_INTERVAL then reports; a refusal would leave the client
with nothing.
"""

from __future__ import annotations

from math import inf, isfinite
from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.messages import AnyMessage, MavCmd, MavResult, MessageInterval
from robotree.protocol.services.command import Answer, Handler, Request

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Mapping, Sequence

FASTEST = 0.002
"""[s]"""
_MICRO = 1e6
_OFF = -1
_DEFAULT = 0
_LARGEST = 2**31 - 1


class _Beat(msgspec.Struct):
    interval: float | None
    due: float


class Intervals:
    """The rates of one connection.

    Args:
        defaults: the interval of every message that can be sent regularly, [s]; None: not unless asked for.
        fastest: the shortest interval, [s].
        fixed: the interval of messages that are sent by others and at no other rate, [s].
    """

    def __init__(
        self,
        defaults: Mapping[int, float | None],
        fastest: float = FASTEST,
        fixed: Mapping[int, float] | None = None,
    ) -> None:
        self._defaults, self._fastest, self._fixed = dict(defaults), fastest, dict(fixed or {})
        self._next = float("-inf")
        self._beats = {msgid: _Beat(interval, float("-inf")) for msgid, interval in defaults.items()}

    @property
    def next(self) -> float:
        """When to call `due` next, [s]."""
        return self._next

    def due(self, now: float) -> list[int]:
        """The messages whose time has come, by id. A long sleep is not made up for."""
        if now < self._next:
            return []
        ready: list[int] = []
        self._next = inf
        for msgid, beat in self._beats.items():
            if (interval := beat.interval) is None:
                continue
            if now >= beat.due:
                late = now - beat.due
                beat.due = now + interval - (late if late < interval else 0.0)
                ready.append(msgid)
            if beat.due < self._next:  # noqa: PLR1730 # `min` is a call, and this is done very often
                self._next = beat.due
        return ready

    def set(self, msgid: int, interval_us: float, now: float) -> bool:
        """Change a rate as SET_MESSAGE_INTERVAL says; False: no such message or interval."""
        beat = self._beats.get(msgid)
        if beat is None or not (isfinite(interval_us) and interval_us >= _OFF):
            return False
        if interval_us == _DEFAULT:
            beat.interval = self._defaults[msgid]
        else:
            beat.interval = max(interval_us / _MICRO, self._fastest) if interval_us > 0 else None
        beat.due = now + (beat.interval or 0.0)
        self._next = float("-inf")
        return True

    def get(self, msgid: int) -> MessageInterval:
        """How often a message is sent, as GET_MESSAGE_INTERVAL asks."""
        if (fixed := self._fixed.get(msgid)) is not None:
            return MessageInterval(msgid & 0xFFFF, round(fixed * _MICRO))
        beat = self._beats.get(msgid)
        if beat is None:
            return MessageInterval(msgid & 0xFFFF, _DEFAULT)
        interval = _OFF if beat.interval is None else min(round(beat.interval * _MICRO), _LARGEST)
        return MessageInterval(msgid & 0xFFFF, interval)


def handlers(
    intervals: Callable[[Hashable], Intervals], produce: Callable[[int, float], Sequence[AnyMessage]]
) -> dict[int, Handler]:
    """The commands of this service, for `CommandServer(always=…)`.

    Args:
        intervals: the rates of a link.
        produce: what is asked for, by id, at a moment [s]; several where a message has instances, none where
            there is no such message.
    """

    def set_interval(request: Request, now: float) -> Answer:
        rates = intervals(request.peer.via)
        done = rates.set(_msgid(request), request.param(2), now)
        return Answer(MavResult.ACCEPTED if done else MavResult.DENIED)

    def get_interval(request: Request, _: float) -> Answer:
        interval = intervals(request.peer.via).get(_msgid(request))
        return Answer(MavResult.ACCEPTED if interval.interval_us else MavResult.DENIED, messages=(interval,))

    def request_message(request: Request, now: float) -> Answer:
        messages = tuple(produce(_msgid(request), now))
        return Answer(MavResult.ACCEPTED if messages else MavResult.DENIED, messages=messages)

    return {
        MavCmd.SET_MESSAGE_INTERVAL: set_interval,
        MavCmd.GET_MESSAGE_INTERVAL: get_interval,
        MavCmd.REQUEST_MESSAGE: request_message,
    }


def _msgid(request: Request) -> int:
    wanted = request.param(1, default=-1.0)
    return int(wanted) if isfinite(wanted) else -1
