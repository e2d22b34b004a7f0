"""One assistant in a realm: what it sees, its calls, its permits, and the end of its calls when it is gone.

All rules hold here and at the robot: this side tells the assistant why, the robot decides.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import time
from collections import deque
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from robotree.assistants import preview
from robotree.assistants.budget import Budget, Limited
from robotree.assistants.keys import AssistantKeys
from robotree.assistants.marking import data_of, said
from robotree.assistants.meter import Way
from robotree.assistants.record import Became, Record
from robotree.assistants.tools import (
    LONGEST_WITHIN,
    USUAL_WITHIN,
    CommandText,
    CommandTool,
    text_of,
    tool_of,
)
from robotree.vr.base.arguments import check_arguments
from robotree.vr.base.chance import token
from robotree.vr.base.envelope import asking_for_assistant
from robotree.vr.base.errors import (
    AssistantUnknown,
    BadArgument,
    BudgetSpent,
    CommandCancelled,
    Denied,
    NoSuchCommand,
    NoSuchPermit,
    NoSuchRobot,
    PermitNeeded,
    PermitRefused,
    VrError,
)
from robotree.vr.base.foreign import bounded
from robotree.vr.base.permit import Permit, PermittedCall
from robotree.vr.base.policy import ASK, AssistantTerms, Decision, Person, PolicyTarget
from robotree.vr.base.principal import user_name
from robotree.vr.base.requests import Call
from robotree.vr.exchange.asking import fresh_key
from robotree.vr.network.permit_file import PermitFiles

if TYPE_CHECKING:
    from robotree.assistants.catalogue import Catalogue
    from robotree.vr.base.description import CommandSpec, Listing, RobotDescription
    from robotree.vr.base.requests import State
    from robotree.vr.base.transport import Registration
    from robotree.vr.supervision.realm_client import RealmClient

LEASE: Final = 15.0
"""[s] for which an assistant whose commands run may be silent: then it is gone."""
LOOKS: Final = 1.0
"""[s] between two looks whether it is."""
TOGETHER: Final = 8
"""Commands of one assistant that run at the same time."""
REQUESTS: Final = 50
"""Requests of one assistant in a second: of more none is dealt with, but a stop."""
REMEMBERED: Final = 64
"""Calls whose end an assistant can still ask for."""
AHEAD: Final = 0.5
"""[m] that are booked for a command before its robots move as far."""
PICTURE_WITHIN: Final = 3.0
"""[s] for the picture that a person is shown."""
MOST_TEXTS: Final = 10_000
"""Commands whose texts are kept ready for lists of tools."""
DEEPEST: Final = 6
"""Levels of robots below one that are looked at."""
REHEARSAL: Final = "rehearsal"
"""Who says yes in the twin of a cell."""


class Floor(NamedTuple):
    """What all assistants of one process share."""

    realm_client: RealmClient
    catalogue: Catalogue
    folder: Path
    """In which the realm keeps its things."""
    permits: PermitFiles
    rehearses_for: Path | None = None
    """The folder of the real realm, if this one is its twin: there is kept how calls went."""


class Going:
    """A call that goes on, or has ended."""

    def __init__(self, robot: str, call: Call, way: Way, permit: str) -> None:
        """Nothing has happened yet."""
        self.id, self.robot, self.call, self.way, self.permit = permit or token(), robot, call, way, permit
        self.fraction, self.text = math.nan, ""
        self.began, self.changed = time.time(), time.time()
        self.why_ended = ""
        """Why it was ended from here; empty: it was not."""
        self.value: Any = None
        self.error: VrError | None = None
        self.observed: dict[str, float] = {}
        self.metres = math.inf
        """[m] that are booked for it: its robots may move as far."""
        self.task: asyncio.Task[None] | None = None
        self.news = asyncio.Event()

    @property
    def over(self) -> bool:
        """Whether it has ended, well or badly."""
        return self.task is not None and self.task.done()

    def note(self, fraction: float, text: str) -> None:
        """Take how far it is."""
        self.fraction, self.text, self.changed = fraction, bounded(text), time.time()
        self.news.set()

    def end(self, why: str) -> None:
        """End it; it is over a moment later."""
        self.why_ended = self.why_ended or why
        if self.task is not None:
            self.task.cancel()

    async def wait(self, within: float | None = None) -> bool:
        """Wait for its end [s; None: however long that takes]; returns whether it has ended."""
        if self.task is not None:
            await asyncio.wait([self.task], timeout=within)
        return self.over

    def result(self) -> Any:
        """Return what it has returned, bounded.

        Raises:
            VrError: it has failed.
        """
        if self.error is not None:
            raise self.error
        return data_of(self.value)


class Seat:
    """One assistant, from its first request to its end."""

    def __init__(self, floor: Floor, name: str, proof: str) -> None:
        """Take its name, which its key has proved, and what is kept of that key."""
        self.name, self.floor = name, floor
        self._keys, self._proof = AssistantKeys(floor.rehearses_for or floor.folder), proof
        self.record = Record(floor.folder, name)
        self.going: dict[str, Going] = {}
        self.open = 0
        """Requests that wait for an answer at the moment, and streams that it listens to."""
        self._seen = time.monotonic()
        self._requests: deque[float] = deque(maxlen=REQUESTS)
        self._tools: tuple[object, dict[str, CommandTool]] = (None, {})
        self._texts: dict[tuple[int, bool], tuple[CommandSpec, CommandText]] = {}
        """What tools have in common, by the number of the command's object, which is kept, and `asks`."""
        self._made: dict[str, tuple[object, object, list[CommandTool]]] = {}
        """The tools of each robot, and the description and the policy of which they were made."""
        self._readings: dict[str, Mapping[str, float]] = {}
        """What each robot has read last."""
        self._syncing: asyncio.Task[None] | None = None
        self._unsynced = False
        self.revoked = asyncio.Event()
        """Set when its key was taken back, replaced, or has ended."""
        self._watch: asyncio.Task[None] | None = None
        self._states: Registration | None = None

    async def start(self) -> None:
        """Begin to watch how its robots move, and whether it is there."""
        self._states = await self.floor.realm_client.watch_state(None, self._hear)
        self._watch = asyncio.create_task(self._look_after())

    async def close(self) -> None:
        """End its commands as the policy says, for the assistant is gone; returns when they have ended."""
        await self.leave("it has gone")
        await asyncio.gather(*(going.wait() for going in self.going.values()))
        if self._watch is not None:
            self._watch.cancel()
            await asyncio.gather(self._watch, return_exceptions=True)
        if self._states is not None:
            await self._states.close()

    # -- who it is --------------------------------------------------------------------------------

    @property
    def terms(self) -> AssistantTerms:
        """What the policy says of it now."""
        policy = self.floor.realm_client.gate.policy
        return AssistantTerms() if policy is None else policy.assistants.get(self.name, AssistantTerms())

    @property
    def asker(self) -> Person:
        """The assistant, as a policy names who asks."""
        return self.floor.realm_client.gate.user(user_name(os.geteuid()))._replace(assistant=self.name)

    def touch(self) -> None:
        """Note that a request has come.

        Raises:
            BudgetSpent: too many come; a stop is heard nevertheless.
            AssistantUnknown: its key was taken back.
        """
        if self.revoked.is_set():
            raise AssistantUnknown(detail=f"the key of {self.name} was taken back")
        now = self._seen = time.monotonic()
        if len(self._requests) == REQUESTS and now - self._requests[0] < 1.0:
            raise BudgetSpent(
                assistant=self.name, what="requests", used=REQUESTS, limit=REQUESTS, per="a second", seconds=1
            )
        self._requests.append(now)

    def may(self, right: str, robot: RobotDescription | Listing, command: str = "") -> bool:
        """Whether the policy allows it something."""
        return self._decided(right, robot, command).allowed

    def _decided(self, right: str, robot: RobotDescription | Listing, command: str = "") -> Decision:
        target = self._target(robot)._replace(command=command)
        return self.floor.realm_client.gate.may(self.asker, right, target)

    def _target(self, robot: RobotDescription | Listing) -> PolicyTarget:
        realm_client = self.floor.realm_client
        site = realm_client.places.site_of(robot.address.key) or realm_client.gate.site
        name, role = robot.address.plain_name, robot.address.role
        return PolicyTarget(name, role, tuple(robot.kinds), "", site)

    # -- what it sees -----------------------------------------------------------------------------

    def robots(self) -> dict[str, RobotDescription]:
        """Return the robots that it may see, by name, as they described themselves last."""
        return {name: robot for name, robot in self.floor.catalogue.robots.items() if self.may("see", robot)}

    def views(self) -> list[Listing]:
        """Return the views that it may see."""
        return [view for view in self.floor.catalogue.views if self.may("see", view)]

    def tools(self) -> dict[str, CommandTool]:
        """Return the commands that it may have carried out, asking or not, by the names of the tools."""
        state = (self.floor.catalogue.version, self.floor.realm_client.gate.policy)
        if self._tools[0] != state:
            self._tools = state, self._make_tools()
        return self._tools[1]

    def _make_tools(self) -> dict[str, CommandTool]:
        """Make the tools: of a robot that is as it was there are the same ones."""
        if len(self._texts) > MOST_TEXTS:
            self._texts.clear()
        policy, before, self._made = self.floor.realm_client.gate.policy, self._made, {}
        found: dict[str, CommandTool] = {}
        for name, robot in self.floor.catalogue.robots.items():
            known = before.get(name)
            if known is None or known[0] is not robot or known[1] is not policy:
                known = robot, policy, [*self._tools_of(robot)]
            self._made[name] = known
            found |= {tool.name: tool for tool in known[2]}
        return found

    def _tools_of(self, robot: RobotDescription) -> Iterator[CommandTool]:
        asker, target, gate = self.asker, self._target(robot), self.floor.realm_client.gate
        if not gate.may(asker, "see", target).allowed:
            return
        for spec in robot.commands:
            named = target._replace(command=spec.name)
            may = gate.may(asker, "command", named).allowed
            if not may and not gate.may(asker, ASK, named).allowed:
                continue
            known = self._texts.get((id(spec), not may))
            if known is None:
                known = self._texts[id(spec), not may] = spec, text_of(spec, asks=not may)
            yield tool_of(robot, spec, asks=not may, text=known[1])

    async def describe(self, robot: str) -> RobotDescription:
        """Ask a robot how it is now, for the assistant."""
        with asking_for_assistant(self.name):
            return await self.floor.realm_client.describe(robot)

    async def look(self, view: str, camera: str) -> bytes:
        """Fetch a picture of a view that it may see, as JPEG."""
        with asking_for_assistant(self.name):
            return (await self.floor.realm_client.look(view, camera=camera)).jpeg

    # -- calls ------------------------------------------------------------------------------------

    async def call(
        self, robot: str, command: str, arguments: Mapping[str, Any], why: str, within: float
    ) -> Going:
        """Have a command begin.

        Args:
            robot: its name.
            command: its name.
            arguments: numbers in the declared units, or text with units.
            why: in the assistant's words.
            within: [s] within which it must be done.

        Returns:
            The call, which goes on.

        Raises:
            PermitNeeded: a person is asked first.
            VrError: it is refused.
        """
        asked: dict[str, Any] = {"robot": robot, "command": command, "arguments": dict(arguments), "why": why}
        try:
            self.spend_a_call()
            described, spec, taken = await self._checked(robot, command, arguments, within)
            if self.may("command", described, spec.name):
                return await self._begin(described, spec, taken, within, why, None)
            decision = self._decided(ASK, described, spec.name)
            if not decision.allowed:
                raise Denied(who=str(self.asker), right="command", target=f"{robot}.{command}",
                             reason=decision.reason, ask=self.floor.realm_client.gate.ask)  # fmt: skip
            permit = await self._ask_a_person(described, spec, taken, within, why)
        except VrError as error:
            self.record.write("refused", **asked, text=str(error))
            raise
        if self.floor.rehearses_for is not None:
            self.floor.permits.answer(permit.id, yes=True, by=REHEARSAL)
            return await self.begin(permit.id)
        self.record.write("asked", **asked, permit=permit.id)
        raise PermitNeeded(robot=robot, command=command, permit=permit.id)

    async def begin(self, permit: str) -> Going:
        """Have the call of a permit begin to which a person has said yes.

        Raises:
            PermitRefused: nobody has, it was used, or the robot is not as it was.
            VrError: it is refused.
        """
        found = self.permit(permit)
        try:
            described, spec, taken = await self._checked(
                found.robot, found.command, found.arguments, found.within
            )
            if taken != found.arguments:
                raise PermitRefused(permit=permit, reason="the command takes other arguments now")
            if not (self.may("command", described, spec.name) or self.may(ASK, described, spec.name)):
                raise PermitRefused(permit=permit, reason="the policy does not allow it any more")
            return await self._begin(described, spec, found.arguments, found.within, found.why, found)
        except VrError as error:
            self.record.write(
                "refused", robot=found.robot, command=found.command, permit=permit, text=str(error)
            )
            raise

    def permit(self, permit: str) -> Permit:
        """Return a permit of this assistant; of others it learns nothing.

        Raises:
            NoSuchPermit: it has none of this id.
        """
        found = self.floor.permits.find(permit)
        if found.assistant != self.name:
            raise NoSuchPermit(permit=permit)
        return found

    def withdraw(self, permit: str) -> str:
        """End a call that goes on, or take back a permit that was not used; returns what was done.

        Raises:
            NoSuchPermit: there is neither.
            PermitRefused: it is over.
        """
        if (going := self.going.get(permit)) is not None and not going.over:
            going.end("the assistant ended it")
            return f"{going.robot}.{going.call.command} ends"
        withdrawn = self.floor.permits.withdraw(permit, self.name)
        return f"permit {withdrawn.id} is withdrawn"

    async def stop(self, robot: str | None) -> tuple[str, ...]:
        """Protective stop of one robot, or of all: an assistant always may; a person resumes."""
        self.record.write("stopped", robot=bounded(robot or "all", 80))
        with asking_for_assistant(self.name):
            return tuple(await self.floor.realm_client.stop(robot))

    def spend_a_call(self) -> None:
        """Note that it has made a call.

        Raises:
            BudgetSpent: it has made too many.
        """
        terms = self.terms

        def spend(budget: Budget, now: float) -> None:
            budget.expect("calls", terms, now, assistant=self.name)
            budget.use("calls", 1.0, now)

        self.record.change(spend)

    # -- when it is gone --------------------------------------------------------------------------

    async def leave(self, why: str) -> None:
        """Do with its commands what the policy says when it is gone."""
        goings = [going for going in self.going.values() if not going.over]
        if not goings:
            return
        gone = self.terms.gone
        self.record.write("gone", text=f"{why}: {gone}")
        if gone == "finish":
            return
        for going in goings:
            going.end(f"{self.name} is gone")
        if gone == "stop":
            for robot in {going.robot for going in goings}:
                with asking_for_assistant(self.name), contextlib.suppress(VrError):
                    await self.floor.realm_client.stop(robot)

    def _has_key(self) -> bool:
        try:
            return self._keys.good(self.name, self._proof)
        except VrError:
            return False

    async def _look_after(self) -> None:
        while True:
            await asyncio.sleep(LOOKS)
            if not self.revoked.is_set() and not await asyncio.to_thread(self._has_key):
                self.revoked.set()
                await self.leave("its key was taken back")
            if self.open == 0 and time.monotonic() - self._seen > LEASE:
                await self.leave(f"nothing was heard of it for {LEASE:.0f} s")

    # -- inside -----------------------------------------------------------------------------------

    async def _checked(
        self, robot: str, command: str, arguments: Mapping[str, Any], within: float
    ) -> tuple[RobotDescription, CommandSpec, dict[str, Any]]:
        """Look what is called, as it is now, and read the arguments as it takes them."""
        if robot not in self.floor.catalogue.robots:
            raise NoSuchRobot(name=bounded(robot))
        if not 0 < within <= LONGEST_WITHIN:
            raise BadArgument(
                command=f"{robot}.{command}", parameter="_within", reason=f"0 to {LONGEST_WITHIN:g} s"
            )
        before = self.floor.catalogue.robots[robot]
        listed = before.command(command)
        alone = not before.slots and robot in self._readings
        if (
            listed is not None and (listed.effect == "read" or alone) and self.may("command", before, command)
        ):  # where it is now need not be asked: nothing is measured, or it has told so
            return before, listed, check_arguments(listed, arguments, robot=robot)
        described = await self.describe(robot)
        spec = described.command(command)
        if spec is None:
            known = ", ".join(each.name for each in described.commands)
            raise NoSuchCommand(robot=robot, command=bounded(command), known=known)
        return described, spec, check_arguments(spec, arguments, robot=robot)

    async def _ask_a_person(
        self, robot: RobotDescription, spec: CommandSpec, taken: dict[str, Any], within: float, why: str
    ) -> Permit:
        digest = preview.digest_of(robot, spec.name, taken)
        below = await self._below(robot)
        shown = preview.preview_of(robot, spec, taken, [*below], preview.rehearsed(self.floor.folder, digest))
        site = self.floor.realm_client.places.site_of(robot.address.key)
        asked = Permit(
            id=_id(),
            assistant=self.name,
            robot=robot.name,
            life=robot.address.key,
            stops=robot.stops,
            below=below,
            command=spec.name,
            arguments=taken,
            units={field.name: field.unit for field in spec.parameters if field.unit and field.name in taken},
            within=within,
            why=bounded(why),
            preview=(f"at site {site}", *shown.lines) if site else shown.lines,
            path=shown.path,
            asked=time.time(),
        )
        if (waiting := self.floor.permits.like(asked)) is not None:
            return waiting
        return self.floor.permits.ask(asked, b"" if self.floor.rehearses_for else await self._picture())

    async def _picture(self) -> bytes:
        """Return the picture that a person is shown; empty: there is none."""
        for view in self.floor.catalogue.views:
            with asking_for_assistant(""), contextlib.suppress(VrError, TimeoutError):
                async with asyncio.timeout(PICTURE_WITHIN):
                    return (await self.floor.realm_client.look(view.name)).jpeg
        return b""

    async def _below(self, robot: RobotDescription) -> dict[str, tuple[str, int]]:
        """Return the robots that a robot commands, and those that these command: lives and stops, by name."""
        found: dict[str, tuple[str, int]] = {}
        level = [robot]
        for _ in range(DEEPEST):
            names = [slot.child.name for each in level for slot in each.slots if slot.child is not None]
            level = level[:0]
            for name in names:
                if name not in found:
                    found[name] = ("", -1)
                    with contextlib.suppress(VrError), asking_for_assistant(""):
                        described = await self.floor.realm_client.describe(name)
                        found[name] = (described.address.key, described.stops)
                        level.append(described)
        return found

    async def _begin(
        self,
        robot: RobotDescription,
        spec: CommandSpec,
        taken: dict[str, Any],
        within: float,
        why: str,
        permit: Permit | None,
    ) -> Going:
        """Send the call, after its budgets and its permit have been checked once more."""
        moves = spec.effect != "read"
        below = await self._below(robot) if moves or permit is not None else {}
        if permit is not None and below != permit.below:
            reason = "a robot below it was stopped, or is another one, since it was asked for"
            raise PermitRefused(permit=permit.id, reason=reason)
        if sum(not going.over for going in self.going.values()) >= TOGETHER:
            raise BudgetSpent(
                assistant=self.name,
                what="commands at a time",
                used=TOGETHER,
                limit=TOGETHER,
                per="",
                seconds=1,
            )
        key, note = fresh_key(), f"{self.name} says {said(why)}"
        within, metres = self._book(key, within) if moves else (within, math.inf)
        if permit is not None:
            sent = PermittedCall(permit.id, robot.address.key, robot.stops, spec.name, taken, key)
            try:
                permit = self.floor.permits.begin(permit.id, self.name, sent)
            except VrError:
                self._settle(key, {})
                raise
            note += f"; {permit.by} said yes at {_clock(permit.answered)} (permit {permit.id})"
        call = Call(
            key=key, command=spec.name, arguments=taken, caller=self.name, deadline=within,
            permit="" if permit is None else permit.id, note=note,
        )  # fmt: skip
        going = Going(robot.name, call, Way((robot.name, *below) if moves else ()), call.permit)
        if moves:
            going.way.take(robot.name, self._readings.setdefault(robot.name, robot.readings))
        self.record.write(
            "begun", robot=robot.name, command=spec.name, arguments=taken, why=why, key=key,
            permit=call.permit, by="" if permit is None else permit.by,
        )  # fmt: skip
        self._remember(going)
        going.metres = metres
        with asking_for_assistant(self.name):
            going.task = asyncio.create_task(self._carry_out(going, robot, moves=moves))
        return going

    def _book(self, key: str, within: float) -> tuple[float, float]:
        """Take out of the budget what a command may use, on the disk, before it is sent.

        Of the seconds that is all that it may take, of the metres the first few (`AHEAD`).

        Returns:
            The seconds and the metres that it has.

        Raises:
            BudgetSpent: nothing is left.
        """
        terms = self.terms

        def book(budget: Budget, now: float) -> tuple[float, float]:
            budget.expect("seconds", terms, now, assistant=self.name)
            budget.expect("metres", terms, now, assistant=self.name)
            return (
                budget.book(key, "seconds", within, terms, now),
                budget.book(key, "metres", AHEAD, terms, now),
            )

        found = self.record.change(book)
        self._unsynced = True
        if self._syncing is None or self._syncing.done():
            self._syncing = asyncio.create_task(self._sync())
        return found

    async def _sync(self) -> None:
        """Have what is booked survive a loss of power, too, while the call is on its way."""
        while self._unsynced:
            self._unsynced = False
            with contextlib.suppress(OSError):
                await asyncio.to_thread(self.record.sync)

    def _book_on(self, going: Going) -> None:
        """Take out of the budget the metres that a command has used up, and some more; end it if none are."""
        terms, wanted = self.terms, going.way.metres + AHEAD

        def book(budget: Budget, now: float) -> float:
            return budget.book(going.call.key, "metres", wanted, terms, now)

        try:
            going.metres = self.record.change(book)
        except OSError as error:
            going.end(f"what {self.name} uses cannot be kept: {error}")
            return
        if going.way.metres > going.metres:
            going.end(f"{self.name} has used its {terms.metres:g} m an hour")

    def _settle(self, key: str, used: Mapping[Limited, float]) -> None:
        """Note what a command has used of what was booked; the rest can be used by others again."""

        def settle(budget: Budget, now: float) -> None:
            budget.settle(key, used, now)

        self.record.change(settle)

    def _remember(self, going: Going) -> None:
        for old in [key for key, each in self.going.items() if each.over][
            : max(0, len(self.going) - REMEMBERED)
        ]:
            del self.going[old]
        self.going[going.id] = going

    async def _carry_out(self, going: Going, robot: RobotDescription, *, moves: bool) -> None:
        began, call = time.monotonic(), going.call
        try:
            going.value = await self.floor.realm_client.carry_out(robot.address, call, on_progress=going.note)
        except VrError as error:
            going.error = error
        except asyncio.CancelledError:
            reason = going.why_ended or "the server ends"
            going.error = CommandCancelled(robot=going.robot, command=call.command, reason=reason)
        seconds = time.monotonic() - began
        if moves:
            going.observed = await self._observe(going.robot)
            going.way.take(going.robot, going.observed)
            with contextlib.suppress(OSError):  # then all that was booked counts as used
                self._settle(call.key, {"seconds": seconds, "metres": going.way.metres})
        going.changed = time.time()
        self._write_down(going, seconds)

    async def _observe(self, robot: str) -> dict[str, float]:
        """Return what a robot reads after its command."""
        with contextlib.suppress(VrError, TimeoutError):
            async with asyncio.timeout(PICTURE_WITHIN):
                return dict((await self.describe(robot)).readings)
        return {}

    def _write_down(self, going: Going, seconds: float) -> None:
        ended = "done" if going.error is None else str(going.error)
        seen = ", ".join(f"{name} {value:.4g}" for name, value in [*going.observed.items()][:8])
        text = f"{ended}; {seconds:.1f} s, {going.way.metres:.2f} m" + (f"; then {seen}" if seen else "")
        outcome: Became = "done" if going.error is None else "failed"
        self.record.write(outcome, robot=going.robot, command=going.call.command, key=going.call.key,
                          permit=going.permit, text=text)  # fmt: skip
        if going.permit:
            self.floor.permits.settle(going.permit, bounded(text))
        if (folder := self.floor.rehearses_for) is not None and going.way.points:
            self._keep_rehearsal(folder, going, seconds, ended)

    def _keep_rehearsal(self, folder: Path, going: Going, seconds: float, ended: str) -> None:
        robot = self.floor.catalogue.robots.get(going.robot)
        if robot is not None:
            digest = preview.digest_of(robot, going.call.command, going.call.arguments)
            kept = preview.Rehearsal(
                call=f"{going.robot}.{going.call.command}", ok=going.error is None, outcome=bounded(ended),
                seconds=seconds, metres=going.way.metres, path=going.way.longest, unix=time.time(),
            )  # fmt: skip
            preview.keep(folder, digest, kept)

    def _hear(self, robot: str, state: State) -> None:
        self._readings[robot] = state.readings
        for going in self.going.values():
            if not going.over:
                going.way.take(robot, state.readings)
                if going.way.metres > going.metres:
                    self._book_on(going)


def explained(error: VrError) -> str:
    """Return an error for an assistant: what robots say in it is bounded."""
    return f"{type(error).__name__}: {bounded(str(error), 1000)}"


def usual_within(given: Any) -> float:
    """Return the time that a call may take, [s]; NaN: what was given is none."""
    if given is None:
        return USUAL_WITHIN
    return float(given) if isinstance(given, int | float) and not isinstance(given, bool) else math.nan


def _id() -> str:
    """Return the id of a new permit: short enough to be typed, and nobody can guess it."""
    import secrets

    return "".join(secrets.choice("abcdefghjkmnpqrstuvwxyz23456789") for _ in range(8))


def _clock(unix: float) -> str:
    return time.strftime("%H:%M:%S", time.localtime(unix))
