"""COMMAND_LONG and COMMAND_INT, the side that carries them out.

MAVLink's commands have no key, so a repeated command looks like a new one. But a repeated COMMAND_LONG counts
in `confirmation`, and clients repeat within a few seconds. So a request with the same content from the same
peer counts as a repetition if its number is neither 0 nor the previous one and it comes within
`COUNTED_REPETITION` of the last answer. Later, it repeats a new command whose first frame was lost. Some
clients always send the same number, such as 1: then each request is a new command.

A repetition is answered with the stored result, and so is a request within `REPETITION` of its success if
nothing else was done in between; a command that moves should be a goal, which has a key. A command that was
cancelled or has failed does not count as repeated by time alone: its sender wants it again. A refusal is not
stored: nothing was done, and the obstacle may be gone. While a command is in progress, the same request is
answered with its progress, and another one of its kind is temporarily rejected.

Questions and stops are carried out every time, from any sender. The command that ends a stop also begins one,
so it is handed on every time, too; its handler asks for the answer to be stored, and is told of repetitions.
"""

from __future__ import annotations

from collections.abc import Callable
from math import isnan
from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.messages import (
    AnyMessage,
    CommandAck,
    CommandCancel,
    CommandInt,
    CommandLong,
    MavResult,
)
from robotree.protocol.services.peer import Peer, Send

if TYPE_CHECKING:
    from collections.abc import Mapping

REPETITION = 2.0
"""[s] after its success within which the same content is taken for a repetition."""
COUNTED_REPETITION = 10.0
"""[s] after the last answer within which the same content is a repetition if it says so.

The field's clients repeat at most three times, 3 s apart, so none still repeats an older order after that.
"""
PROGRESS_PERIOD = 0.5
"""[s] between two words on a command in progress; clients give up after a few seconds of silence."""
MAX_PEERS = 256
"""Results that are stored."""
UNKNOWN_PROGRESS = 255
"""The value on the wire of an unknown progress."""
_NO_INTEGER = 0x7FFFFFFF
_DONE = frozenset({MavResult.ACCEPTED, MavResult.IN_PROGRESS})
"""Answers that say that something was done."""


class Request(msgspec.Struct, frozen=True):
    """A command that somebody asks for."""

    peer: Peer
    command: int
    params: tuple[float, ...]
    """(7,) NaN: not given."""
    repeated: bool = False
    """Whether it says that it repeats an order, the answer to which is remembered."""

    def param(self, number: int, default: float = 0.0) -> float:
        """The parameter with a number from 1 to 7, or the default where it was not given."""
        value = self.params[number - 1]
        return default if isnan(value) else value


class Answer(msgspec.Struct, frozen=True):
    """The immediate answer to a command."""

    result: MavResult
    detail: int = 0
    """`result_param2`, as the command defines it."""
    messages: tuple[AnyMessage, ...] = ()
    """The messages that were requested; sent to the asker after the answer."""
    remembered: bool = False
    """Whether a repetition of what is carried out every time shall be told by `Request.repeated`."""


Handler = Callable[[Request, float], Answer]
"""Carries out a command at a moment. Answers IN_PROGRESS when it takes longer; see `CommandServer.finish`."""


class CommandAbandoned(msgspec.Struct, frozen=True):
    """Please stop: a command in progress was cancelled."""

    peer: Peer
    command: int


CommandServerEffect = Send | CommandAbandoned


class _Record(msgspec.Struct):
    """The order of a peer and a command that was answered last."""

    peer: Peer
    params: tuple[float, ...]
    ack: CommandAck
    confirmation: int
    """Of its last transmission."""
    since: float
    """[s] The result."""
    told: float
    """[s] The last answer."""
    turn: object

    def is_repeated(self, confirmation: int, now: float) -> bool:
        """Whether a transmission with the same content says that it is this order again."""
        return confirmation not in {0, self.confirmation} and now - self.told < COUNTED_REPETITION


