"""Plays session scripts against a realm client: waits, looks, acts, and reports each step as it happens."""

from __future__ import annotations

import asyncio
import errno
import json
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robotree.files import overwrite, text
from robotree.tui import exit_codes
from robotree.tui.errors import SessionError
from robotree.tui.line import values
from robotree.tui.line.carrying import Refusal, Silent, carry_out
from robotree.tui.line.grammar import Line
from robotree.tui.line.shell import Console
from robotree.tui.line.verbs import Teller
from robotree.tui.session import junit
from robotree.tui.session.conditions import Scene, Verdict
from robotree.tui.session.script import Do, Expect, PlayedStep, Report, Script, Sleep, Step, read, transcript
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
        self.realm_client, self.script, self.tell, self.teller = (
            realm_client,
            script,
            tell,
            teller or Silent(),
        )
        self.result: Any = None
        self.refusal = ""
        self._heard: dict[str, Mapping[str, float]] = {}
        self._listening: list[Registration] = []

    async def play(self) -> Report:
        """Play until the end or until a step does not hold."""
        try:
            # a resume ends the stops that are known here when its step begins
            self._listening.append(await self.realm_client.watch_state(None))
            return await self._play()
        finally:
            for listening in self._listening:
                await listening.close()
            self._listening.clear()
            self._heard.clear()

    async def _play(self) -> Report:
        began = time.monotonic()
        steps: list[PlayedStep] = []
        for position, step in enumerate(self.script.steps):
            start = time.monotonic()
            verdict, data = await self._step(step)
            now = time.monotonic()
            steps.append(
                PlayedStep(
                    step=step,
                    held=verdict.holds,
                    seen=verdict.seen,
                    began=start - began,
                    took=now - start,
                    data=data,
                )
            )
            self.tell(steps[-1])
            if not verdict.holds:
                left = tuple(one.text for one in self.script.steps[position + 1 :])
                return self._report(steps, began, left)
        return self._report(steps, began, ())

    def _report(self, steps: list[PlayedStep], began: float, left: tuple[str, ...]) -> Report:
        wall = time.monotonic() - began
        return Report(script=self.script.path, told=tuple(steps), wall_s=wall, left=left)

    async def _step(self, step: Step) -> tuple[Verdict, Any]:
        match step.deed:
            case Sleep(seconds):
                await asyncio.sleep(seconds)
                return Verdict(holds=True, seen=""), None
            case Expect() as expect:
                return await self._expect(expect), None
            case Do(line, may_fail):
                return await self._do(line, may_fail=may_fail)

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


async def play_file(line: Line, realm: str, *, readonly: bool = False) -> int:
    """Play a script in a realm and print it as it happens.

    Args:
        line: `run FILE`, understood; with --junit, the report is written as a JUnit file, too.
        realm: in which it is played.
        readonly: whether verbs that change robots are absent.

    Returns:
        The exit code: 0 only when everything held.

    Raises:
        BadScript: lines cannot be understood; nothing was played.
        SessionError: the file cannot be read, or the report cannot be written.
        TransportError: the realm cannot be joined.
    """
    from robotree.client.joining import joined

    path, junit_file, as_json = line.text("FILE"), line.text("--junit"), line.flag("--json")
    console = Console(as_json=as_json)

    def tell(played: PlayedStep) -> None:
        console.settle()
        aside(transcript(played))

    try:
        script = await asyncio.to_thread(read_file, path, readonly=readonly)
        async with joined(realm) as realm_client:
            report = await Player(realm_client, script, tell, console).play()
    except Exception as error:
        if junit_file:
            _write(junit_file, junit.of_error(path, error))
        raise
    if junit_file:
        _write(junit_file, junit.of_report(report))
    if as_json:
        put(json.dumps(report.structure(), ensure_ascii=False))
    else:
        put(f"{'held' if report.ok else 'did NOT hold'}: {path}, {report.wall_s:.1f} s")
    return exit_codes.DONE if report.ok else exit_codes.REFUSED


def _write(path: str, report: bytes) -> None:
    try:
        overwrite(Path(path), report)
    except OSError as error:
        raise SessionError(f"cannot write the report {path}: {error.strerror}") from None
