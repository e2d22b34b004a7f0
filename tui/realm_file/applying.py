"""The steps of a plan, carried out: each as soon as what it needs is done, several at once.

A step that fails keeps back those that need it, and no others. A host brings the robots back that it has
kept, so hosts are started first, and what is still to be done then is planned anew.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Literal, Protocol

import msgspec
from msgspec import structs

from robotree.tui.errors import SupervisorError, sentence
from robotree.tui.line.carrying import Refusal, Silent, carry_out
from robotree.tui.line.grammar import Line
from robotree.tui.processes.programs import KEY_VARIABLE, end_process
from robotree.tui.realm_file.content import CONTROLLER, KEYWORDS, NAMELESS, ProcessEntry, RealmFile, placed
from robotree.tui.realm_file.plan import Page, Plan, Step, plan
from robotree.tui.realm_file.present import ROLES, Controller, present
from robotree.vr.base.errors import SlotEmpty, VrError

if TYPE_CHECKING:
    from robotree.vr.base.address import Role
    from robotree.vr.supervision.realm_client import RealmClient

ARRIVAL = 10.0
"""[s] in which a process that is ready is seen."""


class Starter(Protocol):
    """A starter of a realm's processes, which so knows its simulated controllers."""

    @property
    def controllers(self) -> Mapping[str, Controller]:
        """Those that live, by name."""
        ...

    async def start(self, entry: ProcessEntry, words: Sequence[str], environment: Mapping[str, str]) -> str:
        """Start a process and return its address when it is ready.

        Raises:
            SupervisorError: it did not come up.
        """
        ...


class Done(msgspec.Struct, frozen=True):
    """The result of a step."""

    step: Step
    outcome: Literal["done", "failed", "kept back"]
    reason: str = ""
    """Why it is not done."""


Report = Callable[[Done], object]
"""Hears of each step when it is over."""


Agree = Callable[[Plan], Awaitable[None]]
"""Takes what is about to be done; raises what ends it."""


async def bring_about(
    wanted: RealmFile,
    pages: Mapping[str, Page],
    realm_client: RealmClient,
    starter: Starter,
    report: Report,
    agree: Agree,
    *,
    prune: bool = False,
) -> tuple[Plan, list[Done]]:
    """Bring about what a file says.

    Args:
        wanted: the file.
        pages: of its robots, by name.
        realm_client: of the realm.
        starter: of its processes.
        report: hears of each step when it is over.
        agree: is asked before anything is done, and again if what a host has brought back needs more steps.
        prune: whether what is not in the file is ended.

    Returns:
        All that was planned; what became of each step, in the order in which they ended.

    Raises:
        BadRealmFile: the file names what is nowhere, or cannot be.
    """

    async def planned() -> Plan:
        return plan(wanted, await present(realm_client, starter.controllers), pages, prune=prune)

    first = await planned()
    await agree(first)
    hosts = {step.id: step for step in first.steps if step.entry is not None and step.entry.verb == "host"}
    done = await _Work(hosts.values(), wanted, realm_client, starter, report).carry_out()
    then = await planned() if hosts else first
    known, still = {step.text for step in first.steps}, {step.text for step in then.steps}
    new = tuple(step for step in then.steps if step.text not in known)
    if new:
        await agree(structs.replace(then, steps=new, left=()))
    for step in first.steps:
        if step.id not in hosts and step.text not in still:
            free = "it is free already"
            reason = free if step.sign == "-" else f"{step.keeper or 'a host'} has brought it back"
            done.append(Done(step, "done", reason))
            report(done[-1])
    rest = [step for step in then.steps if step.id not in hosts]
    done += await _Work(rest, wanted, realm_client, starter, report, done).carry_out()
    return structs.replace(then, steps=(*first.steps, *new)), done


class _Work:
    def __init__(
        self,
        steps: Iterable[Step],
        wanted: RealmFile,
        realm_client: RealmClient,
        starter: Starter,
        report: Report,
        before: Iterable[Done] = (),
    ) -> None:
        self._steps = {step.id: step for step in steps}
        self._wanted, self._realm_client, self._starter, self._report = wanted, realm_client, starter, report
        self._before = {one.step.id: one for one in before}
        self._over: dict[str, Done] = {}
        self._tasks: dict[str, asyncio.Task[None]] = {}

    async def carry_out(self) -> list[Done]:
        async with asyncio.TaskGroup() as group:
            for step in self._steps.values():
                self._tasks[step.id] = group.create_task(self._see_to(step), name=step.text)
        return [*self._over.values()]

    async def _see_to(self, step: Step) -> None:
        await asyncio.sleep(0)  # all tasks are there
        needs = [self._tasks[need] for need in step.needs if need in self._tasks]
        if needs:
            await asyncio.wait(needs)
        over = self._before | self._over
        broken = sorted(need for need in step.needs if need in over and over[need].outcome != "done")
        if broken:
            done = Done(step, "kept back", f"it needs `{over[broken[0]].step.text}`")
        else:
            reason = await self._do(step)
            done = Done(step, "failed" if reason else "done", reason)
        self._over[step.id] = done
        self._report(done)

    async def _do(self, step: Step) -> str:
        """Do a step; return why it could not be done."""
        try:
            if step.entry is not None:
                await self._start(step.entry)
            elif step.process:
                await end_process(step.process)
            elif step.line is not None:
                return await self._carry_out(step.line)
        except (SupervisorError, VrError, OSError, TimeoutError) as error:
            return sentence(error) or "it took too long"
        return ""

    async def _carry_out(self, line: Line) -> str:
        """Carry out a line; return why it could not be done. A slot that has lost its child is empty, too."""
        result = await carry_out(self._realm_client, line, Silent())
        if not isinstance(result, Refusal) or (
            line.verb == "release" and isinstance(result.error, SlotEmpty)
        ):
            return ""
        return str(result)

    async def _start(self, entry: ProcessEntry) -> None:
        controller = self._starter.controllers.get(entry.text(CONTROLLER))
        words = entry.words(self._wanted.folder, "" if controller is None else controller.address)
        key = self._wanted.key
        path = placed(key, self._wanted.folder) if key and key not in KEYWORDS else key
        await self._starter.start(entry, words, {KEY_VARIABLE: path} if key else {})
        if entry.verb != NAMELESS:
            role: Role = ROLES[entry.verb]
            await self._realm_client.arrival(role, entry.name, within=ARRIVAL)
