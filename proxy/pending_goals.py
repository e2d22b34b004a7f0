"""Goals that a controller has not finished, seen from the threads in which commands run.

A command starts a goal and waits for its end. `PendingGoals` belongs to the event loop; a `PendingGoal` is
the only object that both sides touch.
"""

from __future__ import annotations

from dataclasses import dataclass

from robotree.protocol.services.goal_client import GoalEnded, GoalProgress, GoalSilent
from robotree.proxy.connection import Connection
from robotree.proxy.motion import Request
from robotree.proxy.session import SessionEvent
from robotree.vr.author.context import Activity
from robotree.vr.running.runner import Waiter


@dataclass(frozen=True, slots=True)
class NotSent:
    """The goal was never sent: the controller is offline, or the command has ended."""

    trouble: str


@dataclass(frozen=True, slots=True)
class OutcomeLost:
    """The goal was sent, and the proxy ends before the goal does."""

    trouble: str


GoalOutcome = GoalEnded | GoalSilent | NotSent | OutcomeLost


@dataclass(slots=True, eq=False)
class PendingGoal:
    """One goal that was started and has not ended."""

    key: int
    request: Request
    activity: Activity
    """The command that asks for it."""
    ttl: float
    """[s] it may take; 0: until reached."""
    repeatable: bool
    """Carried out twice, it ends the same."""
    life: int | None
    """Of the controller, when an earlier process of the proxy may have asked for it; None: none has."""
    _waiter: Waiter
    """In which the command's thread waits for the end when it has been asked to end itself."""
    fraction: float = 0.0
    """Progress, 0 to 1."""
    end: GoalOutcome | None = None
    """How it ended; None: it has not."""

    @property
    def epoch(self) -> int:
        """Of the lease under which it is asked for."""
        return self.activity.context.epoch

    def wait(self, timeout: float) -> bool:
        """Wait for the end, at most `timeout` [s]; returns whether it has ended. Not on the loop.

        A cancel of the command does not end this wait; `Activity.wait_for` is what commands wait in else.
        """
        if self.end is None:
            self._waiter.wait(timeout)
        return self.end is not None

    def progress(self, fraction: float) -> None:
        """Note how far it is."""
        self.fraction = fraction
        self.activity.wake()

    def finish(self, end: GoalOutcome) -> None:
        """Set the end; only the first call counts."""
        if self.end is None:
            self.end = end
            self._waiter.wake()
            self.activity.wake()


class PendingGoals:
    """Starts goals over one connection and follows them to their ends."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._goals: dict[int, PendingGoal] = {}

    # -- from any thread ---------------------------------------------------------------------------

    def start(
        self,
        key: int,
        request: Request,
        *,
        activity: Activity,
        ttl: float,
        repeatable: bool,
        life: int | None = None,
    ) -> PendingGoal:
        """Ask for a movement, as `PendingGoal` has it; it ends at once if that cannot be sent."""
        waiter = self._connection.runner.waiter()
        pending = PendingGoal(key, request, activity, ttl, repeatable, life, waiter)
        self._connection.soon(lambda: self._start(pending))
        return pending

    def cancel(self, pending: PendingGoal) -> None:
        """Cancel the goal. It ends when the controller has answered."""
        self._connection.soon(lambda: self._cancel(pending))

    # -- on the loop -------------------------------------------------------------------------------

    def handle(self, event: SessionEvent) -> None:
        """Take an event of the session; those that are about no pending goal are ignored."""
        match event:
            case GoalProgress(key=key, progress=fraction) if key in self._goals:
                self._goals[key].progress(fraction)
            case GoalEnded(key=key) if key in self._goals:
                self._goals.pop(key).finish(event)
            case GoalSilent(key=key) if key in self._goals:
                pending = self._goals.pop(key)
                pending.finish(event)
                # No command waits for this goal any more, so it must not go on when the link comes back.
                self._cancel(pending)
            case _:
                pass

    def cancel_ended(self) -> None:
        """Cancel all goals whose command has ended, before the command's own thread notices it.

        An unanswered goal is sent again until it is cancelled, and it must not begin any more.
        """
        for pending in self._goals.values():
            if pending.activity.cancelled:
                self._cancel(pending)

    def close(self, trouble: str) -> None:
        """End all goals: the proxy will not learn their ends."""
        while self._goals:
            self._goals.popitem()[1].finish(OutcomeLost(trouble))

    def _start(self, pending: PendingGoal) -> None:
        session, now = self._connection.session, self._connection.now()
        # checked on the loop, where stops and resumes come too
        ended = "its command has been ended" if pending.activity.cancelled else ""
        if trouble := ended or session.trouble or session.denial:
            pending.finish(NotSent(trouble))
            return
        self._goals[pending.key] = pending
        goal = session.start(
            pending.key,
            pending.request,
            epoch=pending.epoch,
            ttl=pending.ttl,
            now=now,
            repeatable=pending.repeatable,
            life=pending.life,
        )
        self._connection.perform(goal)

    def _cancel(self, pending: PendingGoal) -> None:
        session, now = self._connection.session, self._connection.now()
        self._connection.perform(session.cancel(pending.key, epoch=pending.epoch, now=now))
