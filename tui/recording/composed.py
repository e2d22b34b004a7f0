"""The verb `compose`: a virtual robot out of steps, of a recording, or of a session script.

robotree compose cup --from cup.mcap
robotree compose cup --from cup.steps
robotree compose cup --from cup.session
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from robotree.files import text
from robotree.tui.composing.demonstration import TOLERANCE, Shown, composed
from robotree.tui.composing.gathering import Felt, Gathered, gathered, shown_robot
from robotree.tui.composing.lines import LARGEST, number_of, read_lines
from robotree.tui.composing.steps import Composition
from robotree.tui.composing.writing import (
    STEPS,
    KnownRobots,
    Prepared,
    Tried,
    prepared,
    refuse_present,
    tried,
    write,
)
from robotree.tui.errors import BadComposition, ValueRefused
from robotree.tui.line.grammar import Line
from robotree.tui.line.verbs import Outcome, Teller, plain
from robotree.tui.recording.exports import opened
from robotree.tui.recording.tape import RecordedState, Tape
from robotree.tui.session.playing import read_file
from robotree.tui.session.script import Do
from robotree.vr.base.arguments import check_argument, check_arguments
from robotree.vr.base.description import FieldSpec, RobotDescription
from robotree.vr.base.errors import VrError
from robotree.vr.base.history_event import HistoryEvent

if TYPE_CHECKING:
    from robotree.vr.supervision.realm_client import RealmClient

WAY = FieldSpec(name="LENGTH", type="float", unit="m", lower=0.0, upper=0.2)
"""Of `--tolerance`."""
LATE = 0.3
"""[s] that readings may be old when they are recorded."""


async def compose(realm_client: RealmClient | None, line: Line, teller: Teller) -> Outcome:
    """Make a page, its panel and its test, out of a file.

    Args:
        realm_client: of a realm whose robots may be composed, too; None: there is none.
        line: understood.
        teller: hears what happens.

    Raises:
        BadComposition: there is nothing in the file that can be meant.
        BadRecordedRealm: it is a recording that cannot be read.
        FileExistsError: one of the files is there, and `--force` was not given.
        ValueRefused: a value of the line cannot be meant.
    """
    name, source = line.text("NAME").replace("-", "_"), line.text("--from")
    if not source:
        raise ValueRefused("--from", "say what it is made of: a FILE.mcap, a FILE.session or a FILE.steps")
    living = [] if realm_client is None else list(await realm_client.tree())
    made, robots = await asyncio.to_thread(_composition, line, name, source, living, teller)
    made = msgspec.structs.replace(made, name=name)
    origin = f"Made by `robotree compose {name} --from {Path(source).name}`."
    try:
        ready = await asyncio.to_thread(prepared, made, robots, origin)
    except BadComposition as error:
        number = number_of(_text(source), error.step) if error.step and source.endswith(STEPS) else 0
        raise BadComposition(f"{source}{f', line {number}' * (number > 0)}: {error}") from None
    if _is_own(source, name):  # the steps stay as they are written
        files = {file: text for file, text in ready.files.items() if file != f"{name}{STEPS}"}
        ready = msgspec.structs.replace(ready, files=files)
    went = None
    if not line.flag("--force"):  # before the trial, which takes some seconds
        await asyncio.to_thread(refuse_present, ready, Path())
    if not line.flag("--untried"):
        teller.warn("it is tried in a twin of the cell, where nothing real moves: this takes some seconds …")
        went = await asyncio.to_thread(tried, ready)
        if not went.ok:
            raise BadComposition(f"nothing was written: {went.told}; --untried writes it nevertheless")
    there = await asyncio.to_thread(write, ready, Path(), replace=line.flag("--force"))
    return outcome_of(ready, went, there, living)


def _is_own(source: str, name: str) -> bool:
    """Whether something is made of the very steps that would be written."""
    return os.path.realpath(source) == os.path.realpath(f"{name}{STEPS}")


def outcome_of(
    ready: Prepared, went: Tried | None, files: Iterable[str], living: Iterable[RobotDescription] = ()
) -> Outcome:
    """Return what is told of a composition that was written.

    Args:
        ready: it.
        went: how it went in a twin; None: it was not tried.
        files: that were written.
        living: robots that may be put below it.
    """
    made, files = ready.checked.composition, list(files)
    names = {kind: robot.name for robot in living for kind in robot.kinds}
    then = [f"robotree create {ready.page} as {made.name}"]
    then += [f"robotree enslave {made.name}.{slot} {names.get(kind, 'ROBOT')}" for slot, kind in made.slots]
    changed = next((f" {key}={value}" for key, value in made.parameters), "")
    then += [f"robotree call {made.name}.{made.command}{changed}"]
    rows = [f"made {', '.join(files)}; the page has {ready.lines} lines"]
    rows += [went.told] if went else ["it was not tried"]
    rows += ["", "next:", *(f"  {one}" for one in then)]
    data = {
        "files": files, "lines": ready.lines, "parameters": dict(made.parameters), "next": then,
        "tried": None if went is None else plain(went),
    }  # fmt: skip
    return Outcome(data, "\n".join(rows))


def _composition(
    line: Line, name: str, source: str, living: list[RobotDescription], teller: Teller
) -> tuple[Composition, KnownRobots]:
    """Return what a file says, and the robots that are known."""
    if source.endswith(".mcap"):
        tape = opened(source)
        described = {robot.name: robot for robot in living} | tape.described()
        wanted = [name for name in line.text("--of").split(",") if name]
        if unknown := [name for name in wanted if name not in described]:
            there = ", ".join(sorted(described)) or "no robot"
            raise ValueRefused("--of", f"{unknown[0]} is not in {source}; there is {there}")
        shown = shown_in(tape, described, wanted)
    elif source.endswith(".session"):
        described = {robot.name: robot for robot in living}
        shown = _asked_in(source, described)
    else:
        text = _text(source)
        return read_lines(text, source), KnownRobots.of(living)
    if shown.failed:
        teller.warn(f"{shown.failed} commands that did not end well are left out")
    made = composed(name, shown.robots, shown.shown, _tolerance(line), shown.starts)
    return made, KnownRobots.of(described.values())


def _tolerance(line: Line) -> float:
    text = line.text("--tolerance")
    if not text:
        return TOLERANCE
    try:
        return float(check_argument(WAY, text, command="compose"))
    except VrError as error:
        raise ValueRefused("--tolerance", str(error)) from None


def _text(source: str) -> str:
    try:
        return text(Path(source), 4 * LARGEST)
    except FileNotFoundError:
        raise
    except OSError as error:  # a recording of another name, or a device without an end
        raise BadComposition(f"{source}: {error.strerror}; a recording ends with .mcap") from None


def shown_in(tape: Tape, described: Mapping[str, RobotDescription], wanted: Iterable[str]) -> Gathered:
    """Return what was shown in a recording.

    Args:
        tape: the recording.
        described: robots, by name.
        wanted: what these robots did, whoever asked; empty: what persons asked of any robot.
    """
    events = [event for _, event in tape.all_of(HistoryEvent)]
    starts: dict[str, Mapping[str, float]] = {}
    felt: list[Felt] = []
    for at, (name, state) in tape.all_of(RecordedState):
        if state.readings:
            starts.setdefault(name, state.readings)
            felt.append(Felt(name, at, state.readings, LATE))
    return gathered(events, described, tuple(wanted), starts, felt)


def _asked_in(source: str, described: Mapping[str, RobotDescription]) -> Gathered:
    """Return what a session script asks of robots, step by step."""
    shown: list[Shown] = []
    for step in read_file(source).steps:
        if isinstance(step.deed, Do) and step.deed.line.verb == "call":
            robot, _, command = step.deed.line.text("ROBOT.COMMAND").rpartition(".")
            spec = described[robot].command(command) if robot in described else None
            if spec is None:
                raise BadComposition(
                    f"{source}, line {step.number}: {robot} is not here with a command {command}; start it,"
                    " and compose again"
                )
            given = dict(each.split("=", 1) for each in step.deed.line.many("PARAMETER=VALUE"))
            shown.append(Shown(robot, command, check_arguments(spec, given)))
    robots = {one.robot: described[one.robot] for one in shown}
    return Gathered(tuple(map(shown_robot, robots.values())), tuple(shown), {})
