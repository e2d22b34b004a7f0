"""Requests to stop or to resume that a controller has not confirmed; their callers wait for that.

The newest request counts: a stop ends the wait of earlier resumes, and a resume that of earlier stops.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
from collections.abc import Callable, Generator
from typing import Any

from robotree.protocol.messages import Reason
from robotree.proxy.desired_mode import (
    RELEASE_TIMEOUT,
    Answer,
    ReleaseConfirmed,
    ReleaseRefused,
    ReleaseUnanswered,
    StopConfirmed,
)
from robotree.proxy.outcome import reason_in_words
from robotree.vr.errors import CommandFailed

REPLACED_BY_RESUME = "a resume came after it, before it was confirmed; if it shall stand, stop again"
REPLACED_BY_STOP = "a stop came after it; when it is safe, resume again"
WITHDRAWN = "it was taken back; when it is safe, resume again"
REMEDIES = {
    Reason.STOPPED: "another stop came after the one that was to end; when it is safe, resume again",
    Reason.STALE_EPOCH: "a newer lease is already obeyed; resume again",
}
"""What to do about a refusal whose reason does not say it."""


class ModeRequest:
    """One request to stop or to resume. To await it returns when the controller has confirmed it.

    Args:
        abandoned: called when a task that awaited it is cancelled before its end.

    Raises:
        CommandFailed: it is not obeyed, or a newer request has replaced it.
    """

    def __init__(self, abandoned: Callable[[], None] = lambda: None) -> None:
        self._abandoned = abandoned
        self._end: concurrent.futures.Future[None] = concurrent.futures.Future()
        self._end.set_running_or_notify_cancel()  # so that one waiting task cannot cancel it for the others

    def __await__(self) -> Generator[Any, None, None]:
        try:
            yield from asyncio.wrap_future(self._end).__await__()
        except asyncio.CancelledError:
            self._abandoned()
            raise

    @property
    def confirmed(self) -> bool:
        """Whether the controller has confirmed it."""
        return self._end.done() and self._end.exception() is None

    def finish(self, error: CommandFailed | None = None) -> None:
        """Set its end, once."""
        if error is None:
            self._end.set_result(None)
        else:
            self._end.set_exception(error)


class ModeRequests:
    """The requests to one robot that have not ended. On the loop only.

    Args:
        robot: its name, for the sentences.
    """

    def __init__(self, robot: str) -> None:
        self._robot = robot
        self._stops: list[ModeRequest] = []
        self._resumes: list[ModeRequest] = []

    def stop(self, request: ModeRequest) -> None:
        """A stop was sent."""
        self._stops.append(request)
        self._end(self._resumes, "resume", REPLACED_BY_STOP)

    def resume(self, request: ModeRequest) -> None:
        """A resume was sent."""
        self._resumes.append(request)
        self._end(self._stops, "safe_stop", REPLACED_BY_RESUME)

    def withdraw(self, resume: ModeRequest) -> bool:
        """Drop a resume; returns whether it was the only one."""
        if resume not in self._resumes:
            return False
        self._resumes.remove(resume)
        self._end([resume], "resume", WITHDRAWN)
        return not self._resumes

    def handle(self, answer: Answer, trouble: str) -> None:
        """End the requests that the controller has answered.

        Args:
            answer: of the controller.
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
                why = trouble or f"its controller has not answered for {RELEASE_TIMEOUT:g} s"
                remedy = "it is not released; look after the controller, then resume again"
                self._end(self._resumes, "resume", f"{why}; {remedy}")

    def _end(self, requests: list[ModeRequest], command: str, detail: str) -> None:
        while requests:
            failed = CommandFailed(robot=self._robot, command=command, detail=detail) if detail else None
            requests.pop().finish(failed)
