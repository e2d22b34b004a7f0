"""The controller's program: messages in, set-points down, telemetry and answers out.

It combines the services. Each message that it understands has one line in its registry, and each service has
its own file; `modes` and `movement` decide when it stops, starts again and holds.

Pure: no socket, no thread, no clock. `now` is controller time in whole milliseconds, counted by the physics.
"""

from collections.abc import Callable, Hashable, Sequence
from math import inf
from typing import Final, TypeVar

from robotree.protocol.frame import Frame
from robotree.protocol.messages import (
    AnyMessage,
    AutopilotVersion,
    AvailableModes,
    Claim,
    ClaimStatus,
    CommandCancel,
    CommandInt,
    CommandLong,
    ComponentMetadata,
    ControlStatus,
    CurrentMode,
    Goal,
    GoalCancel,
    Heartbeat,
    LegacySetMode,
    MavCmd,
    MavResult,
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
    SetMode,
    Setpoint,
    Speech,
    SysStatus,
    SystemTime,
    Timesync,
    Untyped,
    WayRequest,
)
from robotree.protocol.services import (
    absent,
    claim_server,
    control,
    files,
    heartbeat,
    interval,
    ping,
    standard_modes,
    timesync,
    version,
)
from robotree.protocol.services.claim_server import ClaimServer
from robotree.protocol.services.command import Answer, Handler, Request
from robotree.protocol.services.fence import Fence
from robotree.protocol.services.peer import Peer
from robotree.sim.firmware.commands import Commands
from robotree.sim.firmware.device import Device
from robotree.sim.firmware.goals import Goals
from robotree.sim.firmware.modes import Modes
from robotree.sim.firmware.movement import Movement
from robotree.sim.firmware.outgoing import COMPONENT, Announcer, Outgoing
from robotree.sim.firmware.parameters import Metadata, Parameters
from robotree.sim.firmware.rights import Claims, Rights
from robotree.sim.firmware.setpoints import Setpoints
from robotree.sim.firmware.stops import stop_asked_by
from robotree.sim.firmware.telemetry import Gauges, Identity, Schedule, Stream, autopilot_version, sys_status

SILENCE: Final = 2.0
"""[s] of controller time after which a silent link makes the robot hold: two heartbeats of who beats once a
second. A proxy beats faster while its goal runs."""
MODE_PERIOD: Final = 500
"""[ms] between two messages MODE that tell nothing new."""
CURRENT_MODE_PERIOD: Final = 2000
"""[ms] between two CURRENT_MODE that tell nothing new, as MAVLink advises."""
STATUS_PERIOD: Final = 1000
"""[ms] between two SYS_STATUS."""
_HEARTBEAT: Final = Heartbeat.codec.definition.id
_AVAILABLE_MODES: Final = AvailableModes.codec.definition.id
_CONTROL_STATUS: Final = ControlStatus.codec.definition.id
_FIXED: Final = {_HEARTBEAT: heartbeat.PERIOD, _CONTROL_STATUS: control.PERIOD}
"""[s] between two messages whose rate nobody changes, by message id."""

M = TypeVar("M", bound=Message)
Aim = Callable[[Frame], bool]
"""Whether a message is meant for us."""
Hear = Callable[[Frame, Peer, int, int], list[Outgoing]]
"""Takes a frame from a peer at a moment, which arrived at another one [ms]."""


