"""The controller's mode and how it is reported: stop, release, silence, operator control.

Everybody may stop it; only a lease that is not stale, or the operator in control, may start it again. A
release that arrived before the newest stop is void, however late it is handled, and so is one that names an
older stop: a stop is undone only by somebody who could know of it.

Pure. `now` is controller time in whole milliseconds.
"""

from collections.abc import Hashable
from typing import Final

from robotree.protocol.messages import (
    Heartbeat,
    MavAutopilot,
    MavModeFlag,
    MavSeverity,
    MavState,
    MavType,
    Mode,
    ModeKind,
    Reason,
    SetMode,
)
from robotree.protocol.services import standard_modes
from robotree.protocol.services.heartbeat import HeartbeatSender
from robotree.protocol.services.peer import Peer
from robotree.sim.firmware.goals import Goals
from robotree.sim.firmware.movement import Movement
from robotree.sim.firmware.outgoing import Announcer, Outgoing
from robotree.sim.firmware.rights import Rights
from robotree.sim.firmware.stops import stop_asked_by
from robotree.sim.firmware.telemetry import boot_ms

_FLAGS: Final = int(MavModeFlag.CUSTOM_MODE_ENABLED | MavModeFlag.HIL_ENABLED)
_ARMED: Final = _FLAGS | int(MavModeFlag.SAFETY_ARMED)
_STATES: Final = {ModeKind.ACTIVE: MavState.ACTIVE, ModeKind.SAFE_STOP: MavState.CRITICAL}


class Modes:
    """The mode of one controller.

    Args:
        movement: what runs and what is in its way.
        goals: whose epoch is told, and fences releases.
        rights: who may release.
        announcer: for sentences to people.
        mav_type: what the heartbeats say that the robot is.
    """

    def __init__(
        self, movement: Movement, goals: Goals, rights: Rights, announcer: Announcer, mav_type: MavType
    ) -> None:
        self._movement, self._goals, self._rights, self._announcer = movement, goals, rights, announcer
        self._mav_type = mav_type
        self._heartbeats = HeartbeatSender()
        self._told: tuple[ModeKind, int, int] | None = None

    def receive(self, wish: SetMode, peer: Peer, now: int) -> list[Outgoing]:
        """Take a wish for a mode; answered by the mode, and by the reason where it is not the wished one."""
        out: list[Outgoing] = []
        answer: Reason | None = None
        if stop_asked_by(wish):
            out = self.stop(now)
        elif wish.mode != ModeKind.READY:
            answer = Reason.BAD_ARGUMENT
        elif self._rights.guard(peer) is not None:
            answer = Reason.NOT_IN_CONTROL
        elif self._movement.overtaken or self._is_outlived(wish):
            answer = Reason.STOPPED
        elif (refusal := self._rights.objection(wish.epoch, wish.life)) is not None:
            answer = refusal[0]
        else:
            self._goals.fence(wish.epoch)
            out = self.release()
        return [*out, *self.news(now), Outgoing(self.mode(now, answer), peer.via)]

    def stop(self, now: int) -> list[Outgoing]:
        """Stop."""
        if self._movement.stopped:
            return []
        text = "Safe stop: holding, compliant; goals are refused until release."
        return self._movement.stop(now) + self._announcer.announce(MavSeverity.WARNING, text)

    def release(self) -> list[Outgoing]:
        """End the stop, if one is in force."""
        was_stopped = self._movement.stopped
        self._movement.release()
        return self._announcer.announce(MavSeverity.NOTICE, "Safe stop released.") if was_stopped else []

    def tick(self, now: int) -> list[Outgoing]:
        """End what may not go on, because its speaker is silent."""
        silence = self._movement.fall_silent(now)
        return (self._desert(silence, now) if silence else []) + self.news(now)

    def news(self, now: int) -> list[Outgoing]:
        """Tell all when mode, epoch or patience has changed."""
        state = (self._movement.mode, self._goals.epoch, self._movement.watchdog.patience)
        if state == self._told:
            return []
        changed = self._told is not None and self._told[0] != state[0]
        self._told = state
        self._heartbeats.hurry()
        messages = [Outgoing(self.mode(now), telemetry=True)]
        if changed:
            messages.append(Outgoing(standard_modes.current(self._movement.mode), telemetry=True))
        return messages

    def mode(self, now: int, reason: Reason | None = None) -> Mode:
        """The mode as it is told; `reason`: why it is not another one."""
        movement = self._movement
        why = movement.reason if reason is None else reason
        patience = movement.watchdog.patience
        epoch, life = self._goals.epoch, self._rights.claims.life
        return Mode(boot_ms(now), epoch, patience, movement.mode, why, movement.stops, life)

    def heartbeat(self) -> Heartbeat:
        """The mode as every ground station understands it."""
        movement = self._movement
        flags, mode = _FLAGS if movement.stopped else _ARMED, movement.mode
        return Heartbeat(
            self._mav_type, MavAutopilot.GENERIC, flags, mode, _STATES.get(mode, MavState.STANDBY)
        )

    def join(self, following: float) -> None:
        """Telemetry goes out now, and the next at `following` [s]: what is due until then goes with this one.

        So both sides wake up once for all of it, from now on every time.
        """
        for one in (self._heartbeats, self._rights.control):
            if one.due < following:
                one.hurry()

    def beats(self, now: int) -> list[Outgoing]:
        """The heartbeat, and who is in control, when they are due."""
        seconds, out = now / 1000, list[Outgoing]()
        if seconds >= self._heartbeats.due:
            beats = self._heartbeats.tick(self.heartbeat(), seconds)
            out += [Outgoing(beat, telemetry=True) for beat in beats]
        if seconds >= self._rights.control.due:
            out += self._control(now) + self.news(now)
        return out

    @property
    def beat_due(self) -> float:
        """When the next heartbeat is due, in controller time [s]."""
        return self._heartbeats.due

    def _is_outlived(self, release: SetMode) -> bool:
        """Whether the stop in force began after the one that the release is meant for."""
        return self._movement.stopped and release.stops not in {0, self._movement.stops}

    def lose_link(self, via: Hashable, now: int) -> list[Outgoing]:
        """A link has ended: what is commanded over it ends, too; what others command goes on."""
        return self._desert(self._movement.lose_link(via), now)

    def _desert(self, text: str, now: int) -> list[Outgoing]:
        """End what runs, for its commander is gone; `text` says why, empty: it is not."""
        if not text:
            return []
        out = self._movement.interrupt(Reason.LINK_SILENT, text, now)
        return out + self._announcer.announce(MavSeverity.WARNING, f"{text} Holding, compliant.")

    def _control(self, now: int) -> list[Outgoing]:
        """Tell who is in control; what others move ends when somebody takes it."""
        out, owner = self._rights.tick(now)
        job = self._movement.job
        if owner is None or job is None or job.speaker == owner:
            return out
        text = f"System {owner.system} took operator control."
        return out + self._movement.interrupt(Reason.NOT_IN_CONTROL, text, now)
