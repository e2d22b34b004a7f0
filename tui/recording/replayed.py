"""What persons asked for in a recording, as a session script that plays it again.

    robotree export session demo.mcap demo.session
    robotree run demo.session --junit demo.xml

The robots that were there at the beginning must be there again; those that were made later are made from
their pages. A command that failed is tried, and must fail in the same way. A command during which something
else was asked for, such as a stop, goes on beside the next lines; how it ends is not judged there.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple, cast

from robotree.tui.recording.tape import RecordedEnd, RecordedLine, RecordedState, Tape
from robotree.tui.seen.wording import typed
from robotree.vr.base.description import RobotDescription
from robotree.vr.base.history_event import HistoryEvent
from robotree.vr.base.principal import is_person

PAUSE = 1.0
"""[s] between two requests from which on the script waits, too."""

COMES = 30.0
"""[s] that the script waits for a robot without a page that came later: its process must be started again."""

SHORT_PAUSE = 0.1
"""[s] the same, while a command goes on beside the lines: where it was interrupted counts."""

LATE = 1.0
"""[s] after the end of a command until which what ended it may be heard."""

SKEW = 0.05
"""[s] by which the clocks of robots may differ before what followed seems to overlap."""

CANCELLED = "CommandCancelled"
"""The error of a command that a stop, or somebody, has ended."""

ANY_ERROR = "?"
"""Stands for an error whose class is not known."""

LONGEST_PAUSE = 10.0
"""[s] that the script waits at most: a person may have drunk coffee."""


class _Asked(NamedTuple):
    """Lines of the script, and when that was asked."""

    unix: float
    lines: tuple[str, ...]
    ended: float
    """[s] since 1970 when it was over."""
    robot: str = ""
    """Whose command it is; empty: it is none."""
    error: str = ""
    """Class of the error with which the command ended."""


def session_of(tape: Tape, mine: Callable[[str], bool]) -> str:
    """Return the script, with a comment above that says where it is from.

    Args:
        tape: the recording. It may come from anybody: nothing that it says becomes a line of its own.
        mine: whether a page, as a description names it, is of who will run the script; robots of other pages
            are expected, for to make them would run somebody else's code as one's own.
    """
    others = [*_shaped(tape, mine), *_stopped(tape)]
    asked = sorted([*others, *_called(tape, sorted(each.unix for each in others))])
    day = time.strftime("%Y-%m-%d %H:%M", time.localtime(tape.began))
    lines = [f"# From the recording {tape.name} of {day}, realm {tape.about.get('realm') or 'default'}."]
    if there := _there(tape):
        lines += ["# These robots must be there:"]
        lines += [f"expect {name} {_bound(robot) or 'listed'}" for name, robot in sorted(there.items())]
        lines += [""]
    lines += _lines(asked)
    if left := _left(lines):
        lines += ["", "# So that it can be played again:", *(f"delete {name}" for name in left)]
    if not asked:
        lines.append("# Nobody asked for anything while it was recorded.")
    return "\n".join(line if line.isprintable() else f"# {line!a}" for line in lines) + "\n"


def _lines(asked: Sequence[_Asked]) -> Iterable[str]:
    """Return the lines of all requests, with pauses; what overlapped does so again."""
    before, beside = 0.0, list[_Asked]()
    for request, following in zip(asked, [*asked, None][1:], strict=True):
        over = [each for each in beside if each.ended <= request.unix]
        beside = [each for each in beside if each.ended > request.unix]
        yield from _idle(over, beside)
        before = max([before, *(each.ended for each in over)])
        pause = request.unix - before
        if before and pause >= (SHORT_PAUSE if beside else PAUSE):
            yield f"sleep {min(pause, LONGEST_PAUSE):.1f}s"
        if not all(part.isprintable() for part in request.lines):
            yield "# What was asked here has no place in a script."
        elif request.robot and (
            request.error == CANCELLED or (following and following.unix < request.ended - SKEW)
        ):
            how = f" It ended with {request.error}." if request.error.isidentifier() else ""
            yield f"# Something else was asked for meanwhile: it goes on beside the next lines.{how}"
            yield f"{request.lines[0].removeprefix('try ')} --detach"
            beside.append(request)
            before = max(before, request.unix)
            continue
        else:
            yield from request.lines
        beside = [each for each in beside if request.lines != (f"try delete {each.robot}",)]
        before = max(before, request.ended)
    yield from _idle(beside, ())


def _idle(over: Iterable[_Asked], beside: Iterable[_Asked]) -> Iterable[str]:
    """Wait for the robots of commands that are over, unless others of theirs go on."""
    for name in dict.fromkeys(each.robot for each in over):
        if name not in {each.robot for each in beside}:
            yield f"expect {name} idle within {COMES:.0f}s"


def _left(lines: Iterable[str]) -> list[str]:
    """Return the robots that a script makes and does not delete, the last one first."""
    made = dict[str, None]()
    for line in lines:
        match line.split():
            case ["create", _, "as", name]:
                made[name] = None
            case ["try", "delete", name]:
                made.pop(name, None)
            case _:
                pass
    return list(reversed(made))


def _there(tape: Tape) -> Mapping[str, RobotDescription]:
    """Return the robots that were there when the recording began, by name."""
    return {robot.name: robot for unix, robot in tape.all_of(RobotDescription) if unix <= tape.began}


def _bound(robot: RobotDescription) -> str:
    bond = robot.bond
    return "" if bond is None else f"enslaved by {bond.parent.name}.{bond.slot}"


def _shaped(tape: Tape, mine: Callable[[str], bool]) -> Iterable[_Asked]:
    """Return how the tree was shaped later: who was made, bound, released and deleted."""
    there, slots = _there(tape), _slots(tape)
    pages = {
        robot.name: robot.page
        for _, robot in tape.all_of(RobotDescription)
        if robot.page and mine(robot.page)
    }
    known = set(there)
    for unix, content in tape.entries:
        if isinstance(content, RecordedEnd):
            known.discard(content.name)
            if content.name in pages:
                yield _Asked(unix, (f"try delete {content.name}",), unix)
        elif (name := _speaker(content)) and name not in known:
            known.add(name)
            made = f"create {_quoted(pages[name])} as {name}" if name in pages else ""
            yield _Asked(unix, (made or f"expect {name} listed within {COMES:.0f}s",), unix)
    parents = {name: robot.bond.parent.name if robot.bond else "" for name, robot in there.items()}
    for unix, name, parent in _leases(tape):
        before, parents[name] = parents.get(name, ""), parent
        if parent and parent != before:
            yield _Asked(unix, (f"enslave {parent}.{slots.get((parent, name), 'SLOT')} {name}",), unix)
        elif before and not parent:
            yield _Asked(unix, (f"try release {before}.{slots.get((before, name), 'SLOT')}",), unix)


def _speaker(content: object) -> str:
    """Return which robot certainly is there, since it says something; empty: none."""
    match content:
        case RecordedLine(name, line) if not line.caller or line.command:
            return name
        case RecordedState(name, _):
            return name
        case _:
            return ""


def _leases(tape: Tape) -> Iterable[tuple[float, str, str]]:
    """Return when each robot got another parent, by its own history; empty: it was free then."""
    for _, event in tape.all_of(HistoryEvent):
        if event.kind == "lease":
            yield event.unix, event.robot, event.parent if event.process else ""


def _slots(tape: Tape) -> Mapping[tuple[str, str], str]:
    """Return which slot of a parent each child has filled, by the names of both."""
    bonds = ((robot.bond, robot.name) for _, robot in tape.all_of(RobotDescription))
    return {(bond.parent.name, name): bond.slot for bond, name in bonds if bond is not None}


def _called(tape: Tape, others: Sequence[float]) -> Iterable[_Asked]:
    """Return the commands that persons asked for, as they ended: by histories, else by logs.

    Args:
        tape: the recording.
        others: [s] since 1970 when something else was asked for, in order: it may have ended a command.
    """
    begun, ended = dict[tuple[str, str], tuple[float, str]](), dict[tuple[str, str], tuple[float, str]]()
    for unix, content in tape.entries:
        match content:
            case HistoryEvent(kind="accepted") if is_person(content.person or content.caller):
                given = _written(content.arguments)
                call = f"call {content.robot}.{content.command} {given}".rstrip()
                begun[content.robot, content.key] = unix, call
            case HistoryEvent(kind="ended"):
                ended[content.robot, content.key] = unix, content.error
            case RecordedLine(robot, line) if line.level == "asked" and is_person(line.caller):
                call = f"call {robot}.{line.command} {line.arguments}".rstrip()
                begun.setdefault((robot, line.key), (unix, call))
            case RecordedLine(robot, line) if line.level in {"done", "failed", "cancelled"}:
                error = {"done": "", "cancelled": CANCELLED}.get(line.level, ANY_ERROR)
                ended.setdefault((robot, line.key), (unix, error))
            case _:
                pass
    for key, (unix, call) in begun.items():
        end, error = ended.get(key, (unix, ""))
        if error == CANCELLED:
            why = next((at for at in others if unix <= at <= end + LATE), None)
            if why is None:
                why = end
                yield _Asked(end, (f"try cancel {key[0]}",), end)
            end = max(end, why + SKEW)  # what ended it comes before its end
        refused = f"try {call}", f"expect refused {error.removeprefix(ANY_ERROR)}".rstrip()
        yield _Asked(unix, refused if error else (call,), end, key[0], error)


def _stopped(tape: Tape) -> Iterable[_Asked]:
    """Return the protective stops that persons asked for, and the resumes: of all robots as one line each."""
    there, stopped = set[str](), set[str]()
    changes: list[tuple[float, str, set[str], int, int]] = []
    for unix, content in tape.entries:
        match content:
            case RecordedState(name, state):
                there.add(name)
                if state.stopped == (name in stopped):
                    continue
                stopped ^= {name}
                verb = "stop" if state.stopped else "try resume"
                if state.stopped and not is_person(state.stop_reason.partition("'")[0]):
                    continue
                if changes and changes[-1][1] == verb and unix - changes[-1][0] < LATE:
                    began, _, names, *_ = changes.pop()
                else:
                    began, names = unix, set[str]()
                changes.append((began, verb, {*names, name}, len(stopped), len(there)))
            case RecordedEnd(name):
                there.discard(name)
                stopped.discard(name)
            case _:
                pass
    for unix, verb, names, still, present in changes:
        if len(names) > 1 and still == (present if verb == "stop" else 0):
            yield _Asked(unix, (verb,), unix)
        else:
            yield from (_Asked(unix, (f"{verb} {name}",), unix) for name in sorted(names))


def _written(arguments: Any) -> str:
    given = cast("dict[str, Any]", arguments) if isinstance(arguments, dict) else {}
    return " ".join(f"{name}={_quoted(value)}" for name, value in given.items())


def _quoted(value: Any) -> str:
    """Write a value as one word of a line."""
    text = typed(value)
    return text if text and not set(text) & set(" #'\"") else "'" + text.replace("'", "'\\''") + "'"