class Firmware:
    """The program of one controller.

    Args:
        device: the robot that it moves.
        streams: the telemetry of that robot.
        system: its MAVLink system id.
        component: its MAVLink component; a controller may have several, each with a program.
        mav_type: what its heartbeats say it is.
        silence: of the link that it bears [s of controller time].
        identity: what it says when asked which controller it is.
        fence: the epochs that it obeys; its owner keeps it over restarts.
        gauges: counted outside of the program; all components of one controller have the same ones.
        speech: takes a text that is to be spoken, of a robot that can speak.
    """

    def __init__(  # noqa: PLR0913  a controller is put together here
        self,
        device: Device,
        streams: Sequence[Stream],
        *,
        system: int,
        component: int = COMPONENT,
        mav_type: MavType,
        silence: float = SILENCE,
        identity: Identity | None = None,
        fence: Fence | None = None,
        gauges: Gauges | None = None,
        speech: Callable[[Speech], None] | None = None,
    ) -> None:
        self.system, self.component = system, component
        self.gauges = gauges or Gauges()
        self._speech = speech
        self._identity = identity or Identity()
        self._movement = Movement(device, round(1000 * silence))
        self._rights = Rights(ClaimServer(fence or Fence(), self._identity.life))
        self._goals = Goals(device, self._movement, self._rights)
        self._setpoints = Setpoints(device, self._movement, self._rights, self._goals.fence)
        self._parameters = Parameters(device, self._movement.watchdog, self._rights)
        self._metadata = Metadata(self._parameters.described)
        announcer = Announcer()
        self._claims = Claims(self._movement, self._rights, announcer)
        self._modes = Modes(self._movement, self._goals, self._rights, announcer, mav_type)
        self._schedule = Schedule((*streams, *self._own_streams()), _FIXED)
        self._commands = Commands(
            device,
            self._movement,
            self._rights,
            announcer,
            stop=self._modes.stop,
            release=self._modes.release,
            questions=self._questions(),
        )
        self._hears = self._registry()

    @property
    def mode(self) -> ModeKind:
        """The mode of the whole controller."""
        return self._movement.mode

    def receive(
        self, frame: Frame, via: Hashable, now: int, *, arrived: int | None = None, overtaken: bool = False
    ) -> list[Outgoing]:
        """Take one intact frame.

        Args:
            frame: from whichever link.
            via: names that link; answers go there.
            now: controller time [ms].
            arrived: when it arrived, if it waited since [ms]: it is no sign of life from later on.
            overtaken: whether it arrived before a stop that was heard already. Then it is answered, but moves
                nothing and releases nothing.

        Returns:
            What to say.
        """
        peer = Peer(via, frame.system, frame.component)
        arrived = now if arrived is None else arrived
        self._movement.watchdog.receive(peer, arrived)
        self._rights.heard(peer, now)
        self._schedule.open(via)
        if (receive := self._hears.get(type(frame.message))) is None:
            return []
        self._movement.overtaken = overtaken
        return receive(frame, peer, now, arrived) + self._modes.news(now)

    def greet(self, via: Hashable, now: int) -> list[Outgoing]:
        """Return the first messages over the link `via`: our presence and state."""
        self._schedule.open(via)
        return [
            Outgoing(self._modes.heartbeat(), via),
            Outgoing(self._modes.mode(now), via),
            Outgoing(self._rights.claims.status(), via),
        ]

    def leave(self, via: Hashable, now: int) -> list[Outgoing]:
        """The link `via` has ended: so has what is commanded over it; its rates, lists and control are free.

        A commander who has asked for its goal on another link meanwhile is heard there, and the goal goes on.

        Returns:
            What to say.
        """
        self._schedule.close(via)
        self._parameters.link_closed(via)
        self._rights.link_closed(via, now)
        self._claims.link_closed(via, now)
        return self._modes.lose_link(via, now) + self._modes.news(now)

    @property
    def due(self) -> float:
        """When to call `tick` next at the latest, in controller time [s]; -inf: at once, for something moves.

        A controller whose world moves by itself calls it after every batch of steps and need not ask.
        """
        if self._movement.job is not None:
            return -inf
        return min(
            self._parameters.due,
            self._rights.claims.due,
            self._rights.control.due,
            self._modes.beat_due,
            self._schedule.due,
        )

    def tick(self, now: int) -> list[Outgoing]:
        """Do what is due; call it after every batch of steps.

        Args:
            now: controller time [ms].

        Returns:
            What to say.
        """
        out: list[Outgoing] = []
        if self._movement.job is not None:  # else no goal, command or stream goes on
            self._setpoints.tick(now)
            out += self._movement.follow_up(now)
            out += self._goals.tick(now)
            out += self._commands.tick(now)
        seconds = now / 1000
        if seconds >= self._parameters.due:
            out += self._parameters.tick(now)
        if seconds >= self._rights.claims.due:
            out += self._claims.tick(now)
        out += self._modes.tick(now)
        if seconds >= self._schedule.due:
            out += self._schedule.tick(now, busy=self._movement.job is not None)
            self._modes.join(self._schedule.due)
        out += self._modes.beats(now)
        return out

    # -- who hears what

    def _registry(self) -> dict[type[AnyMessage], Hear]:
        """The messages that are understood, how they must be addressed, and their handlers."""
        us, all_or_us, any_ = self._is_for_us, self._is_for_all_or_us, self._is_for_anybody
        goals, commands, parameters = self._goals.receive, self._commands.receive, self._set_parameter
        return dict(
            (
                _route(Goal, us, goals),
                _route(GoalCancel, us, goals),
                _route(WayRequest, us, self._goals.preview),
                _dated_route(Setpoint, us, self._setpoints.receive),
                _dated_route(Claim, us, self._claims.receive),
                _route(SetMode, all_or_us, self._modes.receive),
                _route(CommandLong, all_or_us, commands),
                _route(CommandInt, all_or_us, commands),
                _route(CommandCancel, all_or_us, commands),
                _route(ParamRequestList, all_or_us, parameters),
                _route(ParamRequestRead, all_or_us, parameters),
                _route(ParamSet, all_or_us, parameters),
                _route(LegacySetMode, all_or_us, self._commands.set_mode),
                _route(MissionRequestList, all_or_us, _no_mission),
                (MissionCount, self._say_absent),
                (Untyped, self._say_absent),
                _route(Timesync, any_, _tell_time),
                _route(Ping, any_, _echo),
                _route(Speech, us, self._keep_speech),
            )
        )

    def _is_for_us(self, frame: Frame) -> bool:
        return frame.target[0] == self.system and self._is_for_all_or_us(frame)

    def _is_for_all_or_us(self, frame: Frame) -> bool:
        """Whether it is for this component; what is for all components, the first one answers alone.

        Two things are each component's own: a stop or its release, and the list of its parameters.
        """
        if frame.target[1] == 0 and self.component != COMPONENT:
            own = isinstance(frame.message, SetMode | ParamRequestList) or stop_asked_by(frame.message)
            if not own:
                return False
        return frame.is_for(self.system, self.component)

    def _is_for_anybody(self, frame: Frame) -> bool:
        return self.component in {COMPONENT, frame.target[1]}

    def _set_parameter(
        self, message: ParamRequestRead | ParamRequestList | ParamSet, peer: Peer, now: int
    ) -> list[Outgoing]:
        return self._parameters.receive(message, peer, now, self._schedule.links)

    def _keep_speech(self, message: Speech, _: Peer, __: int) -> list[Outgoing]:
        """Keep a text for the goal that speaks it; answered by nothing, the goal says whether it has come."""
        if self._speech is not None:
            self._speech(message)
        return []

    def _say_absent(self, frame: Frame, peer: Peer, _: int, __: int) -> list[Outgoing]:
        """Read from the files; say of everything else that is asked for that it is not here."""
        if not self._is_for_all_or_us(frame):
            return []
        if frame.name == files.MESSAGE:
            return [Outgoing(each, peer.via) for each in self._metadata.files.answer(frame.message, peer)]
        said = absent.answer(frame.message, peer)
        return [] if said is None else [Outgoing(said, peer.via)]

    # -- what is told without a device

    def _own_streams(self) -> tuple[Stream, ...]:
        def stream_of(kind: type[Message], period: int | None, read: Callable[[int], Message]) -> Stream:
            def one(now: int, _: bool) -> Sequence[Message]:  # noqa: FBT001  the shape of Stream.read
                return (read(now),)

            return Stream(kind, period, one)

        identity = self._identity
        return (
            stream_of(Mode, MODE_PERIOD, self._modes.mode),
            stream_of(ClaimStatus, round(1000 * claim_server.PERIOD), lambda _: self._rights.claims.status()),
            stream_of(CurrentMode, CURRENT_MODE_PERIOD, lambda _: standard_modes.current(self.mode)),
            stream_of(SysStatus, STATUS_PERIOD, self._sys_status),
            stream_of(ComponentMetadata, None, self._metadata.told),
            stream_of(SystemTime, None, lambda now: SystemTime(round(1e6 * identity.wall()), now)),
            stream_of(AutopilotVersion, None, lambda _: autopilot_version(identity)),
            stream_of(ProtocolVersion, None, lambda _: version.protocol_version()),
        )

    def _questions(self) -> dict[int, Handler]:
        """The commands that ask; anyone may."""

        def produce(msgid: int, now: float) -> Sequence[Message]:
            if msgid == _HEARTBEAT:
                return (self._modes.heartbeat(),)
            if msgid == _CONTROL_STATUS:
                return (self._rights.control.status,)
            return self._schedule.read(msgid, round(1000 * now), busy=self._movement.job is not None)

        def about(kind: type[Message]) -> Handler:
            return lambda _, now: Answer(
                MavResult.ACCEPTED, messages=tuple(produce(kind.codec.definition.id, now))
            )

        def request(request: Request, now: float) -> Answer:
            if request.param(1) != _AVAILABLE_MODES:
                return handlers[MavCmd.REQUEST_MESSAGE](request, now)
            modes = tuple(standard_modes.available(int(request.param(2))))
            return Answer(MavResult.ACCEPTED if modes else MavResult.DENIED, messages=modes)

        handlers = interval.handlers(self._schedule.open, produce)
        return {
            **handlers,
            MavCmd.REQUEST_MESSAGE: request,
            MavCmd.REQUEST_AUTOPILOT_CAPABILITIES: about(AutopilotVersion),
            MavCmd.REQUEST_PROTOCOL_VERSION: about(ProtocolVersion),
        }

    def _sys_status(self, _: int) -> Message:
        return sys_status(self.gauges, self._setpoints.statistics)


