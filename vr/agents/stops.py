"""Stops and pauses as one robot carries them out; what is stopped and paused, the core knows.

What stands behind the robot is asked for a stop beside its children, as one more of those that must
confirm. Of a pause the renewals tell those below; where a command waits, its frame knows (`Frame.hold`). A
robot without a page has no steps: its present command ends by itself, and its parent does not begin the
next one.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable, Sequence
from typing import TypeVar

import msgspec

from robotree.vr.agents.children import ChildKeeper
from robotree.vr.agents.hooks import STILL_STOPPING, Confirming, Hooks
from robotree.vr.agents.shared import loop_now
from robotree.vr.base.envelope import same_clock
from robotree.vr.base.errors import NoAnswer, NothingHeld, VrError
from robotree.vr.base.principal import Principal
from robotree.vr.base.requests import STOPPED, Done, Raised, Reply, Resume, SafeStop, TakeStep
from robotree.vr.core import events as on
from robotree.vr.core.confirmation import Budget, Confirmations
from robotree.vr.core.machine import RobotState
from robotree.vr.core.stop import HARDWARE, Stop
from robotree.vr.running.robot_runtime import RobotRuntime

T = TypeVar("T")


class Stops:
    """Stops one robot and releases it, pauses it and lets it go on. Lives on the event loop."""

    def __init__(self, runtime: RobotRuntime, hooks: Hooks, children: ChildKeeper | None) -> None:
        """Begin.

        Args:
            runtime: the robot.
            hooks: of the robot.
            children: of the robot; None: it can have none.
        """
        self._runtime, self._hooks, self._children = runtime, hooks, children
        self._key = runtime.key
        self._settling: dict[int, asyncio.Future[Done | Raised]] = {}
        """The waits for answers to stops, by generation."""
        self._asking: dict[tuple[int, str], asyncio.Task[None]] = {}
        """By generation and part."""
        self._releases = 0
        """How many resumes wait for what stands behind the robot."""

    def _look(self, query: Callable[[Stop], T]) -> T:
        return self._runtime.look(lambda state: query(state.stop))

    async def safe_stop(self, request: SafeStop, asker: Principal) -> Reply:
        """Stop now; answer when everything below has confirmed it, or when the time is over.

        Who orders a stop asks all robots of a tree at once, and each passes it on. Such a copy of an order
        that is obeyed already waits for the same answer: to stop again would be as much work as there are
        ways to the robot, and would count as a new stop.

        Raises:
            NotConfirmed: not everything below has confirmed it.
        """
        reason, order, within = request.reason or "protective stop", request.order, request.within
        effects = self._runtime.post(on.StopAsked(reason=reason, order=order, within=within, principal=asker))
        taken = next(effect for effect in effects if isinstance(effect, on.StopTaken))
        generation, reply = taken.generation, taken.reply
        if taken.fresh:
            self._runtime.changed()
            self._runtime.log.say("warning", f"{STOPPED}{reason}")
        if reply is None:
            if (settled := self._settling.get(generation)) is None:
                settled = self._settling[generation] = asyncio.get_running_loop().create_future()
            patience = self._budget(within).within
            await asyncio.wait([settled], timeout=None if taken.fresh else patience)
            if not settled.done():  # the copy before this one has more time
                raise NoAnswer(key=self._key, seconds=patience)
            reply = settled.result()
        if isinstance(reply, Raised):
            raise reply.revive()
        return msgspec.structs.replace(reply, stops=generation)

    def ask(self, effect: on.AskPart) -> None:
        """Ask a part of the robot to confirm a stop, unless it is being asked."""
        generation, part = effect.generation, effect.part
        if (generation, part) in self._asking:
            return
        confirmed = self._confirmation(effect)

        async def ask() -> None:
            answer: Done | Raised
            try:
                answer = Done(confirmed=tuple(await confirmed))
            except VrError as error:
                answer = Raised.of(error)
            finally:
                del self._asking[generation, part]
            self._runtime.post(on.StopAnswered(generation=generation, part=part, answer=answer))

        self._asking[generation, part] = asyncio.ensure_future(ask())

    def settled(self, effect: on.StopSettled) -> None:
        """All parts of the robot have answered a stop."""
        if (settling := self._settling.pop(effect.generation, None)) is not None:
            settling.set_result(effect.reply)

    async def resume(self, request: Resume, asker: Principal) -> Reply:
        """Release those below first: nobody may use a child that is still stopped.

        Raises:
            NotConfirmed: not everything is released.
            LeaseError: the asker may not command the robot.
        """
        runtime, name, began = self._runtime, self._runtime.robot.name, loop_now()
        budget = self._budget(request.within)
        runtime.expect_to_command(request.epoch, asker, ends=True)
        confirmations, counted = Confirmations("the resume"), self._stops_seen(request)
        if counted == runtime.stops and not await self._hooks.has_stopped(budget.wait / 2):
            confirmations.deny(name, STILL_STOPPING)
        if self._children is not None and counted == runtime.stops and confirmations.complete:
            await self._children.resume(request, confirmations, budget, waited=loop_now() - began)
            runtime.expect_to_command(request.epoch, asker, ends=True)  # that may have taken time
        allowed = counted == runtime.stops and confirmations.complete
        doubt = await self._release_own(budget.wait - (loop_now() - began)) if allowed else ""
        if counted != runtime.stops:
            confirmations.deny(name, "it was stopped again after that had been asked for")
        elif not confirmations.complete:
            if not confirmations.names(name):
                confirmations.deny(name, "it waits for those below it")
        else:
            self._take_own(confirmations, doubt)
            if not doubt:
                runtime.post(on.ReleaseAsked(generation=counted, principal=asker))
                self._runtime.changed()
        return Done(confirmed=tuple(confirmations.settle()))

    # -- inside -----------------------------------------------------------------------------------

    def _budget(self, within: float) -> Budget:
        depth, round_trip = self._runtime.look(lambda state: (state.slots.depth, state.slots.ways))
        return Budget(within, depth=depth, round_trips=round_trip)

    def _confirmation(self, effect: on.AskPart) -> Awaitable[Sequence[str]]:
        """Have a part stop, from now on; what is returned waits for who has confirmed it."""
        budget = self._budget(effect.within)
        if effect.part == HARDWARE or self._children is None:
            return self._own(self._hooks.safe_stop(effect.reason), budget)
        return self._children.safe_stop(effect.part, effect.reason, effect.order, budget)

    async def _own(self, confirming: Confirming, budget: Budget) -> Sequence[str]:
        """Wait until what stands behind the robot has confirmed a stop.

        Raises:
            VrError: it has not.
        """
        confirmations = Confirmations("the protective stop")
        self._take_own(confirmations, await confirming.doubt(budget.wait))
        return confirmations.settle()

    async def _release_own(self, within: float) -> str:
        """Release what stands behind the robot, within [s]; return why that is not confirmed, or nothing."""
        if not (self._look(lambda stop: stop.in_force) or self._releases):
            return ""  # nobody has stopped it: what is offline need not confirm that
        self._releases += 1
        try:
            return await self._hooks.resume().doubt(within)
        finally:
            self._releases -= 1

    def _stops_seen(self, request: Resume) -> int:
        """How many stops the asker has seen; all, if it does not report a number or no stop is in force."""
        stops = self._runtime.stops
        if not self._look(lambda stop: stop.in_force):
            return stops
        now = self._runtime.process.runner.now()
        if same_clock(request.clock) and not self._look(lambda stop: stop.known_to(request.given, now)):
            stops -= 1
        return stops if request.seen is None else min(request.seen.get(self._key, 0), stops)

    def _take_own(self, confirmations: Confirmations, doubt: str) -> None:
        if doubt:
            offline = "" if self._runtime.robot.online else "it is offline, and "
            confirmations.deny(self._runtime.robot.name, f"{offline}{doubt}")
        else:
            confirmations.take(self._runtime.robot.name, ())

    # -- pauses -----------------------------------------------------------------------------------

    def pause(self, asker: Principal) -> Reply:
        """Have each command wait before its next step.

        Raises:
            LeaseError: its parent commands it.
        """
        by = asker.person or asker.user
        self._runtime.post(on.PauseAsked(by=by, principal=asker))
        self._runtime.log.say("info", f"paused by {by}")
        now = self._runtime.process.runner.now()
        return Done(note=self._runtime.look(lambda state: _deadline(state, now)))

    async def step(self, children: ChildKeeper, order: TakeStep, asker: Principal) -> Reply:
        """Let the step pass that waits for the longest time, of this robot, else of one below it.

        Raises:
            NothingHeld: nothing waits before a step.
            NotPaused: the robot is not paused.
            LeaseError: its parent commands it, and somebody else asks.
        """
        name = self._runtime.name
        if taken := self._runtime.let_step(order.epoch, asker):
            self._note(f"takes {taken}", asker)
            return Done(note=f"{name} takes {taken}")
        if taken := await children.step(order.within):
            return Done(note=taken)
        command = self._runtime.look(lambda state: state.calls.command_of(state.calls.running))
        reason = f"the present step of {command} goes on" if command else "it carries nothing out"
        raise NothingHeld(robot=name, reason=reason)

    def go_on(self, asker: Principal) -> Reply:
        """End the pause.

        Raises:
            LeaseError: its parent commands it.
        """
        paused = self._runtime.look(lambda state: state.pause.in_force)
        self._runtime.post(on.ContinueAsked(principal=asker))
        if paused:
            self._note("goes on", asker)
        return Done(note="" if paused else f"{self._runtime.name} was not paused")

    def _note(self, order: str, asker: Principal) -> None:
        by = asker.person or ("its parent" if asker.agent.startswith("robot/") else asker.user)
        self._runtime.log.say("info", f"{order}, ordered by {by}")


def _deadline(state: RobotState, now: float) -> str:
    """Say that the time of what runs goes on, with what is left of it."""
    running = state.calls.live.get(state.calls.running)
    if running is None or not math.isfinite(running.deadline_at):
        return ""
    return f"the deadline of {running.command} goes on: {max(running.deadline_at - now, 0.0):.0f} s left"
