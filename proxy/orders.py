"""Stops and resumes under way to a controller, as whoever ordered them waits for their end.

The newest order counts: a stop ends the wait of the resumes before it, and a resume that of the stops.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
from collections.abc import Callable, Generator
from typing import Any

from robotree.protocol.messages import Reason
from robotree.proxy.outcome import reason_in_words
from robotree.proxy.will import (
    RELEASE_WITHIN,
    Answer,
    ReleaseConfirmed,
    ReleaseRefused,
    ReleaseUnanswered,
    StopConfirmed,
)
from robotree.vr.errors import CommandFailed

OVERTAKEN_STOP = "a resume came after it, before it was confirmed; if it shall stand, stop again"
OVERTAKEN_RESUME = "a stop came after it; when it is safe, resume again"
TAKEN_BACK = "it was taken back; when it is safe, resume again"
REMEDIES = {
    Reason.STOPPED: "another stop came after the one that was to end; when it is safe, resume again",
    Reason.STALE_EPOCH: "a newer lease is already obeyed; resume again",
}
"""What a person can do about a refusal that does not say it itself."""


class Order:
    """One stop or resume. Awaited, it ends when the controller has confirmed it, and not before.

    Args:
        given_up: called when somebody who awaited it was cancelled before its end came through.

    Raises:
        CommandFailed: it is not obeyed, or a newer order has taken its place.
    """

    def __init__(self, given_up: Callable[[], None] = lambda: None) -> None:
        self._given_up = given_up
        self._end: concurrent.futures.Future[None] = concurrent.futures.Future()
        self._end.set_running_or_notify_cancel()  # so that nobody who awaits it can cancel it for the others

    def __await__(self) -> Generator[Any, None, None]:
        try:
            yield from asyncio.wrap_future(self._end).__await__()
        except asyncio.CancelledError:
            self._given_up()
            raise

    @property
    def obeyed(self) -> bool:
        """Whether the controller has confirmed it."""
        return self._end.done() and self._end.exception() is None

    def finish(self, error: CommandFailed | None = None) -> None:
        """Tell its end, once."""
        if error is None:
            self._end.set_result(None)
        else:
            self._end.set_exception(error)


class Orders:
    """Those of one robot that have not ended. On the loop only.

    Args:
        robot: its name, for the sentences.
    """

    def __init__(self, robot: str) -> None:
        self._robot = robot
        self._stops: list[Order] = []
        self._resumes: list[Order] = []

    def stop(self, order: Order) -> None:
        """A stop is under way from now on."""
        self._stops.append(order)
        self._end(self._resumes, "resume", OVERTAKEN_RESUME)

    def resume(self, order: Order) -> None:
        """A resume is under way from now on."""
        self._resumes.append(order)
        self._end(self._stops, "safe_stop", OVERTAKEN_STOP)

    def take_back(self, resume: Order) -> bool:
        """A resume is not to be obeyed any more; returns whether it was the only one under way."""
        if resume not in self._resumes:
            return False
        self._resumes.remove(resume)
        self._end([resume], "resume", TAKEN_BACK)
        return not self._resumes

    def hear(self, answer: Answer, trouble: str) -> None:
        """End those that the controller has answered.

        Args:
            answer: what it has said.
            trouble: why it is offline, as a clause; empty: it is not.
        """
        match answer:
            case StopConfirmed():
                self._end(self._stops, "safe_stop", "")
            case ReleaseConfirmed():
                self._end(self._resumes, "resume", "")
            case ReleaseRefused(reason=reason):
                why = REMEDIES.get(reason, reason_in_words(reason))
                self._end(self._resumes, "resume", f"its controller does not release the stop: {why}")
            case ReleaseUnanswered():
                why = trouble or f"its controller has not answered for {RELEASE_WITHIN:g} s"
                remedy = "it is not released; look after the controller, then resume again"
                self._end(self._resumes, "resume", f"{why}; {remedy}")

    def _end(self, orders: list[Order], command: str, detail: str) -> None:
        while orders:
            failed = CommandFailed(robot=self._robot, command=command, detail=detail) if detail else None
            orders.pop().finish(failed)
