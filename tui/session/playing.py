"""Plays session scripts against a realm client: waits, looks, acts, and reports each step as it happens."""

from __future__ import annotations

import asyncio
import errno
import json
import re
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robotree.files import overwrite, text
from robotree.tui import exit_codes
from robotree.tui.errors import SessionError, SupervisorError
from robotree.tui.line import values
from robotree.tui.line.action import Where
from robotree.tui.line.carrying import Refusal, Silent, carry_out
from robotree.tui.line.grammar import Line
from robotree.tui.line.shell import Console
from robotree.tui.line.surface import Surface
from robotree.tui.line.verbs import Teller
from robotree.tui.processes.realm import only_looking
from robotree.tui.seen import wording
from robotree.tui.seen.wording import typed
from robotree.tui.session import faults, junit
from robotree.tui.session.conditions import Scene, Verdict, inside
from robotree.tui.session.script import (
    Block,
    Do,
    Expect,
    Later,
    Let,
    Node,
    PlayedStep,
    Report,
    Script,
    Sleep,
    Step,
    Trial,
    deed_of,
    filled,
    flat,
    read,
    transcript,
)
from robotree.tui.terminal import aside, put

if TYPE_CHECKING:  # a script is read before the agents are needed
    from robotree.vr.base.description import RobotDescription
    from robotree.vr.base.requests import State
    from robotree.vr.base.transport import Registration
    from robotree.vr.supervision.realm_client import RealmClient

LOOK_AGAIN = 0.1
"""[s] between two looks at a condition that does not hold yet."""

LARGEST = 1_000_000
"""[bytes] of a script; more is none."""

STDIN = "-"
"""The word instead of a file that reads standard input."""

Tell = Callable[[PlayedStep], None]


