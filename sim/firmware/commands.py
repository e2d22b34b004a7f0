"""COMMAND_LONG and COMMAND_INT: the commands of MAVLink tools, and what each does here.

A command that moves is a goal without a key: it is checked, planned and carried out like one, replaces what
runs, and reports its progress. It ends when its link ends.

A release is carried out once: a repetition, sent because its answer was lost, must not undo a stop that came
in between. A stop is carried out at every repetition.

Pure. `now` is controller time in whole milliseconds.
"""

from collections.abc import Callable, Mapping
from math import nan
from typing import Final

import msgspec

from robotree.protocol.messages import (
    CommandAck,
    CommandCancel,
    CommandInt,
    CommandLong,
    GoalState,
    GripperActions,
    LegacySetMode,
    MavCmd,
    MavResult,
    MavSeverity,
    ModeKind,
    Reason,
    Verb,
)
from robotree.protocol.services.command import (
    Answer,
    CommandAbandoned,
    CommandServer,
    Handler,
    Request,
)
from robotree.protocol.services.peer import Peer
from robotree.sim.errors import GoalRefused
from robotree.sim.firmware.device import WIDEST, Device
from robotree.sim.firmware.movement import Job, Movement
from robotree.sim.firmware.outgoing import Announcer, Outgoing, sends
from robotree.sim.firmware.rights import Rights
from robotree.sim.firmware.stops import PX4_HOLD, modes_of, stop_commanded

_RESULTS: Final = {
    GoalState.SUCCEEDED: MavResult.ACCEPTED,
    GoalState.CANCELLED: MavResult.CANCELLED,
    GoalState.FAILED: MavResult.FAILED,
}

_WIDTHS: Final[Mapping[float, float]] = {
    GripperActions.RELEASE: WIDEST,
    GripperActions.GRAB: 0.0,
    GripperActions.HOLD: nan,
}
"""[m] between the fingers that DO_GRIPPER means; NaN: as they are."""

_LEGACY: Final = LegacySetMode.codec.definition.id
NO_TERMINATION: Final = "A termination is not taken back; arm to release the stop."
NO_REBOOT: Final = "It accepts no reboot over the wire; end its process and start it again."

Arguments = Callable[[Request], tuple[float, ...]]
"""The (7,) arguments of a verb from a command's parameters."""


def _or_default(value: float) -> float:
    """A speed: the field's tools send 0 where nothing was given, and 0 would be no speed."""
    return value or nan


MOVING: Final[Mapping[MavCmd, tuple[Verb, Arguments]]] = {
    MavCmd.ROBOTREE_GO_TO: (
        Verb.GO_TO,
        lambda request: (*request.params[:4], _or_default(request.params[6]), request.params[4], nan),
    ),
    MavCmd.ROBOTREE_GRIP: (Verb.GRIP, lambda request: (request.params[0], *(nan,) * 6)),
    MavCmd.ROBOTREE_MOVE: (
        Verb.MOVE,
        lambda request: (*request.params[:2], _or_default(request.params[6]), *(nan,) * 4),
    ),
    MavCmd.ROBOTREE_HOLD: (Verb.HOLD, lambda _: (nan,) * 7),
}
"""The commands that are a verb by another name."""