class CommandServer:
    """Carries out commands that are addressed to one component.

    Args:
        once: what is carried out once, though it is repeated, by command.
        always: what is carried out at every repetition and for anyone: questions and stops. Those whose
            answer is remembered are told which is one.
        turn: returns another value whenever something else was done, a stop for instance.
    """

    def __init__(
        self,
        once: Mapping[int, Handler],
        always: Mapping[int, Handler],
        *,
        turn: Callable[[], object] = lambda: None,
    ) -> None:
        self._once, self._always, self._turn = dict(once), dict(always), turn
        self._records: dict[tuple[Peer, int], _Record] = {}

    @property
    def in_progress(self) -> list[tuple[Peer, int]]:
        """The commands that are being carried out."""
        return [key for key, record in self._records.items() if record.ack.result == MavResult.IN_PROGRESS]

    def receive(
        self, message: CommandLong | CommandInt | CommandCancel, peer: Peer, now: float
    ) -> list[CommandServerEffect]:
        """Take a message that is addressed to this component."""
        if isinstance(message, CommandCancel):
            return self._cancel(message.command, peer, now)
        command, params = message.command, _params(message)
        confirmation = message.confirmation if isinstance(message, CommandLong) else 0
        record = self._records.get((peer, command))
        if record is not None and not _same(record.params, params):
            record = None
        repeated = record is not None and record.is_repeated(confirmation, now)
        request = Request(peer, command, params, repeated)
        if (handler := self._always.get(command)) is not None:
            answer = handler(request, now)
            if answer.remembered:
                self._store(request, answer, confirmation, now)
            return _sends(request, answer)
        if record is not None and (repeated or self._stands(record, now)):
            record.confirmation = confirmation
            return self._tell(record, now)
        if any(running == command for _, running in self.in_progress):
            return [_ack(peer, command, MavResult.TEMPORARILY_REJECTED)]
        return self._carry_out(request, confirmation, now)

    def progress(self, peer: Peer, command: int, fraction: float, now: float) -> list[CommandServerEffect]:
        """A command goes on; told on at most every `PROGRESS_PERIOD`."""
        record = self._open(peer, command)
        if record is None:
            return []
        percent = round(100 * min(max(0.0, fraction), 1.0))
        record.ack = msgspec.structs.replace(record.ack, progress=percent)
        return self._tell(record, now) if now - record.told >= PROGRESS_PERIOD else []

    def finish(
        self, peer: Peer, command: int, result: MavResult, now: float, detail: int = 0
    ) -> list[CommandServerEffect]:
        """A command in progress is over. Ignored when it was before."""
        record = self._open(peer, command)
        if record is None:
            return []
        record.ack = _ack_message(peer, command, result, detail)
        record.since, record.turn = now, self._turn()
        return self._tell(record, now)

    def tick(self, now: float) -> list[CommandServerEffect]:
        """Tell those who wait that their command still goes on."""
        records = [self._records[key] for key in self.in_progress]
        due = [record for record in records if now - record.told >= PROGRESS_PERIOD]
        return [send for record in due for send in self._tell(record, now)]

    def _carry_out(self, request: Request, confirmation: int, now: float) -> list[CommandServerEffect]:
        handler = self._once.get(request.command)
        if handler is None:
            return [_ack(request.peer, request.command, MavResult.UNSUPPORTED)]
        answer = handler(request, now)
        if answer.result in _DONE:
            self._store(request, answer, confirmation, now)
        else:
            self._records.pop((request.peer, request.command), None)
        return _sends(request, answer)

    def _cancel(self, command: int, peer: Peer, now: float) -> list[CommandServerEffect]:
        record = self._records.get((peer, command))
        if record is None:
            return []
        if record.ack.result == MavResult.IN_PROGRESS:
            return [CommandAbandoned(peer, command), *self.finish(peer, command, MavResult.CANCELLED, now)]
        return self._tell(record, now)

    def _open(self, peer: Peer, command: int) -> _Record | None:
        record = self._records.get((peer, command))
        return record if record is not None and record.ack.result == MavResult.IN_PROGRESS else None

    def _stands(self, record: _Record, now: float) -> bool:
        """Whether nobody orders it anew: it goes on, or has just succeeded and nothing was done since."""
        if record.ack.result == MavResult.IN_PROGRESS:
            return True
        lately = now - record.since < REPETITION and record.turn == self._turn()
        return lately and record.ack.result == MavResult.ACCEPTED

    def _tell(self, record: _Record, now: float) -> list[CommandServerEffect]:
        record.told = now
        return [Send(record.ack, record.peer.via)]

    def _store(self, request: Request, answer: Answer, confirmation: int, now: float) -> None:
        key = (request.peer, request.command)
        self._records.pop(key, None)
        if len(self._records) >= MAX_PEERS:
            done = (k for k, each in self._records.items() if each.ack.result != MavResult.IN_PROGRESS)
            del self._records[next(done, next(iter(self._records)))]
        ack, turn = _answer_ack(request, answer), self._turn()
        self._records[key] = _Record(
            request.peer, request.params, ack, confirmation, since=now, told=now, turn=turn
        )


def _params(message: CommandLong | CommandInt) -> tuple[float, ...]:
    first = (message.param1, message.param2, message.param3, message.param4)
    if isinstance(message, CommandLong):
        return (*first, message.param5, message.param6, message.param7)
    whole = (float("nan") if each == _NO_INTEGER else float(each) for each in (message.x, message.y))
    return (*first, *whole, message.z)


def _same(ours: tuple[float, ...], theirs: tuple[float, ...]) -> bool:
    return all(a == b or (isnan(a) and isnan(b)) for a, b in zip(ours, theirs, strict=True))


def _answer_ack(request: Request, answer: Answer) -> CommandAck:
    progress = UNKNOWN_PROGRESS if answer.result == MavResult.IN_PROGRESS else 0
    return _ack_message(request.peer, request.command, answer.result, answer.detail, progress)


def _sends(request: Request, answer: Answer) -> list[CommandServerEffect]:
    via = request.peer.via
    return [Send(_answer_ack(request, answer), via), *(Send(message, via) for message in answer.messages)]


def _ack(peer: Peer, command: int, result: MavResult) -> Send:
    return Send(_ack_message(peer, command, result), peer.via)


def _ack_message(
    peer: Peer, command: int, result: MavResult, detail: int = 0, progress: int = 0
) -> CommandAck:
    return CommandAck(command, result, progress, detail, peer.system, peer.component)
