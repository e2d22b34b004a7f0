"""The controller's program: messages in, set-points down, telemetry and answers out.

It obeys one goal at a time, the newest; keeps keys and epochs through protocol's `GoalServer`; stops for
anyone and starts again only for a lease that is not stale; and holds by itself when nobody is heard
(`watchdog`). Every mode it can be in follows from three facts: is a stop in force, is the link silent, does a
goal run.

Pure: no socket, no thread, no clock. `now` is controller time in whole milliseconds, counted by the physics.
"""

from collections.abc import Collection, Hashable, Iterable, Sequence
from typing import Final, NamedTuple

from robotree.protocol.frame import Frame
from robotree.protocol.messages import (
    AnyMessage,
    Goal,
    GoalCancel,
    GoalState,
    Heartbeat,
    MavAutopilot,
    MavComponent,
    MavModeFlag,
    MavSeverity,
    MavState,
    MavType,
    Mode,
    ModeKind,
    NamedValueFloat,
    Reason,
    SetMode,
    Timesync,
)
from robotree.protocol.services import timesync
from robotree.protocol.services.goal_server import Abandon, Begin, Effect, GoalId, GoalServer, Refusal
from robotree.protocol.services.heartbeat import HeartbeatSender
from robotree.protocol.services.peer import Peer, Send
from robotree.protocol.services.statustext import Speaker
from robotree.sim.device import Device, Start
from robotree.sim.errors import GoalRefused
from robotree.sim.telemetry import Stream
from robotree.sim.watchdog import Watchdog

SILENCE: Final = 2.0
"""[s] of controller time after which a silent link makes the robot hold: two heartbeats missed."""
MODE_PERIOD: Final = 500
"""[ms] between two messages MODE that tell nothing new."""
COMPONENT: Final = MavComponent.AUTOPILOT1
"""The controller's own component, where ground stations look for it."""
_STATES: Final = {ModeKind.ACTIVE: MavState.ACTIVE, ModeKind.SAFE_STOP: MavState.CRITICAL}


class Outgoing(NamedTuple):
    """Something to say: to `via` alone, or to all (None); of telemetry only the newest matters."""

    message: AnyMessage
    via: Hashable | None = None
    telemetry: bool = False
    instance: Hashable = None