class Commands:
    """The commands of one controller.

    Args:
        device: moves.
        movement: carries out what moves.
        rights: who may.
        herald: explains refusals.
        stop: the protective stop, at a moment [ms].
        release: its end, at a moment [ms].
        questions: more that is answered to anyone, by command.
    """

    def __init__(
        self,
        device: Device,
        movement: Movement,
        rights: Rights,
        announcer: Announcer,
        *,
        stop: Callable[[int], list[Outgoing]],
        release: Callable[[], list[Outgoing]],
        questions: Mapping[int, Handler],
    ) -> None:
        self._device, self._movement, self._rights, self._announcer = device, movement, rights, announcer
        self._stop, self._release = stop, release
        self._news: list[Outgoing] = []
        moving: dict[int, Handler] = {
            command: self._mover(verb, arguments)
            for command, (verb, arguments) in MOVING.items()
            if verb in device.verbs
        }
        if Verb.GRIP in device.verbs:
            moving[MavCmd.DO_GRIPPER] = self._gripper
        always: dict[int, Handler] = {
            MavCmd.COMPONENT_ARM_DISARM: self._stop_or(self._arm),
            MavCmd.DO_FLIGHTTERMINATION: self._stop_or(self._never(NO_TERMINATION)),
            MavCmd.DO_SET_MODE: self._stop_or(self._set_mode),
            MavCmd.DO_PAUSE_CONTINUE: self._pause_or_continue,
            MavCmd.PREFLIGHT_REBOOT_SHUTDOWN: self._never(NO_REBOOT),
            MavCmd.REQUEST_OPERATOR_CONTROL: rights.control.handle,
        }
        self._server = CommandServer(moving, {**always, **questions}, turn=lambda: movement.turns)

    def receive(
        self, message: CommandLong | CommandInt | CommandCancel, peer: Peer, now: int
    ) -> list[Outgoing]:
        """Take a command, or the end of one."""
        effects = self._server.receive(message, peer, now / 1000)
        for effect in effects:
            if isinstance(effect, CommandAbandoned):
                self._movement.leave((effect.peer, effect.command))
        news, self._news = self._news, []
        return sends(effects) + news

    def set_mode(self, wish: LegacySetMode, peer: Peer, now: int) -> list[Outgoing]:
        """Take the old message SET_MODE: the same as the command, answered under the message's number.

        MAVLink defines no answer but the mode in HEARTBEAT; ArduPilot answers so, and clients wait for it.
        """
        main, sub = modes_of(wish)
        asked = (float(wish.base_mode), float(main), float(sub), 0.0, 0.0, 0.0, 0.0)
        out = self.receive(CommandLong(wish.target_system, 0, MavCmd.DO_SET_MODE, 0, *asked), peer, now)
        return [
            msgspec.structs.replace(each, message=msgspec.structs.replace(each.message, command=_LEGACY))
            if isinstance(each.message, CommandAck)
            else each
            for each in out
        ]

    def tick(self, now: int) -> list[Outgoing]:
        """Tell those who wait that their command still goes on."""
        return sends(self._server.tick(now / 1000))

    # -- what moves

    def _mover(self, verb: Verb, arguments: Arguments) -> Handler:
        return lambda request, now: self._move(request, verb, arguments(request), now)

    def _move(self, request: Request, verb: Verb, args: tuple[float, ...], now: float) -> Answer:
        if (why := self._rights.why_not(request.peer)) is not None:
            return self._refuse(MavResult.TEMPORARILY_REJECTED, why, Reason.NOT_IN_CONTROL)
        if bar := self._movement.bar:
            return self._refuse(MavResult.TEMPORARILY_REJECTED, bar, Reason.STOPPED)
        try:
            start = self._device.prepare(verb, args)
        except GoalRefused as refusal:
            return self._refuse(MavResult.DENIED, str(refusal), refusal.reason)
        peer, command = request.peer, request.command

        def progress(fraction: float, now: int) -> list[Outgoing]:
            return sends(self._server.progress(peer, command, fraction, now / 1000))

        def finish(state: GoalState, reason: Reason, text: str, now: int) -> list[Outgoing]:
            result = _RESULTS.get(state, MavResult.FAILED)
            out = sends(self._server.finish(peer, command, result, now / 1000, reason))
            return out + self._announcer.announce(MavSeverity.NOTICE, text, peer.via) if text else out

        job = Job((peer, command), peer, self._rights.voice(peer), progress, finish)
        self._news += self._movement.begin(job, start, round(1000 * now))
        return Answer(MavResult.IN_PROGRESS)

    def _gripper(self, request: Request, now: float) -> Answer:
        if request.param(1) not in {0.0, 1.0}:
            return self._refuse(MavResult.DENIED, "This robot has one gripper; name 0 or 1.")
        width = _WIDTHS.get(request.param(2, default=-1.0))
        if width is None:
            return self._refuse(MavResult.DENIED, "A gripper releases (0), grabs (1) or holds (2).")
        answer = self._move(request, Verb.GRIP, (width, *(nan,) * 6), now)
        # ACCEPTED as soon as it begins, as ArduPilot answers: the gripper plugin of MAVSDK 4.1 takes the
        # first IN_PROGRESS for the end and breaks at the second answer. ROBOTREE_GRIP reports its progress.
        return Answer(MavResult.ACCEPTED) if answer.result == MavResult.IN_PROGRESS else answer

    # -- stops and modes

    def _stop_or(self, otherwise: Handler) -> Handler:
        """The handler of a command that can ask for a stop."""

        def handle(request: Request, now: float) -> Answer:
            if not stop_commanded(request.command, request.params):
                return otherwise(request, now)
            self._news += self._stop(round(1000 * now))
            return Answer(MavResult.ACCEPTED)

        return handle

    def _arm(self, request: Request, _: float) -> Answer:
        """Arm: release the stop."""
        if request.param(1, default=-1.0) != 1.0:
            return self._refuse(MavResult.DENIED, "Arm with 1, disarm with 0.")
        return self._released(request)

    def _set_mode(self, request: Request, now: float) -> Answer:
        main, sub = request.param(2), request.param(3)
        if (main, sub) == PX4_HOLD or main == ModeKind.HOLD:
            return self._allowed(request, lambda: self._held(now))
        if main == ModeKind.READY:
            return self._released(request)
        if main == PX4_HOLD[0]:
            text = "This robot cannot take off, return or land: sub-mode 3 holds, 0 is the safe stop."
            return self._refuse(MavResult.DENIED, text)
        return self._refuse(MavResult.DENIED, "Modes that can be set: 1 ready, 3 hold, 4 safe stop.")

    def _pause_or_continue(self, request: Request, now: float) -> Answer:
        """Hold; or be ready again, though what was held does not go on by itself."""
        match request.param(1, default=-1.0):
            case 0.0:
                return self._allowed(request, lambda: self._held(now))
            case 1.0:
                return self._allowed(request, self._ready)
            case _:
                return self._refuse(MavResult.DENIED, "Pause with 0, continue with 1.")

    def _ready(self) -> Answer:
        if self._movement.bar:
            return self._refuse(MavResult.TEMPORARILY_REJECTED, self._movement.bar, Reason.STOPPED)
        if self._movement.job is None:
            self._movement.release()
            self._news += self._announcer.announce(
                MavSeverity.NOTICE, "Ready. What was held has ended; ask for it again."
            )
        return Answer(MavResult.ACCEPTED)

    def _released(self, request: Request) -> Answer:
        """Release the stop, or answer a release that was answered before without doing anything."""
        answer = self._allowed(request, lambda: self._release_once(repeated=request.repeated))
        return msgspec.structs.replace(answer, remembered=True)

    def _release_once(self, *, repeated: bool) -> Answer:
        if self._movement.overtaken or (repeated and self._movement.stopped):
            text = "A safe stop came after it; look at the robot, then arm again."
            return self._refuse(MavResult.TEMPORARILY_REJECTED, text, Reason.STOPPED)
        if not repeated:
            self._news += self._release()
        return Answer(MavResult.ACCEPTED)

    def _held(self, now: float) -> Answer:
        self._news += self._movement.interrupt(
            Reason.OPERATOR, "Somebody asked for a hold.", round(1000 * now)
        )
        return Answer(MavResult.ACCEPTED)

    def _allowed(self, request: Request, do: Callable[[], Answer]) -> Answer:
        """Do it, if the peer may."""
        if (why := self._rights.why_not(request.peer)) is not None:
            return self._refuse(MavResult.TEMPORARILY_REJECTED, why, Reason.NOT_IN_CONTROL)
        return do()

    def _never(self, text: str) -> Handler:
        return lambda _, __: self._refuse(MavResult.DENIED, text)

    def _refuse(self, result: MavResult, text: str, reason: Reason = Reason.NONE) -> Answer:
        chunks = tuple(self._announcer.chunks(MavSeverity.WARNING, text))
        return Answer(result, detail=reason, messages=chunks)
