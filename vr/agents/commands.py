"""A robot's commands, its own and its children's that it lets through: from request to answer."""

from __future__ import annotations

import asyncio
import inspect
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import msgspec

from robotree.vr.agents.bonds import BondKeeper
from robotree.vr.agents.callers import Callers
from robotree.vr.agents.lease import LeaseKeeper
from robotree.vr.arguments import check_arguments
from robotree.vr.child import Exposed
from robotree.vr.command import Command, commands_of
from robotree.vr.context import CommandContext
from robotree.vr.description import Arguments, CommandSpec
from robotree.vr.errors import CommandCancelled, CommandFailed, DeadlineExceeded, NoSuchCommand, Stopped
from robotree.vr.exchange.answering import Say
from robotree.vr.requests import Accepted, Call
from robotree.vr.robot import Robot
from robotree.vr.running.execution import CommandThread, Forward, Run
from robotree.vr.running.jobs import Job, Jobs
from robotree.vr.running.outcome import check_result
from robotree.vr.transport import Transport
from robotree.vr.virtual_robot import VirtualRobot, exposures_of

LONGEST_DEADLINE = 7 * 24 * 3600.0
"""[s]"""


class CommandDesk:
    """Takes calls in, or refuses them; carries out what it has taken in."""

    def __init__(
        self,
        robot: Robot,
        lease: LeaseKeeper,
        transport: Transport,
        *,
        on_change: Callable[[], None],
        on_call: Callable[[str], None],
        home: str,
    ) -> None:
        """Read the commands of the robot's class.

        Args:
            robot: the robot.
            lease: knows who may call.
            transport: where callers are seen.
            on_change: told when something else runs or waits.
            on_call: told the name of each command taken in.
            home: what must be restarted to end a command that cannot be ended.

        Raises:
            TypeError: its author declared a command in a way that cannot be called from afar.
        """
        self._robot, self._lease, self._on_call = robot, lease, on_call
        self._own = commands_of(type(robot))
        self._exposed = exposures_of(type(robot))
        self.bonds: BondKeeper | None = None
        """The way to its children, if it is a virtual robot."""
        self.ordered = ""
        """Reason of the protective stop that was ordered here, or empty."""
        self._stops = 0
        self._halted = ""
        self._latest = ""
        self.jobs = Jobs(robot.name, self._launch, on_change, home=home)
        self.callers = Callers(robot.name, transport, self.jobs.cancel)
        """Whose presence its commands need."""

    @property
    def stopped(self) -> str:
        """Why nothing may begin: a stop ordered here, or one that the robot tells of itself; or empty."""
        return self.ordered or self._robot.halted

    @property
    def stops(self) -> int:
        """How many stops have begun: those ordered here, and each that the robot tells of itself."""
        self._count(self._robot.halted)  # whoever has set it may not have notified yet
        return self._stops

    def stop(self, reason: str) -> None:
        """Begin a protective stop: all commands end, and none begins until `ordered` is empty."""
        self._stops += 1
        self.ordered = self._latest = reason
        self.jobs.cancel_all(reason)

    def take_halt(self, reason: str) -> None:
        """Take note of what the robot tells of itself: while it is stopped, nothing moves.

        Args:
            reason: why it is in a stop that nobody ordered here; empty: it is in none.
        """
        self._count(reason)
        if reason:
            self.jobs.cancel_all(reason, but_readers=True)

    def specs(self) -> tuple[CommandSpec, ...]:
        """Describe all commands as they are now."""
        own = tuple(command.spec for command in self._own.values())
        return own + tuple(self._exposed_spec(name, exposed) for name, exposed in self._exposed.items())

    async def answer(self, call: Call, say: Say) -> None:
        """Take a call in and answer it to its end.

        Raises:
            VrError: it was refused.
        """
        job = await self._admit(call)
        if call.presence:
            self.callers.attend(call.presence, job)
        say(Accepted(key=call.key))
        if not call.oneway:
            job.listeners.append(say)
            say(await asyncio.shield(job.outcome))

    # -- inside -----------------------------------------------------------------------------------

    def _count(self, halted: str) -> None:
        if halted and not self._halted:
            self._stops += 1
            self._latest = halted
        self._halted = halted

    async def _admit(self, call: Call) -> Job:
        self._lease.check(call.epoch)
        stops = self.stops
        spec, source = await self._find(call.command)
        arguments = await _read(spec, call.arguments, self._robot.name)
        self._lease.check(call.epoch)  # once more: what was awaited may have taken time
        if job := self.jobs.seen(call.key, call.command, call.arguments):
            return job
        if spec.effect != "read":
            self._refuse_while_stopped()
            if self.stops != stops:  # the stop has ended meanwhile; what came before it has ended with it
                raise CommandCancelled(robot=self._robot.name, command=call.command, reason=self._latest)
            self._refuse_beside_another_proxy(call.command)
            self.jobs.refuse_beside_abandoned()
        if not 0 < call.deadline < math.inf:
            raise DeadlineExceeded(robot=self._robot.name, command=call.command)
        context = CommandContext(
            key=call.key,
            command=call.command,
            caller=call.caller,
            epoch=self._lease.lessor.epoch,
            deadline_at=asyncio.get_running_loop().time() + min(call.deadline, LONGEST_DEADLINE),
        )
        job = Job(context, spec, arguments, source=source)
        self.jobs.submit(job, call.arguments)
        self._on_call(call.command)
        return job

    def _refuse_while_stopped(self) -> None:
        if self.stopped:
            tenure = self._lease.tenure
            commander = self._robot.name if tenure is None else tenure.parent.name
            raise Stopped(robot=self._robot.name, reason=self.stopped, commander=commander)

    def _refuse_beside_another_proxy(self, command: str) -> None:
        if self._lease.outranked:
            raise CommandFailed(
                robot=self._robot.name,
                command=command,
                detail="another proxy commands its controller, under a later lease; enslave "
                f"{self._robot.name} to take it over, or end that proxy and start this one again",
            )

    async def _find(self, name: str) -> tuple[CommandSpec, str]:
        """Return the spec of a command and the file of its author."""
        if command := self._own.get(name):
            return command.spec, inspect.unwrap(command.function).__code__.co_filename
        exposed = self._exposed.get(name)
        if exposed is None or self.bonds is None:
            known = ", ".join([*self._own, *self._exposed]) or "none"
            raise NoSuchCommand(robot=self._robot.name, command=name, known=known)
        child = await self.bonds.describe(exposed.child.name, having=exposed.command)
        spec = child.command(exposed.command)
        if spec is None:
            known = ", ".join(spec.name for spec in child.commands) or "none"
            raise NoSuchCommand(robot=child.name, command=exposed.command, known=known)
        return msgspec.structs.replace(spec, name=name), ""

    def _exposed_spec(self, name: str, exposed: Exposed) -> CommandSpec:
        through = f"{exposed.child.name}.{exposed.command}"
        if isinstance(self._robot, VirtualRobot):
            bond = self._robot.child_slots[exposed.child.name].bond
            spec = None if bond is None else bond.description.command(exposed.command)
            if spec is not None:
                return msgspec.structs.replace(spec, name=name, through=through)
        return CommandSpec(name=name, through=through, available=False)

    def _launch(self, job: Job) -> Run:
        name, context = job.context.command, job.context
        command: Command | None = self._own.get(name)
        if command is not None:
            work = partial(self._carry_out, command, job.arguments)
            return CommandThread(self._robot.name, context, work, self.bonds, job.note)
        exposed = self._exposed[name]
        assert self.bonds is not None  # noqa: S101 # else it would not have been taken in
        return Forward(
            self.bonds.call(
                exposed.child.name,
                exposed.command,
                job.arguments,
                key=f"{context.key}/1",
                context=context,
                on_progress=job.note,
            )
        )

    def _carry_out(self, command: Command, arguments: dict[str, Any]) -> Any:
        """Run an author's code, in its thread."""
        result = command.function(self._robot, **arguments)
        return check_result(result, command.returns, robot=self._robot.name, command=command.spec.name)


async def _read(spec: CommandSpec, arguments: Arguments, robot: str) -> dict[str, Any]:
    """Check the arguments, in a thread if text must be converted: the first conversion loads all units."""
    numbers = {field.name for field in spec.parameters if field.type in {"float", "int"}}
    if any(isinstance(arguments.get(name), str) for name in numbers):
        return await asyncio.to_thread(check_arguments, spec, arguments, robot=robot)
    return check_arguments(spec, arguments, robot=robot)
