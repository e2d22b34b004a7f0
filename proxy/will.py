"""What is wanted of a controller's mode: a stop, or the release of one, until the controller has answered.

A stop that was asked for here is wanted until the controller has confirmed its release: it is said again
until it is confirmed, and whenever the controller tells that it is not stopped. A release is one attempt to
end it, bounded in time. Where it fails, the stop is wanted as before; but where the controller refuses it
because somebody else commands, it stays stopped, and the release is theirs from then on. Where it has been
said and nobody waits for its answer any more, the stop is wanted whoever asked for it: what was said may
still lie in a socket and be obeyed, and who was told that the robot stays stopped must find it so.

A release names the stop that it ends, by the count that the controller tells. While our own stop is
unconfirmed its count is not known yet. Then the stop is said until it is confirmed, and the release after it:
whatever was told before the two tells nothing about either.

Pure: moments come from the caller.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from robotree.protocol.messages import Mode, ModeKind, Reason, SetMode
from robotree.proxy.translate import Target

INSIST = 0.25
"""[s] between two repetitions of what is not confirmed."""
RELEASE_WITHIN = 2.2
"""[s] from when it is asked for, within which a release is carried out or given up, also where its controller
is away: nobody shall find a robot released by what was asked for long ago. A stop is repeated for ever. It is
less than an agent waits for it, so that whoever asked hears why."""
HOLDING = {ModeKind.SAFE_STOP: "its controller is in safe stop", ModeKind.FAULT: "its controller cannot move"}
"""Modes in which a controller takes no goal until it is released, as clauses."""
REFUSALS = {
    Reason.STOPPED,
    Reason.STALE_EPOCH,
    Reason.NOT_IN_CONTROL,
    Reason.BAD_EPOCH,
    Reason.OTHER_LIFE,
}
"""Reasons that a MODE gives only where it answers a release: that release is not obeyed. Said once more, it
could undo a stop that came after it."""


@dataclass(frozen=True, slots=True)
class StopConfirmed:
    """The controller has told that it is stopped, on this link and since the stop was asked for."""


@dataclass(frozen=True, slots=True)
class ReleaseConfirmed:
    """The controller has told that it is not stopped, since the release was asked for."""


@dataclass(frozen=True, slots=True)
class ReleaseRefused:
    """The controller does not obey the release, and says why."""

    reason: Reason


@dataclass(frozen=True, slots=True)
class ReleaseUnanswered:
    """The release was given up: the controller has not answered it within RELEASE_WITHIN."""


Answer = StopConfirmed | ReleaseConfirmed | ReleaseRefused | ReleaseUnanswered
"""What became of a stop or a release."""


@dataclass(slots=True)
class _Release:
    epoch: int
    until: float
    """[s] When it is given up."""
    stops: int | None
    """The count of the stop that it ends; None: not told yet."""
    said: bool = False
    life: int = 0
    """Of the controller that told that count."""


class Will:
    """What is wanted of one controller's mode."""

    def __init__(self, controller: Target) -> None:
        self._controller = controller
        self.stopped = False
        """Whether a stop is wanted, confirmed or not."""
        self._confirmed = False
        """Whether it told last that it is stopped, on this link and since the stop was asked for."""
        self._release: _Release | None = None
        self._said_at = -math.inf

    @property
    def pending(self) -> bool:
        """Whether anything is wanted: a stop, or a release that has not ended."""
        return self.stopped or self._release is not None

    @property
    def releasing(self) -> bool:
        """Whether a release is on its way to the controller."""
        return self._release is not None and self._release.said

    def opened(self) -> None:
        """There is a new link, over which nothing is confirmed."""
        self._confirmed = False

    def stop(self) -> None:
        """Have it stopped; a release that is under way is taken back."""
        self.stopped, self._confirmed = True, False
        self._release, self._said_at = None, -math.inf

    def take_back(self) -> None:
        """Have nothing released any more. If that was said already, the stop is said after it."""
        release, self._release = self._release, None
        if release is not None and release.said:
            self.stop()

    def release(self, epoch: int, told: int, now: float, life: int = 0) -> None:
        """Have the stop released that is in force.

        Args:
            epoch: of whoever asks for it.
            told: the count of stops that the controller told last; 0: none.
            now: [s]
            life: of the controller, as it told it with the count; 0: it tells none.
        """
        if self.stopped and not self._confirmed:
            self._release = _Release(epoch, now + RELEASE_WITHIN, None)
        else:  # what was said for an earlier one is still on its way
            said = self.releasing
            self._release = _Release(epoch, now + RELEASE_WITHIN, told, said, life)
            self._said_at = -math.inf

    def hear(self, mode: Mode, *, anew: bool, lost: bool) -> list[Answer]:
        """Take what the controller tells over the present link.

        Args:
            mode: the word.
            anew: whether the controller has restarted since its last word.
            lost: whether it was stopped then.
        """
        stopped, release = mode.mode == ModeKind.SAFE_STOP, self._release
        if release is None and not self.stopped and anew and lost and not stopped:
            self.stop()
            return []
        news: list[Answer] = [StopConfirmed()] if stopped and self.stopped and not self._confirmed else []
        self._confirmed = stopped
        if release is None:
            return news
        if release.stops is None:
            if mode.mode in HOLDING:
                release.stops, release.life, self._said_at = mode.stops, mode.life, -math.inf
        elif mode.mode not in HOLDING:
            if anew or not 0 < mode.stops < release.stops:  # else it was told before that stop
                self._release, self.stopped = None, False
                news.append(ReleaseConfirmed())
        elif release.said and mode.reason in REFUSALS:
            self._release = None
            if mode.reason == Reason.NOT_IN_CONTROL:
                self.stopped = False  # else nobody could: the holder's release would be followed by our stop
            news.append(ReleaseRefused(Reason(mode.reason)))
        return news

    def expire(self, now: float) -> list[Answer]:
        """Give up the release whose time is over."""
        if self._release is None or now < self._release.until:
            return []
        self.take_back()
        return [ReleaseUnanswered()]

    def say(self, now: float) -> list[SetMode]:
        """What is to be said now over the open link."""
        release = self._release
        if now - self._said_at < INSIST:
            return []
        if release is not None and release.stops is not None:
            release.said = True
            wish = ModeKind.READY
            message = SetMode(release.epoch, *self._controller, wish, release.stops, release.life)
        elif self.stopped and not self._confirmed:
            message = SetMode(0, *self._controller, ModeKind.SAFE_STOP)
        else:
            return []
        self._said_at = now
        return [message]