def _route(
    kind: type[M], aim: Aim, take: Callable[[M, Peer, int], list[Outgoing]]
) -> tuple[type[AnyMessage], Hear]:
    """One line of the registry: messages of a kind that are meant for us are taken."""
    return _dated_route(kind, aim, lambda message, peer, now, _: take(message, peer, now))


def _dated_route(
    kind: type[M], aim: Aim, take: Callable[[M, Peer, int, int], list[Outgoing]]
) -> tuple[type[AnyMessage], Hear]:
    """As `_route`; who takes it is told when it arrived, too [ms]."""

    def receive(frame: Frame, peer: Peer, now: int, arrived: int) -> list[Outgoing]:
        message = frame.message
        return take(message, peer, now, arrived) if isinstance(message, kind) and aim(frame) else []

    return kind, receive


def _no_mission(question: MissionRequestList, peer: Peer, _: int) -> list[Outgoing]:
    return [Outgoing(MissionCount(peer.system, peer.component, 0, question.mission_type), peer.via)]


def _tell_time(question: Timesync, peer: Peer, now: int) -> list[Outgoing]:
    return [Outgoing(answer, peer.via) for answer in timesync.answer(question, now / 1000)]


def _echo(question: Ping, peer: Peer, _: int) -> list[Outgoing]:
    return [Outgoing(answer, peer.via) for answer in ping.answer(question, peer)]