class Firmware:
    """The program of one controller.

    Args:
        device: the robot that it moves.
        streams: what it tells by itself.
        system: its MAVLink system id.
        kind: what its heartbeats say it is.
        silence: of the link that it bears [s of controller time].
    """

    def __init__(
        self,
        device: Device,
        streams: Sequence[Stream],
        *,
        system: int,
        kind: MavType,
        silence: float = SILENCE,
    ) -> None:
        self.system = system
        self._device, self._streams, self._kind = device, streams, kind
        self._due = [0] * len(streams)
        self._goals = GoalServer(device.verbs, self._check)
        self._running: GoalId | None = None
        self._prepared: Start | None = None
        self._watchdog = Watchdog(round(1000 * silence))
        self._stopped = self._silent = False
        self._heartbeats = HeartbeatSender()
        self._speaker = Speaker()
        self._told: tuple[ModeKind, int] | None = None
        self._mode_due = 0

    @property
    def mode(self) -> ModeKind:
        """What the controller is doing as a whole."""
        if self._stopped:
            return ModeKind.SAFE_STOP
        if self._running is not None:
            return ModeKind.ACTIVE
        return ModeKind.HOLD if self._silent else ModeKind.READY

    def hear(self, frame: Frame, via: Hashable, now: int) -> list[Outgoing]:
        """Take one intact frame.

        Args:
            frame: from whichever link.
            via: names that link; answers go there.
            now: controller time [ms].

        Returns:
            What to say.
        """
        self._watchdog.hear((frame.system, frame.component), now)
        message = frame.message
        match message:
            case Goal() | GoalCancel() if self._addressed(message.target_system, message.target_component):
                peer = Peer(via, frame.system, frame.component)
                return self._carry_out(self._goals.receive(message, peer, now / 1000), now) + self._news(now)
            case SetMode() if not message.target_system or self._addressed(
                message.target_system, message.target_component
            ):
                return self._set_mode(message, via, now)
            case Timesync():
                return [Outgoing(answer, via) for answer in timesync.answer(message, now / 1000)]
            case _:
                return []

    def greet(self, via: Hashable, now: int) -> list[Outgoing]:
        """What to say first over the link `via`: that we are there, and how."""
        return [Outgoing(self._heartbeat(), via), *self._mode_to(via, now, self._reason())]

    def tick(self, now: int) -> list[Outgoing]:
        """Do what is due; call it after every batch of steps.

        Args:
            now: controller time [ms].

        Returns:
            What to say.
        """
        out = self._follow_up(now)
        out += self._carry_out(self._goals.tick(now / 1000), now)
        out += self._watch(now)
        out += self._news(now)
        if now >= self._mode_due:
            out += self._mode_to(None, now, self._reason())
        out += [
            Outgoing(beat, telemetry=True) for beat in self._heartbeats.tick(self._heartbeat(), now / 1000)
        ]
        busy = self._running is not None
        for i, stream in enumerate(self._streams):
            if now >= self._due[i]:
                self._due[i] = max(self._due[i] + stream.period, now + 1)
                out += [Outgoing(each, None, True, _instance(each)) for each in stream.read(now, busy)]
        return out

    # -- goals

    def _check(self, goal: Goal) -> Refusal | None:
        """Why a goal cannot be begun now; what was planned meanwhile is kept for its beginning."""
        if self._stopped:
            return Reason.STOPPED, "A safe stop is in force; release it first."
        try:
            self._prepared = self._device.prepare(goal.verb, goal.args)
        except GoalRefused as refusal:
            return refusal.reason, str(refusal)
        return None

    def _carry_out(self, effects: Iterable[Effect], now: int) -> list[Outgoing]:
        out: list[Outgoing] = []
        for effect in effects:
            match effect:
                case Send(message=message, via=via):
                    out.append(Outgoing(message, via))
                case Begin(id=goal):
                    out += self._begin(goal, now)
                case Abandon(id=goal):
                    if goal == self._running:
                        self._device.hold()
                        self._end(now)
        return out

    def _begin(self, goal: GoalId, now: int) -> list[Outgoing]:
        out: list[Outgoing] = []
        for older in self._goals.unfinished:
            if older != goal:
                text = "A newer goal took its place."
                out += self._finish(older, GoalState.CANCELLED, now, Reason.SUPERSEDED, text)
        if self._prepared is not None:
            self._prepared()
        self._prepared, self._running, self._silent = None, goal, False
        self._watchdog.obey((goal.system, goal.component), now)
        return out + self._carry_out(self._goals.activate(goal, now / 1000), now)

    def _follow_up(self, now: int) -> list[Outgoing]:
        """Report on the goal that runs."""
        goal = self._running
        if goal is None:
            return []
        progress = self._device.progress()
        if not progress.done:
            return self._carry_out(self._goals.progress(goal, progress.fraction, now / 1000), now)
        failed = progress.reason != Reason.NONE
        if failed:
            self._device.hold()
        state = GoalState.FAILED if failed else GoalState.SUCCEEDED
        out = self._finish(goal, state, now, progress.reason, progress.text)
        self._end(now)
        return out

    def _finish(self, goal: GoalId, state: GoalState, now: int, reason: Reason, text: str) -> list[Outgoing]:
        return self._carry_out(self._goals.finish(goal, state, now / 1000, reason, text), now)

    def _end(self, now: int) -> None:
        self._running = None
        self._watchdog.rest(now)

    # -- modes

    def _set_mode(self, wish: SetMode, via: Hashable, now: int) -> list[Outgoing]:
        out: list[Outgoing] = []
        answer: Reason | None = None
        match wish.mode:
            case ModeKind.SAFE_STOP:
                out = self._stop(now)
            case ModeKind.READY if not self._goals.fence(wish.epoch):
                answer = Reason.STALE_EPOCH
            case ModeKind.READY:
                out = self._release()
            case _:
                answer = Reason.BAD_ARGUMENT
        return out + self._news(now) + self._mode_to(via, now, self._reason() if answer is None else answer)

    def _stop(self, now: int) -> list[Outgoing]:
        if self._stopped:
            return []
        self._stopped = True
        out = self._carry_out(
            self._goals.abandon_all(Reason.STOPPED, now / 1000, "A safe stop was asked for."), now
        )
        self._device.hold()
        return out + self._say(
            MavSeverity.WARNING, "Safe stop: holding, compliant; goals are refused until release."
        )

    def _release(self) -> list[Outgoing]:
        was_stopped, self._stopped, self._silent = self._stopped, False, False
        return self._say(MavSeverity.NOTICE, "Safe stop released.") if was_stopped else []

    def _watch(self, now: int) -> list[Outgoing]:
        if self._silent or not self._watchdog.silent(now):
            return []
        self._silent = True
        text = f"Nobody was heard for {self._watchdog.patience / 1000:g} s."
        out = self._carry_out(self._goals.abandon_all(Reason.LINK_SILENT, now / 1000, text), now)
        return out + self._say(MavSeverity.WARNING, f"{text} Holding, compliant.")

    def _reason(self) -> Reason:
        if self._stopped:
            return Reason.OPERATOR
        return Reason.LINK_SILENT if self.mode == ModeKind.HOLD else Reason.NONE

    def _news(self, now: int) -> list[Outgoing]:
        """Tell all when mode or epoch has changed."""
        state = (self.mode, self._goals.epoch)
        if state == self._told:
            return []
        self._told = state
        self._heartbeats.hurry()
        return self._mode_to(None, now, self._reason())

    def _mode_to(self, via: Hashable | None, now: int, reason: Reason) -> list[Outgoing]:
        if via is None:
            self._mode_due = now + MODE_PERIOD
        message = Mode(now, self._goals.epoch, self._watchdog.patience, self.mode, reason)
        return [Outgoing(message, via, telemetry=via is None)]

    def _heartbeat(self) -> Heartbeat:
        flags = MavModeFlag.CUSTOM_MODE_ENABLED | (0 if self._stopped else MavModeFlag.SAFETY_ARMED)
        state = _STATES.get(self.mode, MavState.STANDBY)
        return Heartbeat(self._kind, MavAutopilot.GENERIC, int(flags), self.mode, state)

    def _say(self, severity: MavSeverity, text: str) -> list[Outgoing]:
        return [Outgoing(chunk) for chunk in self._speaker.say(severity, text)]

    def _addressed(self, system: int, component: int) -> bool:
        return system == self.system and component in _OURS


_OURS: Final[Collection[int]] = (MavComponent.ALL, COMPONENT)


def _instance(message: AnyMessage) -> Hashable:
    """What tells telemetry of one kind apart: the name of a named value."""
    return message.name if isinstance(message, NamedValueFloat) else None
