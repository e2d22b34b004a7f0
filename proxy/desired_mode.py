"""The mode that a proxy wants its controller to be in, until the controller has confirmed it.

A stop that was requested here stays wanted until the controller has confirmed its release: it is sent again
until it is confirmed, and whenever the controller reports that it is not stopped. A release is one attempt,
bounded in time. If it fails, the stop stays wanted, unless the controller refuses it because somebody else
commands. If its caller no longer waits after it was sent, a stop is wanted, even if that stop was requested
elsewhere: the release may still be in a socket, and the caller was told that the robot stays stopped.

A release names the stop that it ends, by the count of stops that the controller reports. While our own stop
is unconfirmed its count is unknown. Then the stop is sent until it is confirmed, and the release after it;
reports from before that answer neither.

Pure: `now` comes from the caller.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from robotree.protocol.messages import Mode, ModeKind, Reason, SetMode
from robotree.proxy.translate import Target

REPEAT_PERIOD = 0.25
"""[s] between two repetitions of what is not confirmed."""
RELEASE_TIMEOUT = 2.2
"""[s] from its request within which a release is confirmed or fails, also while the controller is offline:
a robot must not be released by a request from long ago. A stop is repeated without end. This is less than an
agent waits for the answer, so that the caller learns why it failed."""
HOLDING_MODES = {
    ModeKind.SAFE_STOP: "its controller is in safe stop",
    ModeKind.FAULT: "its controller cannot move",
}
"""Modes in which a controller takes no goal until it is released, as clauses."""
REFUSALS = {Reason.STOPPED, Reason.STALE_EPOCH, Reason.NOT_IN_CONTROL, Reason.BAD_EPOCH, Reason.OTHER_LIFE}
"""Reasons in a MODE that only answer a release: it is not obeyed. It is not sent again, because it could undo
a later stop."""


@dataclass(frozen=True, slots=True)
class StopConfirmed:
    """The controller has reported that it is stopped, on this link and since the stop was requested."""


@dataclass(frozen=True, slots=True)
class ReleaseConfirmed:
    """The controller has reported that it is not stopped, since the release was requested."""


@dataclass(frozen=True, slots=True)
class ReleaseRefused:
    """The controller does not obey the release, and reports why."""

    reason: Reason


@dataclass(frozen=True, slots=True)
class ReleaseUnanswered:
    """The release has failed: the controller has not answered it within RELEASE_TIMEOUT."""


ModeAnswer = StopConfirmed | ReleaseConfirmed | ReleaseRefused | ReleaseUnanswered
"""How a stop or a release ended."""


@dataclass(slots=True)
class _Release:
    epoch: int
    until: float
    """[s] When it ends without success."""
    stops: int | None
    """The count of the stop that it ends; None: not reported yet."""
    sent: bool = False
    life: int = 0
    """Of the controller that reported that count."""


class DesiredMode:
    """The mode that is wanted of one controller."""

    def __init__(self, controller: Target) -> None:
        self._controller = controller
        self.stopped = False
        """Whether a stop is wanted, confirmed or not."""
        self._confirmed = False
        """Whether its latest report on this link, since the stop was requested, says that it is stopped."""
        self._release: _Release | None = None
        self._sent_at = -math.inf

    @property
    def pending(self) -> bool:
        """Whether anything is wanted: a stop, or a release that has not ended."""
        return self.stopped or self._release is not None

    @property
    def releasing(self) -> bool:
        """Whether a release is on its way to the controller."""
        return self._release is not None and self._release.sent

    def opened(self) -> None:
        """There is a new link, over which nothing is confirmed."""
        self._confirmed = False

    def stop(self) -> None:
        """Want it stopped; a release that has not ended is dropped."""
        self.stopped, self._confirmed = True, False
        self._release, self._sent_at = None, -math.inf

    def withdraw(self) -> None:
        """Drop the release. If it was sent already, a stop is sent after it."""
        release, self._release = self._release, None
        if release is not None and release.sent:
            self.stop()

    def release(self, epoch: int, reported: int, now: float, life: int = 0) -> None:
        """Want the present stop released.

        Args:
            epoch: of the caller's lease.
            reported: the count of stops in the controller's latest report; 0: none.
            now: [s]
            life: of the controller, from the same report; 0: none.
        """
        if self.stopped and not self._confirmed:
            self._release = _Release(epoch, now + RELEASE_TIMEOUT, None)
        else:  # an earlier release may still be on its way
            sent = self.releasing
            self._release = _Release(epoch, now + RELEASE_TIMEOUT, reported, sent, life)
            self._sent_at = -math.inf

    def receive(self, mode: Mode, *, restarted: bool, was_stopped: bool) -> list[ModeAnswer]:
        """Take a report of the controller over the present link.

        It may have restarted since its previous report, according to which it was stopped or not.
        """
        stopped, release = mode.mode == ModeKind.SAFE_STOP, self._release
        if release is None and not self.stopped and restarted and was_stopped and not stopped:
            self.stop()
            return []
        answers: list[ModeAnswer] = (
            [StopConfirmed()] if stopped and self.stopped and not self._confirmed else []
        )
        self._confirmed = stopped
        if release is None:
            return answers
        if release.stops is None:
            if mode.mode in HOLDING_MODES:
                release.stops, release.life, self._sent_at = mode.stops, mode.life, -math.inf
        elif mode.mode not in HOLDING_MODES:
            if restarted or not 0 < mode.stops < release.stops:  # else it was reported before that stop
                self._release, self.stopped = None, False
                answers.append(ReleaseConfirmed())
        elif release.sent and mode.reason in REFUSALS:
            self._release = None
            if mode.reason == Reason.NOT_IN_CONTROL:
                self.stopped = False  # else our stop would follow the holder's release
            answers.append(ReleaseRefused(Reason(mode.reason)))
        return answers

    def expire(self, now: float) -> list[ModeAnswer]:
        """Give up the release whose time is over."""
        if self._release is None or now < self._release.until:
            return []
        self.withdraw()
        return [ReleaseUnanswered()]

    def due(self, *, link_open: bool) -> float:
        """Return when to call `expire` and, over an open link, `messages_due` next [s]."""
        release = self._release
        known = release is not None and release.stops is not None
        due = math.inf if release is None else release.until
        if link_open and (known or (self.stopped and not self._confirmed)):
            due = min(due, self._sent_at + REPEAT_PERIOD)
        return due

    def messages_due(self, now: float) -> list[SetMode]:
        """The messages to send now over the open link."""
        release = self._release
        if now < self._sent_at + REPEAT_PERIOD:
            return []
        if release is not None and release.stops is not None:
            release.sent = True
            wish = ModeKind.READY
            message = SetMode(release.epoch, *self._controller, wish, release.stops, release.life)
        elif self.stopped and not self._confirmed:
            message = SetMode(0, *self._controller, ModeKind.SAFE_STOP)
        else:
            return []
        self._sent_at = now
        return [message]
