"""An operator that commands a simulated controller in virtual time, for tests and benches.

    bench = ArmBench(delay=1.0)                 # every frame takes a second each way
    bench.operator.succeed(Verb.GRIP, 0.07)     # returns when the controller says so; no second passes
    bench.world.lever_angle

Real frames cross protocol's loopback; nothing is mocked, and nothing sleeps.
"""

import itertools
from collections.abc import Callable
from typing import Final, Generic, TypeVar

from robotree.protocol.endpoint import Endpoint
from robotree.protocol.frame import Frame
from robotree.protocol.links.link import Link
from robotree.protocol.links.loopback import Faults, Loopback
from robotree.protocol.messages import (
    AnyMessage,
    CommandAck,
    CommandLong,
    Goal,
    GoalCancel,
    GoalState,
    GoalStatus,
    Heartbeat,
    MavAutopilot,
    MavResult,
    MavState,
    MavType,
    Message,
    Mode,
    ModeKind,
    Reason,
    SetMode,
    Verb,
)
from robotree.protocol.services.goal_client import padded
from robotree.sim.arm.world import ArmWorld
from robotree.sim.companion.world import CompanionWorld
from robotree.sim.companion.world import build as build_flat
from robotree.sim.controller.controller import Controller
from robotree.sim.firmware import COMPONENT, SILENCE
from robotree.sim.kinds import ARM, COMPANION, HEAD, LEFT_ARM, RIGHT_ARM, ROVER, Kind, W
from robotree.sim.rover.world import RoverWorld

NAN: Final = float("nan")
M = TypeVar("M", bound=Message)


