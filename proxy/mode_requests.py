"""Requests to stop or to resume that a controller has not confirmed; their callers wait for that.

The newest request counts: a stop ends the wait of earlier resumes, and a resume that of earlier stops.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
from collections.abc import Callable, Generator
from typing import Any, Literal

from robotree.protocol.messages import Reason
from robotree.proxy.desired_mode import (
    RELEASE_TIMEOUT,
    ModeAnswer,
    ReleaseConfirmed,
    ReleaseRefused,
    ReleaseUnanswered,
    StopConfirmed,
)
from robotree.proxy.outcome import reason_in_words
from robotree.vr.base.errors import CommandFailed

REPLACED = {
    "safe_stop": "a resume came after it, before it was confirmed; if it shall stand, stop again",
    "resume": "a stop came after it; when it is safe, resume again",
}
"""Why a request has ended that one of the other sort has replaced, by its hook."""
WITHDRAWN = "it was taken back; when it is safe, resume again"
REMEDIES = {
    Reason.STOPPED: "another stop came after the one that was to end; when it is safe, resume again",
    Reason.STALE_EPOCH: "a newer lease is already obeyed; resume again",
}
"""The advice for a refusal whose reason does not name a remedy."""

RequestingHook = Literal["safe_stop", "resume"]
"""The hook of a robot that makes a request."""


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

    def finish(self, error: CommandFailed | None) -> None:
        """Set its end, once."""
        if error is None:
            self._end.set_result(None)
        else:
            self._end.set_exception(error)


class ModeRequests:
    """The newest requests to one robot, all stops or all resumes, that have not ended. On the loop only."""

    def __init__(self, robot: str) -> None:
        self._robot = robot
        self._hook: RequestingHook = "safe_stop"
        """The hook that asks."""
        self._waiting: list[ModeRequest] = []

    def add(self, hook: RequestingHook, request: ModeRequest) -> None:
        """A stop or a resume was sent."""
        if hook != self._hook:
            self._end(self._hook, REPLACED[self._hook])
        self._hook = hook
        self._waiting.append(request)

    def withdraw(self, resume: ModeRequest) -> bool:
        """Drop a resume; returns whether it was the only one."""
        if resume not in self._waiting:
            return False
        self._waiting.remove(resume)
        resume.finish(CommandFailed(robot=self._robot, command="resume", detail=WITHDRAWN))
        return not self._waiting

    def handle(self, answer: ModeAnswer, trouble: str) -> None:
        """End the requests that the controller has answered; `trouble`: why it is offline, if it is."""
        match answer:
            case StopConfirmed():
                self._end("safe_stop")
            case ReleaseConfirmed():
                self._end("resume")
            case ReleaseRefused(reason=reason):
                why = REMEDIES.get(reason, reason_in_words(reason))
                self._end("resume", f"its controller does not release the stop: {why}")
            case ReleaseUnanswered():
                why = trouble or f"its controller has not answered for {RELEASE_TIMEOUT:g} s"
                remedy = "it is not released; look after the controller, then resume again"
                self._end("resume", f"{why}; {remedy}")

    def _end(self, hook: RequestingHook, detail: str = "") -> None:
        while hook == self._hook and self._waiting:
            failed = CommandFailed(robot=self._robot, command=hook, detail=detail) if detail else None
            self._waiting.pop().finish(failed)
