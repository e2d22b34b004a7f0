"""Fills the history behind the robots: what happens goes into a queue, and a thread writes it into the file.

Nothing waits for it. A robot only appends to the queue; if that is full, or the file cannot be written,
events are left out and counted, and one event says how many and why. The thread rests three times as long as
it works, so it costs the robots little of their time, and it writes nothing that the journal has not written.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from robotree.vr.base.errors import HistoryUnusable, VrError
from robotree.vr.base.history_event import HistoryEvent
from robotree.vr.base.plain import to_plain
from robotree.vr.base.requests import EventsRead, EventsVerified, Raised, ReadEvents, Returned, VerifyEvents
from robotree.vr.base.system import clock_shift
from robotree.vr.core import events as on
from robotree.vr.core.events import CoreEffect, CoreEvent, Ended, LeaseEnded, Settled, StopTaken
from robotree.vr.core.machine import RobotCore, RobotState
from robotree.vr.history.file import PORTION, HistoryFile

NAME = "history.db"
"""Of the file, in the folder of its host."""
LONGEST_QUEUE = 50_000
BATCH = 500
"""Events in one transaction."""
GATHERS = 0.05
"""[s] that the thread waits for more events before it writes."""
REST = 3.0
"""Times as long as it has worked the thread rests."""
AGAIN = 10.0
"""[s] after which a file that could not be written is tried again."""
TRIMS = 30.0
"""[s] between two looks for events that are too old."""
LARGEST_VALUE = 2000
"""[bytes] of arguments or of a result that are kept."""
LONGEST_NOTE = 1000
"""[characters] of `Call.note`."""
OBSERVED = 50
"""Readings of one command that are kept."""
MOST_KNOWN = 4096
"""Calls that ended in this process and are remembered: that their parents know it is nothing new."""

_KEPT = frozenset({on.ParentAsked, on.StepTaken})
"""Classes of events of which the thread makes something itself."""
_STEPS = frozenset({"call", "reading"})
_Item = tuple[str, float, object, int]
"""Name of the robot, moment [s, monotonic], what happened, epoch of its lease."""
_encode = msgspec.json.Encoder(enc_hook=to_plain).encode
_log = logging.getLogger(__name__)


class Back(NamedTuple):
    """A command goes on after a crash of its host."""

    key: str
    command: str
    steps: int
    """Steps that it had taken before, and does not take again."""
    gap: float
    """[s] for which the host was away."""
    home: str


class MoveNote(NamedTuple):
    """A robot has moved, or has not, or it is not known."""

    key: str
    """Of a command that it carries out; empty: it carries none out."""
    command: str
    person: str
    """Who wanted it; empty: a robot, or its host."""
    text: str


class WatchedCore(RobotCore):
    """The machine of a robot whose events are kept."""

    __slots__ = ("_name", "_queue")

    def __init__(self, state: RobotState, queue: Callable[[_Item], None]) -> None:
        """Take a state, and where its events go."""
        super().__init__(state)
        self._name, self._queue = state.address.name, queue

    def handle(self, event: CoreEvent, now: float) -> list[CoreEffect]:  # one for each class
        effects = RobotCore.handle(self, event, now)
        kind = type(event)
        if kind is on.Invoke:
            call = None if event.reads else self.state.calls.live.get(event.call.key)  # type: ignore[union-attr]
            if call is not None and call.came == now:  # else it had been accepted before
                self._queue((self._name, now, event, self.state.lease.epoch))
        elif kind in _KEPT and (kind is not on.StepTaken or event.step.kind in _STEPS):  # type: ignore[union-attr]
            self._queue((self._name, now, event, self.state.lease.epoch))
        elif isinstance(event, on.Restored):
            self._note_back(event, now)
        for effect in effects:
            if type(effect) is Settled:
                if effect.call is not None and not effect.call.reads:
                    self._queue((self._name, now, effect.call, self.state.lease.epoch))
            elif type(effect) is LeaseEnded:
                self._queue((self._name, now, effect, self.state.lease.epoch))
            elif type(effect) is StopTaken and effect.fresh:  # a copy of an order is no other stop
                self._queue((self._name, now, event, self.state.lease.epoch))
        return effects

    def _note_back(self, event: on.Restored, now: float) -> None:
        """Keep which commands go on after a crash; those of a robot that has moved its host notes."""
        for key in () if event.came else event.calls:
            if (call := self.state.calls.live.get(key)) is not None:
                back = Back(key, call.command, len(call.steps), event.gap, self.state.home)
                self._queue((self._name, now, back, self.state.lease.epoch))


class HistoryWriter:
    """See the module."""

    def __init__(
        self,
        folder: Path,
        now: Callable[[], float] = time.monotonic,
        unix: Callable[[], float] = time.time,
        *,
        longest: int = LONGEST_QUEUE,
    ) -> None:
        """Prepare; nothing is written before `start`.

        Args:
            folder: of the file.
            now: returns the time [s] on the robots' monotonic clock.
            unix: returns the time [s] since 1970.
            longest: events that wait at most.
        """
        self.path = folder / NAME
        self._now, self._unix, self._longest = now, unix, longest
        self._queue: deque[_Item] = deque()
        self._again: list[tuple[_Item, float]] = []
        """Items in the journal of an earlier process, with the start of its clock since 1970."""
        self._missed = 0
        self._written = 0
        self._file: HistoryFile | None = None
        self._retry_at = self._trim_at = 0.0
        self.trouble = ""
        """Why nothing is kept at the moment; empty: all is."""
        self.page_of: Callable[[str], str] = lambda _: ""
        """Returns the hash of the page of a robot."""
        self.before_writing: Callable[[], None] = lambda: None
        """Called before events go into the file: the journal writes them first."""
        self._known: dict[str, None] = {}
        self._observed: dict[str, int] = {}
        self._bell, self._rung, self._ended = threading.Event(), False, False
        self._thread: threading.Thread | None = None

    # -- what happens -----------------------------------------------------------------------------

    def machine_of(self, state: RobotState) -> RobotCore:
        """Make the machine of a robot whose events are kept."""
        return WatchedCore(state, self.take)

    def take(self, item: _Item) -> None:
        """Take an event; never blocks. From any thread."""
        queue = self._queue
        if len(queue) >= self._longest:
            self._missed += 1
            return
        queue.append(item)
        if not self._rung:
            self._rung = True
            self._bell.set()

    def replayed(self, offset: float) -> None:
        """All that was taken so far an earlier process has written to its journal.

        Args:
            offset: [s] from its monotonic clock to the time since 1970.
        """
        self._again = [(item, offset) for item in self._queue]
        self._queue.clear()

    # -- writing ----------------------------------------------------------------------------------

    def start(self) -> None:
        """Begin to write."""
        self._thread = threading.Thread(target=self._main, name="history", daemon=True)
        self._thread.start()

    def close(self, within: float = 3.0) -> None:
        """Write what waits, and end; `within` [s] at most. Twice is once."""
        thread, self._thread = self._thread, None
        self._ended = True
        self._bell.set()
        if thread is not None:
            thread.join(within)

    @property
    def waiting(self) -> int:
        """Events that have happened and are not in the file yet."""
        return len(self._queue)

    def _main(self) -> None:
        self._attempt(self._catch_up)
        while True:
            self._bell.wait(AGAIN if self._queue else None)
            if not self._ended:
                time.sleep(GATHERS)
            self._bell.clear()
            self._rung = False
            while self._queue or self._missed:
                begun = time.thread_time()
                if not self._attempt(self._write):
                    break
                if not self._ended:
                    time.sleep(REST * (time.thread_time() - begun))
            if self._ended:
                self._close_file()
                return
            if self._now() >= self._trim_at:
                self._attempt(self._trim)

    def _attempt(self, work: Callable[[HistoryFile], None]) -> bool:
        """Do something with the file; returns whether it can be used."""
        try:
            if self._file is None:
                if self._now() < self._retry_at:
                    self._leave_out()
                    return False
                self._file = HistoryFile(self.path, writes=True)
            work(self._file)
        except HistoryUnusable as error:
            self._fail(str(error))
            return False
        except Exception as error:  # noqa: BLE001 # the error boundary of the thread
            _log.exception("the history of robots")
            self._fail(f"{self.path}: {error!r}")
            return False
        if self.trouble:
            _log.warning("%s: what robots do is kept again", self.path)
            self.trouble = ""
        return True

    def _fail(self, trouble: str) -> None:
        if not self.trouble:
            _log.error("what robots do is not kept at the moment: %s", trouble)
        self.trouble, self._retry_at = trouble, self._now() + AGAIN
        self._close_file()
        self._leave_out()

    def _leave_out(self) -> None:
        """Keep no more than half a queue while nothing can be written."""
        while len(self._queue) > self._longest // 2:
            self._queue.popleft()
            self._missed, self._written = self._missed + 1, self._written + 1

    def _close_file(self) -> None:
        file, self._file = self._file, None
        if file is not None:
            file.close()

    def _write(self, file: HistoryFile) -> None:
        """Write one batch."""
        queue, offset = self._queue, clock_shift(self._now, self._unix)
        items = [queue[number] for number in range(min(BATCH, len(queue)))]
        events = [event for item in items if (event := self._event(item, offset)) is not None]
        missed = self._missed
        if missed:
            number = "1 event is" if missed == 1 else f"{missed} events are"
            text = f"{number} missing: {self.trouble or 'there were too many at once'}"
            events.append(HistoryEvent(kind="missed", unix=self._unix(), robot="", text=text))
        try:
            self.before_writing()
        except VrError as error:
            raise HistoryUnusable(path=str(self.path), detail=str(error)) from None
        if events:
            file.append(events)
        self._missed -= missed
        for _ in items:
            queue.popleft()
        self._written += len(items)

    def _catch_up(self, file: HistoryFile) -> None:
        """Write what stands in the journal and is not in the file: the process was killed in between."""
        again, self._again = self._again, []
        events = [self._event(item, offset) for item, offset in again]
        new = [event for event in events if event and event.key and not file.has(event.kind, event.key)]
        for begin in range(0, len(new), BATCH):
            file.append(new[begin : begin + BATCH])

    def _trim(self, file: HistoryFile) -> None:
        full = file.trim(self._unix()) >= PORTION
        self._trim_at = self._now() + (0.0 if full else TRIMS)

    # -- what is kept of an event -----------------------------------------------------------------

    def _event(self, item: _Item, offset: float) -> HistoryEvent | None:  # noqa: PLR0911 # one for each class
        robot, now, happened, epoch = item
        unix = now + offset
        match happened:
            case on.Invoke():
                return self._accepted(robot, unix, happened)
            case Ended():
                self._known[happened.key] = None
                while len(self._known) > MOST_KNOWN:
                    del self._known[next(iter(self._known))]
                began = happened.began + offset if happened.began >= 0 else 0.0
                return HistoryEvent(
                    kind="ended", unix=unix, robot=robot, key=happened.key, command=happened.command,
                    began=began, **_outcome(happened.reply),
                )  # fmt: skip
            case on.StepTaken():
                return self._step(robot, unix, happened)
            case on.ParentAsked():
                return HistoryEvent(
                    kind="lease", unix=unix, robot=robot, epoch=epoch, parent=happened.parent.name,
                    person=happened.principal.person, process=happened.principal.process,
                    text=f"{happened.parent.name} commands it",
                )  # fmt: skip
            case LeaseEnded():
                text = f"{happened.parent.name} commands it no more: {happened.reason}"
                return HistoryEvent(
                    kind="lease", unix=unix, robot=robot, epoch=epoch, parent=happened.parent.name, text=text
                )
            case Back():
                steps = "1 step" if happened.steps == 1 else f"{happened.steps} steps"
                ended = time.strftime("%H:%M:%S", time.localtime(unix - happened.gap))
                return HistoryEvent(
                    kind="back", unix=unix, robot=robot, key=happened.key, command=happened.command,
                    text=f"{happened.home} ended at {ended} and came back {happened.gap:.1f} s later; "
                    f"{happened.command} goes on after {steps}",
                )  # fmt: skip
            case MoveNote():
                return HistoryEvent(
                    kind="moved", unix=unix, robot=robot, epoch=epoch, **happened._asdict()
                )  # fmt: skip
            case on.StopAsked():
                person = happened.principal.person
                return HistoryEvent(kind="stop", unix=unix, robot=robot, text=happened.reason, person=person)
            case _:
                return None

    def _accepted(self, robot: str, unix: float, happened: on.Invoke) -> HistoryEvent:
        call, asker = happened.call, happened.principal
        return HistoryEvent(
            kind="accepted", unix=unix, robot=robot, key=call.key, command=call.command,
            arguments=_small(call.arguments), caller=call.caller, person=asker.person, process=asker.process,
            epoch=call.epoch or 0, page=self.page_of(robot), line=call.line, within=call.deadline,
            text=call.note[:LONGEST_NOTE],
        )  # fmt: skip

    def _step(self, robot: str, unix: float, happened: on.StepTaken) -> HistoryEvent | None:
        """Return what a step says that nobody else here does: how a child elsewhere has ended, a reading."""
        step, key = happened.step, f"{happened.key}/{happened.path}"
        if step.kind == "call" and step.reply is not None and key not in self._known:
            content: Any = step.content
            slot, command, arguments = content or ("", "", None)
            return HistoryEvent(
                kind="answered", unix=unix, robot=robot, key=key, command=f"{slot}.{command}",
                arguments=_small(arguments), **_outcome(step.reply),
            )  # fmt: skip
        if step.kind == "reading":
            count = self._observed[happened.key] = self._observed.get(happened.key, 0) + 1
            while len(self._observed) > MOST_KNOWN:
                del self._observed[next(iter(self._observed))]
            if count <= OBSERVED:
                return HistoryEvent(
                    kind="observed", unix=unix, robot=robot, key=key, arguments=_small(step.content),
                    value=_small(step.value),
                )  # fmt: skip
        return None

    # -- being asked ------------------------------------------------------------------------------

    def read(self, request: ReadEvents, *, within: float = 0.5) -> EventsRead:
        """Return the events that a request asks for; waits a moment for those that are under way.

        Raises:
            HistoryUnusable: the file cannot be read.
        """
        until, goal = time.monotonic() + within, self._written + len(self._queue)
        while self._written < goal and not self.trouble and time.monotonic() < until:
            time.sleep(0.01)
        with closing(HistoryFile(self.path)) as file:
            found = file.read(request)
        return msgspec.structs.replace(found, waiting=self.waiting, trouble=self.trouble)


def answer_of(writer: HistoryWriter, request: ReadEvents | VerifyEvents) -> EventsRead | EventsVerified:
    """Return what a host answers about what its robots did. It takes its time: not on an event loop.

    Raises:
        HistoryUnusable: the file cannot be read.
    """
    if isinstance(request, ReadEvents):
        return writer.read(request)
    with closing(HistoryFile(writer.path)) as file:
        return file.verify()


def _outcome(reply: Returned | Raised) -> dict[str, Any]:
    if isinstance(reply, Raised):
        return {"error": reply.error, "value": _small(reply.data), "text": str(reply.revive())[:500]}
    return {"value": _small(reply.value)}


def _small(value: Any) -> Any:
    """Return a value as it is kept: one that is large is only named."""
    if value is None or type(value) in {bool, int, float}:
        return value
    try:
        encoded = _encode(value)
    except (TypeError, ValueError) as error:
        return f"(cannot be kept: {error})"
    if len(encoded) <= LARGEST_VALUE:
        return msgspec.Raw(encoded)
    return f"({len(encoded)} bytes)"
