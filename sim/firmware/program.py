"""The controller's program: messages in, set-points down, telemetry and answers out.

It puts the services together. Each message that it understands has one line in its registry; each service has
a file of its own. It stops for anyone and starts again only for a lease that is not stale or for who is in
control; and it holds by itself when nobody is heard (`movement`).

Pure: no socket, no thread, no clock. `now` is controller time in whole milliseconds, counted by the physics.
"""

from collections.abc import Callable, Hashable, Sequence
from functools import partial
from typing import Any, Final

from robotree.protocol.frame import Frame
from robotree.protocol.messages import (
    AnyMessage,
    AutopilotVersion,
    CommandCancel,
    CommandInt,
    CommandLong,
    ControlStatus,
    Goal,
    GoalCancel,
    Heartbeat,
    MavAutopilot,
    MavCmd,
    MavComponent,
    MavModeFlag,
    MavResult,
    MavSeverity,
    MavState,
    MavType,
    Message,
    MissionCount,
    MissionRequestList,
    Mode,
    ModeKind,
    ParamRequestList,
    ParamRequestRead,
    ParamSet,
    Ping,
    ProtocolVersion,
    Reason,
    SetMode,
    Setpoint,
    SysStatus,
    SystemTime,
    Timesync,
)
from robotree.protocol.services import control, heartbeat, interval, ping, timesync
from robotree.protocol.services.command import Answer, Handler
from robotree.protocol.services.peer import Peer
from robotree.sim.device import Device
from robotree.sim.firmware import description
from robotree.sim.firmware.commands import Commands
from robotree.sim.firmware.description import Gauges, Identity
from robotree.sim.firmware.goals import Goals
from robotree.sim.firmware.movement import Movement
from robotree.sim.firmware.outgoing import COMPONENT, Herald, Outgoing
from robotree.sim.firmware.parameters import Parameters
from robotree.sim.firmware.schedule import Schedule
from robotree.sim.firmware.streaming import Streaming
from robotree.sim.telemetry import Stream

SILENCE: Final = 2.0
"""[s] of controller time after which a silent link makes the robot hold: two heartbeats missed."""
MODE_PERIOD: Final = 500
"""[ms] between two messages MODE that tell nothing new."""
STATUS_PERIOD: Final = 1000
"""[ms] between two SYS_STATUS."""
_STATES: Final = {ModeKind.ACTIVE: MavState.ACTIVE, ModeKind.SAFE_STOP: MavState.CRITICAL}
_OURS: Final = frozenset({MavComponent.ALL, COMPONENT})
_HEARTBEAT: Final = Heartbeat.codec.definition.id
_CONTROL_STATUS: Final = ControlStatus.codec.definition.id
_FIXED: Final = {_HEARTBEAT: heartbeat.PERIOD, _CONTROL_STATUS: control.PERIOD}
"""[s] between two messages whose rate nobody changes, by message id."""

Hear = Callable[[Any, Peer, int], list[Outgoing]]
"""Takes a message from a peer at a moment [ms]."""
Aim = Callable[[Any], bool]
"""Whether a message is meant for us."""