class Player:
    """Plays one script."""

    def __init__(
        self, realm_client: RealmClient, script: Script, tell: Tell, teller: Teller | None = None
    ) -> None:
        """Prepare.

        Args:
            realm_client: on which it is played.
            script: what is played.
            tell: hears of each step when it is over.
            teller: hears of each verb while it goes on.
        """
        self.realm_client, self.script = realm_client, script
        self.tell, self.teller = tell, teller or Silent()
        self.result: Any = None
        self.refusal = ""
        self._values: dict[str, str] = {}
        """What was measured, by name."""
        self._told: list[PlayedStep] = []
        self._left: list[str] = []
        self._trial, self._began = "", time.monotonic()
        self._at = Step(0, "", Sleep(0.0))
        """The step that is played."""
        self._heard: dict[str, Mapping[str, float]] = {}
        self._listening: list[Registration] = []

    async def play(self, *trials: Trial) -> Report:
        """Play until the end or until a step does not hold: these trials, or all, one after the other."""
        began, trials = time.monotonic(), trials or self.script.trials
        for position, trial in enumerate(trials):
            if not await self.play_trial(trial):
                self._left += [step.text for each in trials[position + 1 :] for step in flat(each.nodes)]
                break
        wall = time.monotonic() - began
        return Report(script=self.script.path, told=tuple(self._told), wall_s=wall, left=tuple(self._left))

    async def play_trial(self, trial: Trial) -> bool:
        """Play one trial to its end, or to a step that does not hold; returns whether all held."""
        self._trial, self._began = trial.name, time.monotonic()
        self._values, self.result, self.refusal = {}, None, ""
        try:
            # a resume ends the stops that are known here when its step begins
            self._listening.append(await self.realm_client.watch_state(None))
            held = await self._nodes(trial.nodes)
            if not held:
                await self._each(trial.on_failure)
            return await self._each(trial.at_end) and held
        finally:
            await faults.end_all(self.realm_client)
            for listening in self._listening:
                await listening.close()
            self._listening.clear()
            self._heard.clear()

    async def _nodes(self, nodes: Sequence[Node]) -> bool:
        """Play lines until one does not hold; returns whether all held."""
        for position, node in enumerate(nodes):
            if not await self._node(node):
                self._left += [step.text for step in flat(nodes[position + 1 :])]
                return False
        return True

    async def _each(self, nodes: Sequence[Node]) -> bool:
        """Play all of some lines, whatever becomes of each; returns whether all held."""
        left, held = list(self._left), True
        for node in nodes:
            held = await self._node(node) and held
        self._left = left
        return held

    async def _node(self, node: Node) -> bool:
        if isinstance(node, Step):
            return await self._told_step(node)
        if node.within is None:
            return await self._rounds(node)
        limit = asyncio.timeout(node.within)
        try:
            async with limit:
                return await self._rounds(node)
        except TimeoutError:
            if not limit.expired():
                raise
        seen = f"not over within {node.within:g} s: line {self._at.number} went on, {self._at.text}"
        self._say(Step(node.number, node.text, self._at.deed), Verdict(holds=False, seen=seen), node.within)
        return False

    async def _rounds(self, block: Block) -> bool:
        for number in range(1, block.rounds + 1):
            if block.rounds > 1 or block.within is None:
                self._values["round"] = str(number)
            if not await self._nodes(block.body):
                return False
        return True

    async def _told_step(self, step: Step) -> bool:
        self._at, start = step, time.monotonic()
        verdict, data = await self._step(step)
        self._say(step, verdict, time.monotonic() - start, data)
        return verdict.holds

    def _say(self, step: Step, verdict: Verdict, took: float, data: Any = None) -> None:
        self._told.append(
            PlayedStep(
                step=step,
                held=verdict.holds,
                seen=verdict.seen,
                began=time.monotonic() - took - self._began,
                took=took,
                data=data,
                trial=self._trial,
            )
        )
        self.tell(self._told[-1])

    async def _step(self, step: Step) -> tuple[Verdict, Any]:
        from robotree.vr.base.errors import BadName

        deed = step.deed
        if isinstance(deed, Later):
            try:
                words = tuple(filled(word, self._values) for word in deed.words)
                deed = deed_of(Surface(Where.SCRIPT, self.script.readonly), words, deed.text)
            except (SupervisorError, BadName) as error:
                return Verdict(holds=False, seen=str(error)), None
        match deed:
            case Sleep(seconds):
                await asyncio.sleep(seconds)
                return Verdict(holds=True, seen=""), None
            case Expect() as expect:
                return await self._expect(expect), None
            case Let() as let:
                return await self._let(let), None
            case Do(line, may_fail):
                return await self._do(line, may_fail=may_fail)

    async def _let(self, let: Let) -> Verdict:
        """Measure something, and keep it under its name."""
        kind, _, of = let.source.partition(" ")
        if kind == "reading":
            robot, _, reading = of.strip().partition(".")
            instruments = await self._readings(robot)
            if reading not in instruments:
                known = ", ".join(sorted(instruments)) or "nothing"
                return Verdict(holds=False, seen=f"{robot} has no reading {reading}; it has {known}")
            value: Any = instruments[reading]
        else:
            value = inside(self.result, re.findall(r"\w+", let.source)[1:])
            if value is None or isinstance(value, dict | list):
                return Verdict(holds=False, seen=f"the result is {wording.value(self.result)}")
        self._values[let.name] = typed(value)
        return Verdict(holds=True, seen=f"{let.name} is {self._values[let.name]}")

    async def _do(self, line: Line, *, may_fail: bool) -> tuple[Verdict, Any]:
        outcome = await carry_out(self.realm_client, self._placed(line), self.teller)
        if isinstance(outcome, Refusal):
            self.refusal = type(outcome.error).__name__
            return Verdict(may_fail, f"{self.refusal}: {outcome}"), None
        self.refusal = ""
        if line.verb == "call":
            self.result = outcome.data
        return Verdict(holds=True, seen=outcome.text), outcome.data

    def _placed(self, line: Line) -> Line:
        """Find a source beside the script, else in the current folder."""
        if line.verb != "create":
            return line
        path, wanted = values.source(line.text("FILE"))
        found = placed(path, self.script.path)
        return line._replace(values={**line.values, "FILE": f"{found}:{wanted}" if wanted else str(found)})

    async def _expect(self, expect: Expect) -> Verdict:
        end = time.monotonic() + expect.within
        while True:
            verdict = expect.condition.judge(await self._scene(expect))
            if verdict.holds or expect.condition.settled:
                return verdict
            if time.monotonic() >= end:
                return Verdict(holds=False, seen=f"not within {expect.within:g} s: {verdict.seen}")
            await asyncio.sleep(LOOK_AGAIN)

    async def _scene(self, expect: Expect) -> Scene:
        wanted = expect.condition
        members = await self._members(wanted.group) if wanted.group else None
        names = (*wanted.robots, *(members or ()))
        robots = {name: await self._described(name) for name in names}
        return Scene(
            listed=frozenset(one.name for one in self.realm_client.robots()),
            robots={name: robot for name, robot in robots.items() if robot},
            readings={name: await self._readings(name) for name in (*wanted.readings, *(members or ()))},
            groups={} if members is None else {wanted.group: members},
            result=self.result,
            refusal=self.refusal,
        )

    async def _members(self, group: str) -> Sequence[str] | None:
        """Return the members of a group; None: there is no such group, or it cannot be read."""
        from robotree.vr.base.errors import VrError
        from robotree.vr.supervision.groups import members_of

        try:
            found = await members_of(self.realm_client, self.realm_client.groups.find(group))
        except VrError:
            return None
        return [member.name for member in found if member.sure]

    async def _described(self, name: str) -> RobotDescription | None:
        from robotree.vr.base.errors import VrError

        try:
            return await self.realm_client.describe(name)
        except VrError:
            return None

    async def _readings(self, name: str) -> Mapping[str, float]:
        from robotree.vr.base.errors import VrError

        try:
            if any(view.name == name for view in self.realm_client.views()):
                return (await self.realm_client.describe_view(name)).readings
            return await self._robot_readings(name)
        except VrError:
            return {}

    async def _robot_readings(self, name: str) -> Mapping[str, float]:
        """Return what a robot publishes by itself: it is listened to from the first question on."""
        if name not in self._heard:
            self._heard[name] = (await self.realm_client.describe(name)).readings

            def hear(_: str, state: State) -> None:
                self._heard[name] = state.readings

            self._listening.append(await self.realm_client.watch_state(name, hear))
        return self._heard[name]


