"""The calls of one robot: what runs, what waits, how each ended, and which must never begin.

One command runs at a time and the others wait in a bounded queue; those that only read run beside it. A
call's key is `command id / path`: the same key with the same content is carried out once and answered twice.
Ended calls are remembered, the oldest forgotten first, and so are cancels that came before their call. A
caller that numbers its calls also says below which number none of them matters to it any more: such a call is
forgotten at once, and a late copy of it is refused for ever.

    Invoke ──► queued ──► running ──► ended          abandoned: ended, while its code still runs
                  └─ cancel ────────────┘

Pure: what ends a call is an error's name and data, as it travels.
"""

from __future__ import annotations

import math
from typing import Any

import msgspec

from robotree.vr.errors import Busy, CommandCancelled, KeyReused, StillRunning, VrError
from robotree.vr.requests import Raised, Returned

LONGEST_QUEUE = 16
MOST_READERS = 32
MOST_KEPT = 256
"""Ended calls that are remembered, and cancels that came first."""
MOST_CALLERS = 256
"""Callers that number their calls and are remembered."""


class AcceptedCall(msgspec.Struct, kw_only=True):
    """One accepted call, until it has ended."""

    key: str
    command: str
    sent: dict[str, Any]
    """Arguments as they came: with the command, the content of the call."""
    arguments: dict[str, Any]
    """Arguments as checked."""
    caller: str = ""
    epoch: int = 0
    deadline_at: float = math.inf
    """[s] on the robot's clock."""
    reads: bool = False
    running: bool = False
    cause: Raised | None = None
    """Why it was asked to end while it ran."""
    final: bool = False
    """Whether not even its clean-up may command children any more: a stop, a lost lease, a second cancel."""
    detached: bool = False
    """Whether it goes on after the command that has made it: then operators may end it."""
    source: str = ""
    """Who numbers its calls; empty: nobody."""
    number: int = 0


class Ended(msgspec.Struct, frozen=True):
    """One call that is over."""

    command: str
    sent: dict[str, Any]
    reply: Returned | Raised
    source: str = ""
    number: int = 0


class Calls(msgspec.Struct, kw_only=True):
    """All calls of one robot."""

    live: dict[str, AcceptedCall] = {}
    """Those that run or wait, by key, the oldest first."""
    running: str = ""
    """Key of the command whose turn it is; empty: none."""
    waiting: list[str] = []
    """Keys of those that wait, the next one first."""
    readers: int = 0
    """How many run that only read."""
    ended: dict[str, Ended] = {}
    cancelled: dict[str, str] = {}
    """Keys of calls that have not come and must not begin, with the reason."""
    lowest: dict[str, int] = {}
    """Below which number a caller's calls are over, by caller."""
    abandoned: dict[str, str] = {}
    """Commands that have ended and whose code runs on, by key."""
    places: dict[str, str] = {}
    """The lines of their pages at which they were given up, in words, by key."""
    counts: dict[str, int] = {}
    """How often each command was accepted."""

    # -- coming -----------------------------------------------------------------------------------

    def known(self, robot: str, key: str, command: str, sent: dict[str, Any]) -> AcceptedCall | Ended | None:
        """Return the call of a key that came before, live or ended; None when the key is new.

        Raises:
            KeyReused: the key came with other content.
            CommandCancelled: its cancel came before the call.
        """
        call = self.live.get(key) or self.ended.get(key)
        if call is None:
            if key in self.cancelled:
                raise CommandCancelled(robot=robot, command=command, reason=self.cancelled[key])
            return None
        if (call.command, call.sent) != (command, sent):
            raise KeyReused(robot=robot, key=key, command=call.command)
        return call

    def late(self, source: str, number: int) -> bool:
        """Whether a numbered call comes after its caller has said that it is over."""
        return number < self.lowest.get(source, 0)

    def enter(self, call: AcceptedCall, robot: str) -> bool:
        """Take a new call of a robot in; returns whether it begins at once.

        Raises:
            Busy: too many wait, or read; nothing has changed.
        """
        if call.reads:
            if self.readers >= MOST_READERS:
                raise Busy(robot=robot, waiting=self.readers)
            self.readers += 1
            call.running = True
        elif not self.running:
            self.running = call.key
            call.running = True
        elif len(self.waiting) >= LONGEST_QUEUE:
            raise Busy(robot=robot, waiting=len(self.waiting))
        else:
            self.waiting.append(call.key)
        self.live[call.key] = call
        self.counts[call.command] = self.counts.get(call.command, 0) + 1
        return call.running

    def settle_below(self, source: str, lowest: int) -> None:
        """Forget the ended calls of a caller below a number: copies of them are refused from now on."""
        if lowest <= self.lowest.get(source, 0):
            return
        self.lowest.pop(source, None)
        self.lowest[source] = lowest
        while len(self.lowest) > MOST_CALLERS:
            del self.lowest[next(iter(self.lowest))]
        over = [key for key, call in self.ended.items() if call.source == source and call.number < lowest]
        for key in over:
            del self.ended[key]

    # -- going ------------------------------------------------------------------------------------

    def leave(self, key: str, reply: Returned | Raised) -> str:
        """Note how a live call ended.

        Returns:
            The key of the call whose turn it is now because of that; empty: of none.
        """
        call = self.live.pop(key)
        if not (call.source and self.late(call.source, call.number)):
            self.ended[key] = Ended(call.command, call.sent, reply, call.source, call.number)
            while len(self.ended) > MOST_KEPT:
                del self.ended[next(iter(self.ended))]
        if call.reads:
            self.readers -= 1
        elif self.running != key:
            self.waiting.remove(key)
        elif self.waiting:
            self.running = self.waiting.pop(0)
            self.live[self.running].running = True
            return self.running
        else:
            self.running = ""
        return ""

    def refuse(self, key: str, reason: str) -> None:
        """Note that a call which has not come must not begin."""
        if key not in self.ended:
            self.cancelled[key] = reason
            while len(self.cancelled) > MOST_KEPT:
                del self.cancelled[next(iter(self.cancelled))]

    # -- queries ----------------------------------------------------------------------------------

    def of(self, command: str) -> AcceptedCall | None:
        """Return the oldest live call of a command that nobody has asked to end; None: there is none."""
        return next((one for one in self.live.values() if (one.command, one.cause) == (command, None)), None)

    def beside_abandoned(self, robot: str, home: str) -> VrError | None:
        """Return why nothing that moves may begin while abandoned code runs; None: there is none."""
        for key, command in self.abandoned.items():
            where = self.places.get(key, "")
            return StillRunning(robot=robot, command=command, home=home, where=where and f" ({where})")
        return None
