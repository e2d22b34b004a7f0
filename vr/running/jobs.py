"""The commands of one robot from acceptance to the last word: their turn, their deadline, their listeners."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Callable
from typing import Any

from robotree.vr.calls import CallTable
from robotree.vr.context import CommandContext
from robotree.vr.description import CommandSpec
from robotree.vr.errors import CommandCancelled, DeadlineExceeded, StillRunning, VrError
from robotree.vr.mailbox import Mailbox
from robotree.vr.requests import Failed, Progress, Returned
from robotree.vr.running.execution import Run
from robotree.vr.running.outcome import failed, returned

PROGRESS_PERIOD = 0.05
"""[s] Least time between two words about a command's progress."""


LONGEST_NOTE = 80
"""Characters of what a command says of its progress that its robot's state repeats to everybody."""

_log = logging.getLogger(__name__)


class Job:
    """One accepted command."""

    def __init__(
        self, context: CommandContext, spec: CommandSpec, arguments: dict[str, Any], *, source: str = ""
    ) -> None:
        """Take a command in.

        Args:
            context: its papers.
            spec: what it is.
            arguments: as checked.
            source: path of the author's file, for messages.
        """
        self.context, self.spec, self.arguments, self.source = context, spec, arguments, source
        self.outcome: asyncio.Future[Returned | Failed] = asyncio.get_running_loop().create_future()
        self.listeners: list[Callable[[Progress], None]] = []
        self.fraction = math.nan
        self.said = ""
        """What it said last of how far it is."""
        self.run: Run | None = None
        self.timer: asyncio.TimerHandle | None = None
        self._word: Progress | None = None
        self._quiet_until = 0.0

    @property
    def reads(self) -> bool:
        """Whether it only reads."""
        return self.spec.effect == "read"

    def note(self, fraction: float, text: str) -> None:
        """Take in how far it is; listeners hear the latest, not too often."""
        loop = asyncio.get_running_loop()
        self.fraction, self.said = fraction, text[:LONGEST_NOTE]
        waiting, self._word = (
            self._word is not None,
            Progress(key=self.context.key, fraction=fraction, text=text),
        )
        if not waiting:
            loop.call_at(max(loop.time(), self._quiet_until), self._speak)

    def _speak(self) -> None:
        word, self._word = self._word, None
        if word is not None and not self.outcome.done():
            self._quiet_until = asyncio.get_running_loop().time() + PROGRESS_PERIOD
            for listener in self.listeners:
                listener(word)


class Jobs:
    """All commands of one robot."""

    def __init__(
        self, robot: str, launch: Callable[[Job], Run], on_change: Callable[[], None], *, home: str
    ) -> None:
        """Begin idle.

        Args:
            robot: its name.
            launch: begins to carry out a command whose turn it is.
            on_change: told after each change of what runs and waits.
            home: what must be restarted to end a command that cannot be ended.
        """
        self._robot, self._launch, self._on_change, self._home = robot, launch, on_change, home
        self._table: CallTable[Job] = CallTable(robot)
        self._mailbox = Mailbox(robot)
        self._active: dict[str, Job] = {}
        self._abandoned: dict[str, str] = {}

    @property
    def abandoned(self) -> tuple[str, ...]:
        """Commands whose code runs on although they were ended: it heeds neither cancel nor interruption."""
        return tuple(self._abandoned.values())

    def refuse_beside_abandoned(self) -> None:
        """Refuse to begin anything that moves while abandoned code may still do something.

        Raises:
            StillRunning: there is such code.
        """
        for command in self._abandoned.values():
            raise StillRunning(robot=self._robot, command=command, home=self._home)

    @property
    def running(self) -> Job | None:
        """The command whose turn it is."""
        return self._active.get(self._mailbox.running)

    @property
    def waiting(self) -> int:
        """How many commands wait."""
        return len(self._mailbox.waiting)

    def seen(self, key: str, command: str, arguments: dict[str, Any]) -> Job | None:
        """Return the job of a call that came before, running or ended.

        Raises:
            KeyReused: the key came with another call.
            CommandCancelled: the call was cancelled before it came.
        """
        return self._table.find(key, (command, arguments))

    def submit(self, job: Job, arguments: dict[str, Any]) -> None:
        """Take a new job in, and begin it if it is its turn.

        Args:
            job: with a key not seen before.
            arguments: of the call as sent.

        Raises:
            Busy: the queue is full.
        """
        key = job.context.key
        now = self._mailbox.offer(key, reads=job.reads)
        self._table.enter(key, (job.context.command, arguments), job)
        self._active[key] = job
        late = DeadlineExceeded(robot=self._robot, command=job.context.command)
        job.timer = asyncio.get_running_loop().call_at(job.context.deadline_at, self._end, job, late)
        if now:
            self._begin(job)
        self._on_change()

    def cancel(self, key: str, reason: str) -> None:
        """End the command of a key; if it has not come yet, it will be refused when it comes."""
        if job := self._active.get(key):
            self._end(job, self._cancelled(job, reason))
        else:
            self._table.bury(key, reason)

    def cancel_all(self, reason: str, *, but_readers: bool = False) -> None:
        """End all commands, those that wait before the one that runs.

        Args:
            reason: for their callers.
            but_readers: leave alone those that only read.
        """
        for job in reversed(list(self._active.values())):
            if not (but_readers and job.reads):
                self._end(job, self._cancelled(job, reason))

    async def settled(self, timeout: float) -> None:
        """Wait until all commands have ended, but not longer than `timeout` [s]."""
        outcomes = [job.outcome for job in self._active.values()]
        if outcomes:
            await asyncio.wait(outcomes, timeout=timeout)

    def _cancelled(self, job: Job, reason: str) -> CommandCancelled:
        return CommandCancelled(robot=self._robot, command=job.context.command, reason=reason)

    def _end(self, job: Job, cause: VrError) -> None:
        if job.run is not None:
            job.run.cancel(cause)
        else:
            self._settle(job, Failed.of(cause))

    def _begin(self, job: Job) -> None:
        run = job.run = self._launch(job)
        run.outcome.add_done_callback(lambda outcome: self._ran(job, run, outcome))

    def _abandon(self, job: Job, run: Run) -> None:
        key, command = job.context.key, job.context.command
        _log.error(
            "%s.%s is abandoned: it heeds no cancel and still runs, though it can reach no child any more; "
            "restart %s",
            *(self._robot, command, self._home),
        )
        self._abandoned[key] = command
        run.over.add_done_callback(lambda _: self._lay_down(key))
        refusal = Failed.of(StillRunning(robot=self._robot, command=command, home=self._home))
        for waiting in reversed(list(self._active.values())):
            if waiting.run is None:
                self._settle(waiting, refusal)

    def _lay_down(self, key: str) -> None:
        _log.warning("%s.%s has ended after all", self._robot, self._abandoned.pop(key))
        self._on_change()

    def _ran(self, job: Job, run: Run, outcome: asyncio.Future[Any]) -> None:
        if not run.over.done():
            self._abandon(job, run)
        error = asyncio.CancelledError() if outcome.cancelled() else outcome.exception()
        if error is None:
            self._settle(job, returned(job.context, outcome.result()))
        else:
            self._settle(job, failed(self._robot, job.context, error, source=job.source))

    def _settle(self, job: Job, reply: Returned | Failed) -> None:
        if job.outcome.done():
            return
        key = job.context.key
        if job.timer is not None:
            job.timer.cancel()
        job.outcome.set_result(reply)
        del self._active[key]
        self._table.end(key)
        if following := self._mailbox.leave(key):
            self._begin(self._active[following])
        self._on_change()