def placed(source: str, script: str) -> Path:
    """Return where a source file of a script is: beside the script, else in the current folder.

    What somebody else has put into the current folder must not run in the place of what came with the script.
    """
    beside = Path(script).parent / source
    return beside if beside.exists() else Path(source)


def read_file(path: str, *, readonly: bool = False) -> Script:
    """Read a script from a file; `-` is standard input.

    Args:
        path: of the file.
        readonly: whether verbs that change robots are absent.

    Raises:
        BadScript: lines cannot be understood; it has all of them.
        SessionError: the file cannot be read.
    """
    try:
        given = _standard_input() if path == STDIN else text(Path(path), LARGEST)
        return read(given, path, readonly=readonly, exists=lambda source: placed(source, path).exists())
    except OSError as error:
        raise SessionError(f"cannot read the session {path}: {error.strerror}") from None


def _standard_input() -> str:
    try:
        given = sys.stdin.read(LARGEST + 1)
    except UnicodeDecodeError:
        raise OSError(errno.EILSEQ, "it is not UTF-8 text") from None
    if len(given) > LARGEST:
        raise OSError(errno.EFBIG, f"it is larger than {LARGEST // 1000} kB")
    return given


async def play(line: Line, realm: str) -> int:
    """Play a script in a realm and print it as it happens.

    Args:
        line: `run FILE`, understood; with --junit, the report is written as a JUnit file, too.
        realm: in which it is played.

    Returns:
        The exit code: 0 only when everything held.

    Raises:
        BadScript: lines cannot be understood; nothing was played.
        SessionError: the file cannot be read, or the report cannot be written.
        TransportError: the realm cannot be joined.
    """
    from robotree.client.joining import joined

    readonly = only_looking(given=line.flag("--readonly"))
    path, junit_file, as_json = line.text("FILE"), line.text("--junit"), line.flag("--json")
    console = Console(as_json=as_json)

    at = [""]

    def tell(played: PlayedStep) -> None:
        console.settle()
        if played.trial != at[0]:
            at[0] = played.trial
            aside(f"trial {played.trial}")
        aside(transcript(played))

    try:
        script = await asyncio.to_thread(read_file, path, readonly=readonly)
        async with joined(realm) as realm_client:
            report = await Player(realm_client, script, tell, console).play()
    except Exception as error:
        if junit_file:
            write_report(junit_file, junit.of_error(path, error))
        raise
    if junit_file:
        write_report(junit_file, junit.of_report(report))
    if as_json:
        put(json.dumps(report.structure(), ensure_ascii=False))
    else:
        put(f"{'held' if report.ok else 'did NOT hold'}: {path}, {report.wall_s:.1f} s")
    return exit_codes.DONE if report.ok else exit_codes.REFUSED


def write_report(path: str, report: bytes) -> None:
    """Write what a build service reads.

    Raises:
        SessionError: it cannot be written.
    """
    try:
        overwrite(Path(path), report)
    except OSError as error:
        raise SessionError(f"cannot write the report {path}: {error.strerror}") from None
