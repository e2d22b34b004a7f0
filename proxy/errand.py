"""Errands: goals under way, seen from the threads in which commands run.

A command sends an errand out and waits for its end. The desk belongs to the event loop; an errand is the one
thing that both sides touch.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass

from robotree.protocol.services.goal_client import GoalEnded, GoalProgress, GoalSilent
from robotree.proxy.connection import Connection
from robotree.proxy.motion import Request
from robotree.proxy.session import Event
from robotree.vr.context import Activity


@dataclass(frozen=True, slots=True)
class NotSent:
    """The errand never left: no controller, or an ended command."""

    trouble: str


@dataclass(frozen=True, slots=True)
class Unheard:
    """The errand has left, and nobody is here any more to hear of its end."""

    trouble: str


End = GoalEnded | GoalSilent | NotSent | Unheard


class Errand:
    """One goal under way.

    Args:
        key: of the goal.
        activity: the command that asks for it.
    """

    def __init__(self, key: int, activity: Activity) -> None:
        self.key = key
        self.activity = activity
        self.epoch = activity.context.epoch
        self.fraction = 0.0
        """How far it is, 0 to 1."""
        self.end: End | None = None
        """How it ended; None while it is under way."""
        self._over = threading.Event()

    def wait(self, timeout: float) -> bool:
        """Wait for the end, at most `timeout` [s]; returns whether it has come. Not on the loop."""
        return self._over.wait(timeout)

    def finish(self, end: End) -> None:
        """Tell the end; the first one stands."""
        if self.end is None:
            self.end = end
            self._over.set()


class Desk:
    """Sends errands out over one connection and hears how they fare."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._out: dict[int, Errand] = {}

    # -- from any thread ---------------------------------------------------------------------------

    def send_out(
        self, key: int, request: Request, *, activity: Activity, ttl: float, repeatable: bool
    ) -> Errand:
        """Ask the controller for a movement.

        Args:
            key: of the goal.
            request: what to do.
            activity: the command that asks for it.
            ttl: [s] it may take; 0: until reached.
            repeatable: carried out twice, it ends the same.

        Returns:
            The errand; it ends at once when the controller is offline or the command has been ended.
        """
        errand = Errand(key, activity)
        self._connection.soon(lambda: self._start(errand, request, ttl, repeatable=repeatable))
        return errand

    def recall(self, errand: Errand) -> None:
        """Ask for the end of the movement. The errand ends when the controller has answered."""
        self._connection.soon(lambda: self._cancel(errand))

    # -- on the loop -------------------------------------------------------------------------------

    def hear(self, event: Event) -> None:
        """Take what the session tells; what is about no errand does not matter here."""
        match event:
            case GoalProgress(key=key, progress=fraction) if key in self._out:
                self._out[key].fraction = fraction
            case GoalEnded(key=key) if key in self._out:
                self._out.pop(key).finish(event)
            case GoalSilent(key=key) if key in self._out:
                errand = self._out.pop(key)
                errand.finish(event)
                # Nobody waits for this movement any more, so it must not go on when the link comes back.
                self._cancel(errand)
            case _:
                pass

    def recall_ended(self) -> None:
        """Ask for the end of all whose command has been ended, before the command's thread takes note of it.

        Until then a movement that nobody has answered is asked for again, and it must not begin any more.
        """
        for errand in self._out.values():
            if errand.activity.cancelled:
                self._cancel(errand)

    def close(self, trouble: str) -> None:
        """End all errands: nobody will hear of them any more."""
        while self._out:
            self._out.popitem()[1].finish(Unheard(trouble))

    def _start(self, errand: Errand, request: Request, ttl: float, *, repeatable: bool) -> None:
        session, now = self._connection.session, self._connection.now()
        if errand.activity.cancelled:  # here, where stops and resumes come too, none can slip in between
            errand.finish(NotSent("its command has been ended"))
            return
        if not session.online:
            errand.finish(NotSent(session.trouble))
            return
        if session.denial:
            errand.finish(NotSent(session.denial))
            return
        self._out[errand.key] = errand
        goal = session.start(errand.key, request, epoch=errand.epoch, ttl=ttl, now=now, repeatable=repeatable)
        self._connection.perform(goal)

    def _cancel(self, errand: Errand) -> None:
        session, now = self._connection.session, self._connection.now()
        self._connection.perform(session.cancel(errand.key, epoch=errand.epoch, now=now))
