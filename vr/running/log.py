"""The log of one robot: the output of its code, and its commands: who asked for which, and how each ended.

A log keeps the last `KEPT` lines, and takes `BURST` lines at once and `RATE` a second after that; of what
comes quicker it says how many lines were dropped. Commands of people are never dropped. That a command of
a person goes on, or waits, is a line of its own; a short one has only the line of its end.

A line about a command is written when somebody wants to read it: nothing waits for that.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager
from typing import Any

from robotree.vr.base.description import FieldSpec
from robotree.vr.base.literal import write
from robotree.vr.base.principal import is_person
from robotree.vr.base.readable import in_words
from robotree.vr.base.requests import Level, LoggedLine, Returned
from robotree.vr.core.events import Ended
from robotree.vr.core.machine import AcceptedCall

KEPT = 500
"""Lines of each robot."""
LONGEST = 500
"""Characters of a line."""
BURST, RATE = 200, 50.0
"""Lines at once, and lines a second."""
PERIOD, DEPTH = 1.0 / RATE, (BURST - 0.5) / RATE
"""[s] Time that a line takes up, and how much of it lines may be ahead: half a line more, for rounding."""
NOTICED = 0.05
"""[s] below which nobody wants to know that a command has waited."""
_Write = Callable[..., LoggedLine]
"""Writes a line of what it is made of, known parameters, its number, and its time [s] since 1970."""
_Parameters = dict[str, tuple[FieldSpec, ...]]
"""By command."""
_CANCELS = frozenset({"CommandCancelled", "ChildCancelled"})


class Log:
    """See the module. Its methods may be called from any thread."""

    def __init__(
        self,
        now: Callable[[], float],
        unix: Callable[[], float],
        lock: AbstractContextManager[object],
        parameters: Callable[[str], Iterable[FieldSpec]] = lambda _: (),
    ) -> None:
        """Begin empty.

        Args:
            now: returns the time [s] on a monotonic clock.
            unix: returns the time [s] since 1970.
            lock: guards the lines; it is held for moments only.
            parameters: returns those of a command, empty if it is not known; called without the lock.
        """
        self.on_line: Callable[[], None] = lambda: None
        """Called at the first new line since somebody has asked for lines. In any thread: must be quick."""
        self._news = False
        """Whether there are lines that nobody has asked for."""
        self._now, self._unix, self._parameters = now, unix, parameters
        self._lines: deque[LoggedLine] = deque(maxlen=KEPT)
        self._fresh: deque[tuple[_Write, tuple[Any, ...], int, float]] = deque(maxlen=KEPT)
        """Entries since somebody has asked for lines: how each is written, its values, number, time."""
        self._open: set[str] = set()
        """Keys of the calls that have a line and have not ended."""
        self._lock = lock
        self._number = 0
        self._opens = -math.inf
        """[s] from when on a line is taken."""
        self._dropped = 0
        self.begun: dict[str, str] = {}
        """Lines that have no end yet, by command and level."""

    def write(self, key: str, level: Level, text: str) -> None:
        """Take a piece of text; what has no line break yet waits for it.

        Args:
            key: of the command that says it; empty: none does.
            level: how important it is.
            text: of any length.
        """
        place = f"{key}|{level}"
        *whole, rest = (self.begun.pop(place, "") + text).split("\n")
        if len(rest) > LONGEST:
            whole, rest = [*whole, rest], ""
        if rest:
            self.begun[place] = rest
        for line in whole:
            self.say(level, line)

    def end(self, key: str) -> None:
        """A command has ended: log its last output, which has no line break."""
        for place in [one for one in self.begun if one.rpartition("|")[0] == key]:
            level: Any = place.rpartition("|")[2]
            self.say(level, self.begun.pop(place))

    def say(self, level: Level, text: str) -> None:
        """Take a line."""
        self._take(_said, level, text, now=self._now())

    def ask(self, call: AcceptedCall, ahead: AcceptedCall | None) -> None:
        """Take, once, that the command of a person goes on, or waits for the one that is `ahead`.

        Args:
            call: as it is now: it is written down later.
            ahead: what it waits for; None: nothing.
        """
        if call.key not in self._open:
            self._open.add(call.key)
            words = "begins" if ahead is None else waits(ahead)
            self._take(_asked, call, words, now=self._now(), always=True)

    def know(self, keys: Iterable[str]) -> None:
        """Take note of calls that have a line from an earlier process, or need none."""
        self._open.update(keys)

    def settle(self, call: Ended) -> None:
        """Take how a command went; of those that only read, failures alone."""
        if self.begun:
            self.end(call.key)
        if self._open:
            self._open.discard(call.key)
        if call.reads and isinstance(call.reply, Returned):
            return
        if call.ended < self._opens and not is_person(call.caller):  # as nearly always where calls are many
            with self._lock:
                self._dropped += 1
            return
        self._take(_settled, call, now=call.ended, always=is_person(call.caller))

    def since(self, number: int) -> list[LoggedLine]:
        """Return the lines after the one of a number, the oldest first."""
        known: _Parameters = {}
        while True:
            with self._lock:
                calls = (what[0].command for write, what, *_ in self._fresh if write is not _said)
                new = set(calls) - known.keys()
                if not new:
                    self._news = False
                    if self._dropped:
                        self._note_dropped()
                    self._lines.extend(write(*what, known, *when) for write, what, *when in self._fresh)
                    self._fresh.clear()
                    return [line for line in self._lines if line.number > number]
            known |= {command: tuple(self._parameters(command)) for command in new}

    def _take(self, write: _Write, *what: Any, now: float, always: bool = False) -> None:
        """Take a line, if there is room for it.

        Args:
            write: returns the line, when somebody wants to read it.
            what: of which it is made.
            now: [s] on the monotonic clock.
            always: whether it is never dropped.
        """
        with self._lock:
            if now < self._opens and not always:
                self._dropped += 1
                return
            self._opens = min(max(self._opens, now - DEPTH), now) + PERIOD
            if self._dropped:
                self._note_dropped()
            self._append(write, what)
            first, self._news = not self._news, True
        if first:
            self.on_line()

    def _note_dropped(self) -> None:
        """Say how many lines were dropped."""
        count, self._dropped = self._dropped, 0
        self._append(_said, ("warning", f"{count} lines were dropped: it takes {RATE:g} a second"))

    def _append(self, write: _Write, what: tuple[Any, ...]) -> None:
        self._number += 1
        self._fresh.append((write, what, self._number, self._unix()))


def waits(first: AcceptedCall, seconds: float = 0.0) -> str:
    """Return for which command, of whom, another one waits, and how long: `waits: bob's go_to first, 8 s`."""
    whose = f"{first.caller}'s {first.command}" if first.caller else first.command
    return f"waits: {whose} first" + (f", {seconds:.0f} s" if seconds >= 1.0 else "")


def _said(level: Level, text: str, _known: _Parameters, number: int, unix: float) -> LoggedLine:
    return LoggedLine(number, unix, level, _short(text))


def _asked(call: AcceptedCall, words: str, known: _Parameters, number: int, unix: float) -> LoggedLine:
    given = _given(call.sent)
    text = f"{_by(call.command, call.caller)} {words}{_within(call, known)}"
    return LoggedLine(number, unix, "asked", _short(text), call.command, call.key, call.caller, given)


def _settled(call: Ended, known: _Parameters, number: int, unix: float) -> LoggedLine:
    given, shown, began = _given(call.sent), _within(call, known), call.began
    turned = began >= 0.0
    waited, ran = (began if turned else call.ended) - call.came, call.ended - began if turned else 0.0
    times = [f"waited {waited:.1f} s"] if waited >= NOTICED else []
    times += [f"ran {ran:.1f} s"] if turned else ["never began"]
    level: Level
    if isinstance(call.reply, Returned):
        level, text = "done", f"{_by(call.command, call.caller)} is done: {', '.join(times)}{shown}"
    else:
        level = "cancelled" if call.reply.error in _CANCELS else "failed"
        text = f"{call.reply.revive()} ({_by('', call.caller)}{', '.join(times)}){shown}"
    return LoggedLine(
        number, unix, level, _short(text), call.command, call.key, call.caller, given, waited, ran
    )


def _by(command: str, caller: str) -> str:
    """Return `go_to by anna@pts/3`, or `by anna@pts/3, `."""
    if not command:
        return f"by {caller}, " if caller else ""
    return f"{command} by {caller}" if caller else command


def _within(call: AcceptedCall | Ended, known: _Parameters) -> str:
    given = _given(in_words(known[call.command], call.sent))
    return f"  ({given})" if given else ""


def _given(arguments: Mapping[str, Any]) -> str:
    """Return arguments as a person would type them."""
    return _short(" ".join(f"{name}={_written(value)}" for name, value in arguments.items()))


def _written(value: object) -> str:
    if isinstance(value, str):
        return value
    return f"{len(value)} bytes" if isinstance(value, bytes) else write(value)


def _short(text: str) -> str:
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 1]}…"