class Operator:
    """Commands a controller as a proxy would: over real frames, with a heartbeat every second of its time.

    Args:
        controller: the one that it commands; its world advances when the operator waits.
        delay: that every frame takes, each way [s of the world's time].
        component: under which it speaks.
        system: whose component that is.
        crowd: everybody who is connected to that controller, itself included.
        target: the component of the controller that it commands.
    """

    def __init__(
        self,
        controller: Controller,
        delay: float = 0.0,
        component: int = 190,
        system: int = 255,
        crowd: "list[Operator] | None" = None,
        target: int = COMPONENT,
    ) -> None:
        self.controller, self.system, self.component = controller, system, component
        self.target = target
        self._crowd = [] if crowd is None else crowd
        self._crowd.append(self)
        self.heard: list[tuple[float, AnyMessage]] = []
        """Everything that was heard, each with the world's time [s]."""
        self.silent = False
        """Whether it has ceased to send heartbeats."""
        self._keys = itertools.count(1)
        self._statuses: dict[int, GoalStatus] = {}
        self._beat_at = 0.0
        self._acks: list[CommandAck] = []
        self._wire = Loopback(self._near, self._far, Faults(delay=delay), now=self.now)
        controller.greet(self.far)

    @property
    def now(self) -> float:
        """The world's time [s]."""
        return self.controller.cell.time_ms / 1000

    def another(self, component: int = 190, system: int = 254, target: int = COMPONENT) -> "Operator":
        """Somebody else, connected to the same controller by a wire of their own."""
        return Operator(self.controller, component=component, system=system, crowd=self._crowd, target=target)

    def leave(self) -> None:
        """Close the wire."""
        self._crowd.remove(self)
        self.controller.leave(self.far)

    def step(self) -> None:
        """One batch of the world, and what the wires carry meanwhile."""
        for each in self._crowd:
            each.speak()
        for outgoing in self.controller.advance():
            for each in self._crowd:
                if outgoing.via in {None, each.far}:
                    each.far.send(outgoing.message, component=outgoing.component)
        for each in self._crowd:
            each.carry()

    def speak(self) -> None:
        """Say what is due, and let the wire carry it."""
        if not self.silent and self.now >= self._beat_at:
            self._beat_at = self.now + 1.0
            self.say(Heartbeat(MavType.GCS, MavAutopilot.INVALID, 0, 0, MavState.ACTIVE))
        self.carry()

    def carry(self) -> None:
        """Let the wire carry what is on it."""
        self._wire.advance(self.now)

    def wait(self, seconds: float) -> None:
        """Let the world go on for `seconds` of its time."""
        end = self.controller.cell.time_ms + round(1000 * seconds)
        while self.controller.cell.time_ms < end:
            self.step()

    def until(self, happened: Callable[[], bool], within: float) -> None:
        """Let the world go on until something has happened.

        Args:
            happened: looked at after every batch.
            within: [s] of the world's time.

        Raises:
            TimeoutError: it did not happen.
        """
        end = self.now + within
        while not happened():
            if self.now >= end:
                raise TimeoutError(f"it did not happen within {within} s of the world's time")
            self.step()

    def say(self, message: AnyMessage) -> None:
        """Send anything."""
        self._near_end.send(message)

    def ask(self, verb: int, *args: float, key: int | None = None, epoch: int = 1, ttl: float = 0.0) -> int:
        """Send a goal and do not wait for it; returns its key."""
        key = next(self._keys) if key is None else key
        self.say(Goal(key, epoch, round(1000 * ttl), padded(args), verb, 1, self.target))
        return key

    def knows(self, key: int) -> bool:
        """Whether anything was heard of a goal."""
        return key in self._statuses

    def status_of(self, key: int) -> GoalStatus:
        """The latest that was heard of a goal."""
        return self._statuses[key]

    def end_of(self, key: int, within: float = 60.0) -> GoalStatus:
        """Wait for the end of a goal.

        Raises:
            TimeoutError: it did not end.
        """
        self.until(lambda: key in self._statuses and GoalState(self._statuses[key].state).final, within)
        return self._statuses[key]

    def do(self, verb: int, *args: float, within: float = 60.0, epoch: int = 1) -> GoalStatus:
        """Send a goal and wait for its end."""
        return self.end_of(self.ask(verb, *args, epoch=epoch), within)

    def succeed(self, verb: Verb, *args: float) -> GoalStatus:
        """Send a goal that must be reached.

        Raises:
            RuntimeError: it ended otherwise.
        """
        status = self.do(verb, *args)
        if status.state != GoalState.SUCCEEDED:
            raise RuntimeError(f"{verb.name} {args} ended {GoalState(status.state).name}: {status.text}")
        return status

    def cancel(self, key: int, epoch: int = 1) -> None:
        """Ask for the end of a goal; key 0: of whichever runs."""
        self.say(GoalCancel(key, epoch, 1, self.target))

    def set_mode(self, mode: ModeKind, epoch: int = 1) -> None:
        """Ask for a mode."""
        self.say(SetMode(epoch, 0, 0, mode))

    def command(self, command: int, *params: float, within: float = 30.0) -> CommandAck:
        """Send a command and wait for its last answer; what is left out of the parameters is NaN.

        Raises:
            TimeoutError: there was none.
        """
        self.order(command, *params)

        def answers() -> list[CommandAck]:
            ours = (ack for ack in self._acks if ack.command == command)
            return [ack for ack in ours if ack.result != MavResult.IN_PROGRESS]

        self.until(lambda: bool(answers()), within)
        return answers()[-1]

    def order(self, command: int, *params: float) -> None:
        """Send a command and do not wait for its answer."""
        self._acks.clear()
        self.say(CommandLong(1, 1, command, 0, *padded(params)))

    def all(self, kind: type[M]) -> list[M]:
        """All messages of a kind that were heard."""
        return [message for _, message in self.heard if isinstance(message, kind)]

    def latest(self, kind: type[M]) -> M:
        """The message of a kind that was heard last."""
        return next(message for _, message in reversed(self.heard) if isinstance(message, kind))

    def mode(self) -> tuple[ModeKind, Reason]:
        """The mode that was heard last, and why."""
        mode = self.latest(Mode)
        return ModeKind(mode.mode), Reason(mode.reason)

    def _near(self, link: Link) -> Endpoint:
        self._near_end = Endpoint(link, system=self.system, component=self.component, on_frame=self._hear)
        return self._near_end

    def _far(self, link: Link) -> Endpoint:
        self.far = Endpoint(link, system=1, component=1, on_frame=self._arrive)
        return self.far

    def _arrive(self, frame: Frame) -> None:
        self.controller.post(frame, self.far)

    def _hear(self, frame: Frame) -> None:
        if frame.component != self.target and frame.component in self.controller.components:
            return  # another component of the same controller
        message = frame.message
        self.heard.append((self._wire.now, message))
        if isinstance(message, GoalStatus) and message.target_component == self.component:
            self._statuses[message.key] = message
        if isinstance(message, CommandAck) and message.target_system == self.system:
            self._acks.append(message)


class Bench(Generic[W]):
    """The world of a kind of robot, its controller and its operator.

    Args:
        kind: of robot.
        delay: of every frame, each way [s].
        silence: of the link that the controller bears [s].
    """

    def __init__(self, kind: Kind[W], delay: float = 0.0, silence: float = SILENCE) -> None:
        self.world = kind.world()
        self.controller = kind.controller(self.world, 1, silence)
        self.operator = Operator(self.controller, delay)


class ArmBench(Bench[ArmWorld]):
    """The arm's; see `Bench`."""

    def __init__(self, delay: float = 0.0, silence: float = SILENCE) -> None:
        super().__init__(ARM, delay, silence)


class RoverBench(Bench[RoverWorld]):
    """The rover's; see `Bench`."""

    def __init__(self, delay: float = 0.0, silence: float = SILENCE) -> None:
        super().__init__(ROVER, delay, silence)


class CompanionBench:
    """The companion's controller with an operator for each of its components; see `Bench`.

    Args:
        world: of the companion; None: one with visitors who stay outside.
        start: x, y [m] and heading [rad] of the companion in that one.
    """

    def __init__(
        self,
        world: CompanionWorld | None = None,
        start: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        self.world = world or build_flat(plays=(), start=start)
        self.controller = COMPANION.controller(self.world, 1, SILENCE)
        self.base = Operator(self.controller)
        self.left = self.base.another(component=191, target=LEFT_ARM)
        self.right = self.base.another(component=192, target=RIGHT_ARM)
        self.head = self.base.another(component=193, target=HEAD)
