"""COMMAND_LONG, the side that asks: repeat until it is answered, then wait through the progress.

An answer names only the command, so only one command of a kind is sent to a target at a time; the others
wait. If a command was sent more than once, more than one answer may be on its way: the next one of its kind
waits one `RESEND` for them. A command that is given up may still run: it is cancelled, and the next one of
its kind waits `LONGEST_SILENCE` for its answers, and longer while they report progress. An answer that takes
even longer is taken for that of the next command.
"""

from __future__ import annotations

from collections import deque
from math import inf
from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.messages import CommandAck, CommandCancel, CommandLong, MavResult
from robotree.protocol.services.peer import Send

if TYPE_CHECKING:
    from collections.abc import Hashable, Sequence

RESEND = 0.5
"""[s] between two repetitions of what was not answered."""
ATTEMPTS = 4
"""Transmissions, after which a command that nobody answers is given up."""
LONGEST_SILENCE = 5.0
"""[s] of silence after which a command in progress is given up, and counts as ended when it was given up."""


class CommandDone(msgspec.Struct, frozen=True):
    """The last word on a command; `result` None: nobody answered."""

    command: int
    result: int | None
    detail: int = 0


CommandClientEffect = Send | CommandDone


class _Asked(msgspec.Struct):
    message: CommandLong
    attempts: int = 0
    asked: float = 0.0
    """[s] The last time."""
    heard: float | None = None
    """[s] The last answer; None: none yet."""


class CommandClient:
    """The commands that we send to one component.

    Args:
        system: the component's.
        component: its id.
        via: the link to it.
    """

    def __init__(self, system: int, component: int, via: Hashable = None) -> None:
        self.system, self.component, self.via = system, component, via
        self._queues: dict[int, deque[_Asked]] = {}
        self._quiet: dict[int, float] = {}
        """[s] When the answers to the last command of a kind are in."""

    def send(self, command: int, params: Sequence[float], now: float) -> list[CommandClientEffect]:
        """Ask for a command, after those of its kind that were asked for before.

        Args:
            command: what to do.
            params: up to 7; the others are NaN, the default.
            now: [s]
        """
        padded = (*params, *[float("nan")] * (7 - len(params)))
        message = CommandLong(self.system, self.component, command, 0, *padded)
        queue = self._queues.setdefault(command, deque())
        queue.append(_Asked(message))
        return self._begin(queue[0], now) if len(queue) == 1 else []

    def receive(self, ack: CommandAck, now: float) -> list[CommandClientEffect]:
        """Take an answer from the component that is addressed to us."""
        queue = self._queues.get(ack.command)
        if not queue or not queue[0].attempts:  # a further answer to the one before
            if ack.result == MavResult.IN_PROGRESS and ack.command in self._quiet:
                self._keep_quiet(ack.command, now + LONGEST_SILENCE)
            return []
        asked = queue[0]
        asked.heard = now
        if ack.result == MavResult.IN_PROGRESS:
            return []
        return self._done(queue, CommandDone(ack.command, ack.result, ack.result_param2), now)

    @property
    def due(self) -> float:
        """When to call `tick` next, [s]."""
        due = inf
        for queue in self._queues.values():
            asked = queue[0]
            if asked.heard is not None:
                due = min(due, asked.heard + LONGEST_SILENCE)
            else:
                due = min(due, asked.asked + RESEND)
        return due

    def tick(self, now: float) -> list[CommandClientEffect]:
        """Repeat what is due, and give up what nobody answers."""
        effects: list[CommandClientEffect] = []
        for queue in list(self._queues.values()):
            asked = queue[0]
            if asked.heard is not None and now >= asked.heard + LONGEST_SILENCE:
                effects += self._give_up(queue, now)
            elif asked.heard is None and now >= asked.asked + RESEND:
                gone = asked.attempts >= ATTEMPTS
                effects += self._give_up(queue, now) if gone else self._ask(asked, now)
        return effects

    def _begin(self, asked: _Asked, now: float) -> list[CommandClientEffect]:
        """Ask for the first time, at once or at the tick that finds it quiet."""
        quiet = self._quiet.get(asked.message.command, now)
        if now >= quiet:
            return self._ask(asked, now)
        asked.asked = quiet - RESEND
        return []

    def _ask(self, asked: _Asked, now: float) -> list[CommandClientEffect]:
        asked.asked = now
        message = msgspec.structs.replace(asked.message, confirmation=min(asked.attempts, 255))
        asked.attempts += 1
        return [Send(message, self.via)]

    def _give_up(self, queue: deque[_Asked], now: float) -> list[CommandClientEffect]:
        command = queue[0].message.command
        cancel = Send(CommandCancel(self.system, self.component, command), self.via)
        self._keep_quiet(command, now + LONGEST_SILENCE)
        return [cancel, *self._done(queue, CommandDone(command, None), now)]

    def _keep_quiet(self, command: int, until: float) -> None:
        """Ask for no further command of a kind before a moment [s]."""
        self._quiet[command] = max(until, self._quiet.get(command, until))
        queue = self._queues.get(command)
        if queue and not queue[0].attempts:
            queue[0].asked = self._quiet[command] - RESEND

    def _done(self, queue: deque[_Asked], event: CommandDone, now: float) -> list[CommandClientEffect]:
        if queue.popleft().attempts > 1:
            self._keep_quiet(event.command, now + RESEND)
        if not queue:
            del self._queues[event.command]
            return [event]
        return [event, *self._begin(queue[0], now)]
