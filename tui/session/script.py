"""Session scripts: the verbs, one per line, with what is expected after them. Pure.

    # anything after a hash is a comment
    create examples/move_to.py as mover
    enslave mover.arm arm-1
    expect arm-1 enslaved by mover.arm within 2s
    call mover.move x=0.45 y=0 z=0.3 twist=0
    call mover.get_info
    expect result.z > 0.25
    try call arm-1.hold                        # may be refused, the session goes on
    expect refused NotInControl
    sleep 500ms
    look cell before.jpg

Paths of `create` are taken from the folder of the script when they are not there from the current one;
everything else is as on the command line.
"""
# `playing.py` plays what is read here.

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from robotree.tui.errors import BadScript, SupervisorError, ValueRefused
from robotree.tui.line import grammar, values
from robotree.tui.line.action import Where
from robotree.tui.line.grammar import Line
from robotree.tui.line.surface import Surface
from robotree.tui.session.conditions import Condition, condition

EXPECT_WITHIN = 5.0
"""[s] that an expectation may take to come true when the line does not say."""

WORTH_TELLING = 0.5
"""[s] from which on a transcript says how long a step took."""

_WITHIN = re.compile(r"(.*?)(?:\s+within\s+(\S+(?:\s*(?:ms|s|min|h))?))?")


@dataclass(frozen=True, slots=True)
class Do:
    """Carry out a verb."""

    line: Line
    may_fail: bool = False


@dataclass(frozen=True, slots=True)
class Expect:
    """Wait until a condition holds."""

    condition: Condition
    within: float
    """[s] from the moment the step begins."""


@dataclass(frozen=True, slots=True)
class Sleep:
    """Wait."""

    seconds: float


@dataclass(frozen=True, slots=True)
class Step:
    """One line of a script that does something."""

    number: int
    """Line number, from 1."""
    text: str
    deed: Do | Expect | Sleep


@dataclass(frozen=True, slots=True)
class Script:
    """A script, understood as a whole before anything is played."""

    path: str
    steps: tuple[Step, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlayedStep:
    """One step, played."""

    step: Step
    held: bool
    seen: str
    """The result, in one line or more."""
    began: float
    """[s] after the session began."""
    took: float
    """[s]."""
    data: Any = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """A session, played."""

    script: str
    told: tuple[PlayedStep, ...] = ()
    wall_s: float = 0.0
    left: tuple[str, ...] = field(default=())
    """Steps that were not played any more because one before them did not hold."""

    @property
    def ok(self) -> bool:
        """Whether everything was played and held."""
        return not self.left and all(told.held for told in self.told)

    def structure(self) -> dict[str, Any]:
        """Return the report as plain data."""
        steps = [
            {
                "line": told.step.number,
                "text": told.step.text,
                "held": told.held,
                "seen": told.seen,
                "began_s": round(told.began, 3),
                "took_s": round(told.took, 3),
                "data": told.data,
            }
            for told in self.told
        ]
        return {
            "ok": self.ok,
            "script": self.script,
            "wall_s": round(self.wall_s, 3),
            "steps": steps,
            "not_played": list(self.left),
        }


def read(
    text: str, path: str, *, readonly: bool = False, exists: Callable[[str], bool] = lambda _: True
) -> Script:
    """Understand a script.

    Args:
        text: its lines.
        path: for messages.
        readonly: whether verbs that change robots are absent.
        exists: whether a source file that a line names is there.

    Raises:
        BadScript: lines cannot be understood; it has all of them.
    """
    from robotree.vr.base.errors import BadName  # help must not wait for the agents

    surface = Surface(Where.SCRIPT, readonly)
    steps: list[Step] = []
    mistakes: list[tuple[int, str]] = []
    for number, raw in enumerate(text.splitlines(), 1):
        try:
            words = grammar.split(raw)
            if words:
                deed = _deed(surface, words, raw)
                _require_source(deed, exists)
                steps.append(Step(number, raw.strip(), deed))
        except (SupervisorError, BadName) as error:
            mistakes.append((number, str(error)))
    if mistakes:
        raise BadScript(path, mistakes)
    return Script(path, tuple(steps))


def _deed(surface: Surface, words: tuple[str, ...], raw: str) -> Do | Expect | Sleep:
    match words[0]:
        case "expect":
            return _expect(" ".join(words[1:]))
        case "sleep":
            return Sleep(values.duration(" ".join(words[1:])))
        case "try":
            if len(words) == 1:
                raise SupervisorError(f"{raw.strip()!r} names no verb to try")
            return Do(surface.parse(words[1:]), may_fail=True)
        case _:
            return Do(surface.parse(words))


def _require_source(deed: Do | Expect | Sleep, exists: Callable[[str], bool]) -> None:
    """Refuse to create from a file that is not there; `try` may well want to see that fail."""
    if not isinstance(deed, Do) or deed.may_fail or deed.line.verb != "create":
        return
    path, _ = values.source(deed.line.text("FILE"))
    if not exists(path):
        raise ValueRefused("FILE", f"there is no {path}, neither here nor beside the script")


def _expect(text: str) -> Expect:
    found = _WITHIN.fullmatch(text)
    if not found:
        raise SupervisorError(f"expect: cannot read {text!r}")
    within = values.duration(found[2]) if found[2] else EXPECT_WITHIN
    return Expect(condition(found[1]), within)


def transcript(step: PlayedStep) -> str:
    """Return a played step as one line of a transcript, with what was seen below it where that is long."""
    mark = "✓" if step.held else "✗"
    lines = step.seen.splitlines() or [""]
    lead = f"{step.began:7.2f} s  {mark}  {step.step.text}"
    lasted = f"  ({step.took:.1f} s)" if step.took >= WORTH_TELLING else ""
    if len(lines) == 1:
        return f"{lead}  → {lines[0]}{lasted}" if lines[0] else f"{lead}{lasted}"
    lead += lasted
    return "\n".join([lead, *(f"{'':14}{line}" for line in lines)])
