"""The movement of the robot: one job at a time, the newest; a stop, a hold, silence or a lost link ends it.

A job is a goal, a command or a stream of set-points; its service reports to its sender. A goal that counts as
reached in passing is reported as that, and goes on without a report until it is there: what ends any job
ends it, and the next one begins from its motion. The controller's mode follows from three facts: whether a
stop is in force, whether a job runs, and whether silence ended the last one.

While something moves, the peer that asked for it must be heard: another sender, even one with the same ids,
must not hide that this peer has died. Under a claim, its holder must be heard, by its CLAIMs; without a
claim, the sender on its link, with any message. While nothing moves, nobody has to be heard.

Pure. `now` is controller time in whole milliseconds, so a simulation may run faster or slower than the clock
on the wall.
"""

from collections.abc import Callable, Hashable
from typing import Final, NamedTuple

from robotree.protocol.messages import GoalState, ModeKind, Reason
from robotree.protocol.services.peer import Peer
from robotree.sim.firmware.device import Device, Start
from robotree.sim.firmware.outgoing import Outgoing


class Watchdog:
    """Counts silence.

    Args:
        patience: silence that is allowed [ms].
    """

    def __init__(self, patience: int) -> None:
        self.patience = patience
        self._commander: Hashable = None
        self._heard = 0
        self._latest: tuple[Hashable, int] | None = None
        """The sender that was heard last, and when its message arrived."""

    @property
    def silence(self) -> float:
        """The patience in [s], as people tune it."""
        return self.patience / 1000

    @silence.setter
    def silence(self, seconds: float) -> None:
        self.patience = round(1000 * seconds)

    def receive(self, voice: Hashable, arrived: int) -> None:
        """A message is handled that arrived at a time [ms]; a stop may be handled before older messages."""
        self._latest = voice, arrived
        if voice == self._commander:
            self._heard = max(self._heard, arrived)

    def obey(self, voice: Hashable, speaker: Hashable, now: int) -> None:
        """From `now` [ms] on `voice` must be heard; a message that waited is no sign of life now.

        Args:
            voice: who must be heard.
            speaker: the sender of the message that is obeyed.
            now: [ms]
        """
        latest, arrived = self._latest or (speaker, now)
        self._commander, self._heard = voice, arrived if latest in {speaker, voice} else now

    def rest(self) -> None:
        """From now on nobody has to be heard."""
        self._commander = None

    def silent(self, now: int) -> bool:
        """Whether the silence is too long at `now` [ms]."""
        return self._commander is not None and now - self._heard > self.patience


SUPERSEDED: Final = "A newer goal took its place."
PASSED: Final = "passed"
"""Key of a job whose end has been reported: its service has forgotten it."""


class Job(NamedTuple):
    """Something that moves the robot.

    Attributes:
        key: identifies it.
        speaker: who asked for it.
        voice: who must be heard while it goes on: the speaker, or the holder of the claim.
        progress: reports progress, 0 to 1, at a time [ms], to the sender.
        finish: reports the end, with the reason and a sentence, at a time [ms], to the sender.
        passed: whether its end has been reported, though the robot still moves.
    """

    key: Hashable
    speaker: Peer
    voice: Hashable
    progress: Callable[[float, int], list[Outgoing]]
    finish: Callable[[GoalState, Reason, str, int], list[Outgoing]]
    passed: bool = False