class Firmware:
    """The program of one controller.

    Args:
        device: the robot that it moves.
        streams: what it tells by itself about that robot.
        system: its MAVLink system id.
        kind: what its heartbeats say it is.
        silence: of the link that it bears [s of controller time].
        identity: what it says when asked which controller it is.
    """

    def __init__(
        self,
        device: Device,
        streams: Sequence[Stream],
        *,
        system: int,
        kind: MavType,
        silence: float = SILENCE,
        identity: Identity | None = None,
    ) -> None:
        self.system = system
        self.gauges = Gauges()
        self._kind, self._identity = kind, identity or Identity()
        self._movement = Movement(device, round(1000 * silence))
        self._goals = Goals(device, self._movement, system)
        self._rights = self._goals.rights
        self._streaming = Streaming(device, self._movement, self._rights, self._goals.fence)
        self._parameters = Parameters(device, self._movement.watchdog, self._rights)
        self._schedule = Schedule(
            (*streams, *self._own_streams()),
            _FIXED,
        )
        self._herald = Herald()
        self._commands = Commands(
            device,
            self._movement,
            self._rights,
            self._herald,
            stop=self._stop,
            release=self._release,
            questions=self._questions(),
        )
        self._heartbeats = heartbeat.HeartbeatSender()
        self._told: tuple[ModeKind, int, int] | None = None
        self._hears = self._registry()

    @property
    def mode(self) -> ModeKind:
        """What the controller is doing as a whole."""
        return self._movement.mode

    def hear(self, frame: Frame, via: Hashable, now: int) -> list[Outgoing]:
        """Take one intact frame.

        Args:
            frame: from whichever link.
            via: names that link; answers go there.
            now: controller time [ms].

        Returns:
            What to say.
        """
        peer = Peer(via, frame.system, frame.component)
        self._movement.watchdog.hear((frame.system, frame.component), now)
        self._rights.heard(peer, now)
        self._schedule.open(via)
        message = frame.message
        known = self._hears.get(type(message))
        if known is None or not known[0](message):
            return []
        return known[1](message, peer, now) + self._news(now)

    def greet(self, via: Hashable, now: int) -> list[Outgoing]:
        """What to say first over the link `via`: that we are there, and how."""
        self._schedule.open(via)
        return [Outgoing(self._heartbeat(), via), Outgoing(self._mode(now), via)]

    def leave(self, via: Hashable, now: int) -> None:
        """The link `via` has ended: its rates, lists and control are free.

        What it moves goes on until the watchdog misses the one who asked, who may come back on another link.
        """
        self._schedule.close(via)
        self._parameters.link_closed(via)
        self._rights.link_closed(via, now)

    def tick(self, now: int) -> list[Outgoing]:
        """Do what is due; call it after every batch of steps.

        Args:
            now: controller time [ms].

        Returns:
            What to say.
        """
        self._streaming.tick(now)
        out = self._movement.follow_up(now)
        out += self._goals.tick(now)
        out += self._commands.tick(now)
        out += self._parameters.tick(now)
        out += self._watch(now)
        out += self._control(now)
        out += self._news(now)
        out += [
            Outgoing(beat, telemetry=True) for beat in self._heartbeats.tick(self._heartbeat(), now / 1000)
        ]
        return out + self._schedule.tick(now, busy=self._movement.job is not None)

    # -- who hears what

    def _registry(self) -> dict[type[AnyMessage], tuple[Aim, Hear]]:
        """What is understood, to whom it must be addressed, and who takes it."""
        us, all_or_us, any_ = self._is_us, self._is_all_or_us, _is_anybody
        goals, commands, parameters = self._goals.hear, self._commands.hear, self._set_parameter
        return {
            Goal: (us, goals),
            GoalCancel: (us, goals),
            Setpoint: (us, self._streaming.hear),
            SetMode: (all_or_us, self._set_mode),
            CommandLong: (all_or_us, commands),
            CommandInt: (all_or_us, commands),
            CommandCancel: (all_or_us, commands),
            ParamRequestList: (all_or_us, parameters),
            ParamRequestRead: (all_or_us, parameters),
            ParamSet: (all_or_us, parameters),
            MissionRequestList: (all_or_us, _no_mission),
            Timesync: (any_, _tell_time),
            Ping: (any_, _echo),
        }

    def _is_us(self, message: Goal) -> bool:
        return message.target_system == self.system and message.target_component in _OURS

    def _is_all_or_us(self, message: CommandLong) -> bool:
        return message.target_system in {0, self.system} and message.target_component in _OURS

    def _set_parameter(self, message: ParamSet, peer: Peer, now: int) -> list[Outgoing]:
        return self._parameters.hear(message, peer, now, self._schedule.links)

    # -- what is told without a device

    def _own_streams(self) -> tuple[Stream, ...]:
        def told(kind: type[Message], period: int | None, read: Callable[[int], Message]) -> Stream:
            def one(now: int, _: bool) -> Sequence[Message]:  # noqa: FBT001  the shape of Stream.read
                return (read(now),)

            return Stream(kind, period, one)

        identity = self._identity
        return (
            told(Mode, MODE_PERIOD, self._mode),
            told(SysStatus, STATUS_PERIOD, self._sys_status),
            told(SystemTime, None, partial(description.system_time, identity)),
            told(AutopilotVersion, None, lambda _: description.autopilot_version(identity)),
            told(ProtocolVersion, None, lambda _: description.protocol_version()),
        )

    def _questions(self) -> dict[int, Handler]:
        """The commands that ask; anyone may."""

        def produce(msgid: int, now: float) -> Sequence[Message]:
            if msgid == _HEARTBEAT:
                return (self._heartbeat(),)
            if msgid == _CONTROL_STATUS:
                return (self._rights.control.status,)
            return self._schedule.read(msgid, round(1000 * now), busy=self._movement.job is not None)

        def about(kind: type[Message]) -> Handler:
            return lambda _, now: Answer(
                MavResult.ACCEPTED, messages=tuple(produce(kind.codec.definition.id, now))
            )

        return {
            **interval.handlers(self._schedule.open, produce),
            MavCmd.REQUEST_AUTOPILOT_CAPABILITIES: about(AutopilotVersion),
            MavCmd.REQUEST_PROTOCOL_VERSION: about(ProtocolVersion),
        }

    def _sys_status(self, _: int) -> Message:
        return description.sys_status(self.gauges, self._streaming.statistics)

    def _heartbeat(self) -> Heartbeat:
        stopped = self._movement.stopped
        flags = MavModeFlag.CUSTOM_MODE_ENABLED | (0 if stopped else MavModeFlag.SAFETY_ARMED)
        state = _STATES.get(self.mode, MavState.STANDBY)
        return Heartbeat(self._kind, MavAutopilot.GENERIC, int(flags), self.mode, state)

    def _mode(self, now: int, reason: Reason | None = None) -> Mode:
        why = self._movement.reason if reason is None else reason
        return Mode(now, self._goals.epoch, self._movement.watchdog.patience, self.mode, why)

    # -- modes

    def _set_mode(self, wish: SetMode, peer: Peer, now: int) -> list[Outgoing]:
        out: list[Outgoing] = []
        answer: Reason | None = None
        match wish.mode:
            case ModeKind.SAFE_STOP:
                out = self._stop(now)
            case ModeKind.READY if self._rights.guard(peer) is not None:
                answer = Reason.NOT_IN_CONTROL
            case ModeKind.READY if not self._goals.fence(wish.epoch):
                answer = Reason.STALE_EPOCH
            case ModeKind.READY:
                out = self._release()
            case _:
                answer = Reason.BAD_ARGUMENT
        return [*out, *self._news(now), Outgoing(self._mode(now, answer), peer.via)]

    def _stop(self, now: int) -> list[Outgoing]:
        if self._movement.stopped:
            return []
        text = "Safe stop: holding, compliant; goals are refused until release."
        return self._movement.stop(now) + self._herald.tell(MavSeverity.WARNING, text)

    def _release(self) -> list[Outgoing]:
        was_stopped = self._movement.stopped
        self._movement.release()
        return self._herald.tell(MavSeverity.NOTICE, "Safe stop released.") if was_stopped else []

    def _watch(self, now: int) -> list[Outgoing]:
        if not (text := self._movement.fall_silent(now)):
            return []
        out = self._movement.interrupt(Reason.LINK_SILENT, text, now)
        return out + self._herald.tell(MavSeverity.WARNING, f"{text} Holding, compliant.")

    def _control(self, now: int) -> list[Outgoing]:
        """Tell who is in control; what others move ends when somebody takes it."""
        out, owner = self._rights.tick(now)
        job = self._movement.job
        if owner is None or job is None or job.speaker == (owner.system, owner.component):
            return out
        text = f"System {owner.system} took operator control."
        return out + self._movement.interrupt(Reason.NOT_IN_CONTROL, text, now)

    def _news(self, now: int) -> list[Outgoing]:
        """Tell all when mode, epoch or patience has changed."""
        state = (self.mode, self._goals.epoch, self._movement.watchdog.patience)
        if state == self._told:
            return []
        self._told = state
        self._heartbeats.hurry()
        return [Outgoing(self._mode(now), telemetry=True)]


def _is_anybody(_: AnyMessage) -> bool:
    return True


def _no_mission(question: MissionRequestList, peer: Peer, _: int) -> list[Outgoing]:
    return [Outgoing(MissionCount(peer.system, peer.component, 0, question.mission_type), peer.via)]


def _tell_time(question: Timesync, peer: Peer, now: int) -> list[Outgoing]:
    return [Outgoing(answer, peer.via) for answer in timesync.answer(question, now / 1000)]


def _echo(question: Ping, peer: Peer, _: int) -> list[Outgoing]:
    return [Outgoing(answer, peer.via) for answer in ping.answer(question, peer)]