class Movement:
    """The one job of a controller.

    Args:
        device: the robot that it moves.
        silence: of the link that is allowed [ms].
    """

    def __init__(self, device: Device, silence: int) -> None:
        self._device = device
        self._job: Job | None = None
        self.watchdog = Watchdog(silence)
        self.stopped = False
        """Whether a safe stop is in force."""
        self.stops = 1
        """Counts the safe stops: one more with each that begins."""
        self.overtaken = False
        """Whether what is being heard arrived before the newest stop; it neither moves nor releases."""
        self.turns = 0
        """How often something began, or was ended before its end: what was so before need not be so now."""
        self._silent = False

    @property
    def mode(self) -> ModeKind:
        """The mode of the whole controller."""
        if self.stopped:
            return ModeKind.SAFE_STOP
        if self._job is not None:
            return ModeKind.ACTIVE
        return ModeKind.HOLD if self._silent else ModeKind.READY

    @property
    def reason(self) -> Reason:
        """Why it is in that mode."""
        if self.stopped:
            return Reason.OPERATOR
        return Reason.LINK_SILENT if self.mode == ModeKind.HOLD else Reason.NONE

    @property
    def bar(self) -> str:
        """Why nothing may begin now, as one sentence; empty: it may."""
        if self.stopped:
            return "A safe stop is in force; release it first."
        return "A safe stop came after it; look at the robot, then ask again." if self.overtaken else ""

    @property
    def job(self) -> Job | None:
        """The job that runs."""
        return self._job

    def begin(self, job: Job, start: Start, now: int) -> list[Outgoing]:
        """Begin a job in place of whatever runs."""
        out = self._finish(GoalState.CANCELLED, Reason.SUPERSEDED, SUPERSEDED, now)
        start()
        self.turns += 1
        self._job, self._silent = job, False
        self.watchdog.obey(job.voice, job.speaker, now)
        return out

    def adopt(self, speaker: Peer, voice: Hashable, now: int) -> None:
        """Let the running job go on for another speaker, as long as this voice is heard."""
        if self._job is not None:
            self._job = self._job._replace(speaker=speaker, voice=voice)
            self.watchdog.obey(voice, speaker, now)

    def interrupt(self, reason: Reason, text: str, now: int) -> list[Outgoing]:
        """End whatever runs, and hold."""
        if self._job is None:
            return []
        self.turns += 1
        self._device.hold()
        return self._finish(GoalState.CANCELLED, reason, text, now)

    def leave(self, key: Hashable) -> None:
        """A job's own service has ended it: hold. Harmless when it does not run."""
        if self._job is not None and self._job.key == key:
            self.turns += 1
            self._device.hold()
            self._end()

    def stop(self, now: int) -> list[Outgoing]:
        """Hold, and begin nothing until `release`."""
        self.stops += not self.stopped
        self.stopped = True
        self.turns += 1
        out = self._finish(GoalState.CANCELLED, Reason.STOPPED, "A safe stop was asked for.", now)
        self._device.hold()
        return out

    def release(self) -> None:
        """End a stop, or the hold that silence brought."""
        self.stopped = self._silent = False

    def follow_up(self, now: int) -> list[Outgoing]:
        """Tell how the job goes, and end it when it has ended."""
        if self._job is None:
            return []
        progress = self._device.progress()
        if self._job.passed and not progress.done:
            return []
        if progress.passed and not progress.done:
            finish = self._job.finish
            self._job = self._job._replace(key=PASSED, finish=_nobody_waits, passed=True)
            return finish(GoalState.SUCCEEDED, Reason.NONE, "", now)
        if not progress.done:
            return self._job.progress(progress.fraction, now)
        failed = progress.reason != Reason.NONE
        if failed:
            self._device.hold()
        state = GoalState.FAILED if failed else GoalState.SUCCEEDED
        return self._finish(state, progress.reason, progress.text, now)

    def fall_silent(self, now: int) -> str:
        """Return the text for people if the commander has just fallen silent; then `interrupt`."""
        if not self.watchdog.silent(now):
            return ""
        self._silent = True
        return f"Who commands was not heard for {self.watchdog.patience / 1000:g} s."

    def lose_link(self, via: Hashable) -> str:
        """Why to `interrupt` now that a link has ended; empty: the job is not commanded over it."""
        if self._job is None or self._job.speaker.via != via:
            return ""
        self._silent = True
        return "The link to who commands has ended."

    def _finish(self, state: GoalState, reason: Reason, text: str, now: int) -> list[Outgoing]:
        job = self._job
        if job is None:
            return []
        self._end()
        return job.finish(state, reason, text, now)

    def _end(self) -> None:
        self._job = None
        self.watchdog.rest()


def _nobody_waits(_: GoalState, __: Reason, ___: str, ____: int) -> list[Outgoing]:
    return []
