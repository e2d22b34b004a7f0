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
    delete mover

Values can have names, lines can be repeated, have a limit together, and be for the case that a step fails:

    table                                      # each row is a run of its own
        x   z
        0.3   0.35
        0.45  0.3
    end
    let twist = 0
    trial there and back                       # a name; lines before the first trial belong to each
    within 30s                                 # the lines up to `end` are over by then
        repeat 2                               # $round is 1, then 2
            call arm-1.go_to x=$x y=0 z=$z twist=$twist
            let reached = reading arm-1.z      # measured when the line is reached; or `result.z`
            expect reading arm-1.z >= $reached
        end
    end
    on failure                                 # played when a step did not hold
        look cell failed.jpg
    end
    finally                                    # played in any case, each of its lines
        try resume
    end

A value takes the place of `$NAME` or `${NAME}` in one word, and never adds words; `$$` is a dollar sign.
`robotree test FOLDER` plays trials as a test suite.

Paths of `create` are taken from the folder of the script when they are not there from the current one;
everything else is as on the command line.
"""
# `blocks.py` reads what has an end; `playing.py` plays what is read here.

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from robotree.tui.errors import BadLine, BadScript, NotHere, SupervisorError, UnknownVerb, ValueRefused
from robotree.tui.line import values
from robotree.tui.line.action import Where
from robotree.tui.line.grammar import Line
from robotree.tui.line.surface import Surface
from robotree.tui.session import blocks
from robotree.tui.session.blocks import Lines, Part, RawLine
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
class Let:
    """Give what is measured now a name."""

    name: str
    source: str
    """`result.z`, or `reading ROBOT.READING`."""


@dataclass(frozen=True, slots=True)
class Later:
    """A line with values that are only known when it is reached; `deed_of` understands it then."""

    words: tuple[str, ...]
    text: str


Deed = Do | Expect | Sleep | Let | Later


@dataclass(frozen=True, slots=True)
class Step:
    """One line of a script that does something."""

    number: int
    """Line number, from 1."""
    text: str
    deed: Deed


@dataclass(frozen=True, slots=True)
class Block:
    """Lines that are repeated, or over within a time together."""

    number: int
    text: str
    body: tuple[Step | Block, ...]
    rounds: int = 1
    within: float | None = None
    """[s]; None: they may take as long as they take."""


Node = Step | Block


@dataclass(frozen=True, slots=True)
class Trial:
    """What is played as one run: a script, one of its trials, or one of these with one row of a table."""

    name: str
    """As `robotree test` names it behind `::`, such as `lift[0.3-0.35]`; empty: the script as a whole."""
    nodes: tuple[Node, ...]
    on_failure: tuple[Node, ...] = ()
    """Played when a step did not hold."""
    at_end: tuple[Node, ...] = ()
    """Played in any case."""


@dataclass(frozen=True, slots=True)
class Script:
    """A script, understood as a whole before anything is played."""

    path: str
    trials: tuple[Trial, ...]
    readonly: bool = False

    @property
    def steps(self) -> tuple[Step, ...]:
        """The lines that do something, in the order of the file, without those for a failure."""
        return tuple(flat(node for trial in self.trials for node in (*trial.nodes, *trial.at_end)))


def flat(nodes: Iterable[Node]) -> Iterator[Step]:
    """Return the steps of blocks, and of blocks in them, each once."""
    for node in nodes:
        if isinstance(node, Step):
            yield node
        else:
            yield from flat(node.body)


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
    trial: str = ""
    """Name of the trial whose step it is; empty: the script is one."""


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
        return not self.left and self.failed is None

    @property
    def failed(self) -> PlayedStep | None:
        """The first step that did not hold."""
        return next((told for told in self.told if not told.held), None)

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
                **({"trial": told.trial} if told.trial else {}),
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
    reading = _Reading(Surface(Where.SCRIPT, readonly), exists)
    lines = blocks.of_text(text, reading.complain)
    trials = [trial for part in lines.parts or (Part("", 0),) for trial in reading.trials(lines, part)]
    if reading.mistakes:
        raise BadScript(path, sorted(reading.mistakes))
    return Script(path, tuple(trials), readonly)


class _Reading:
    """Understands the lines of one script, with the values of names as they are where a line stands."""

    def __init__(self, surface: Surface, exists: Callable[[str], bool]) -> None:
        self._surface, self._exists = surface, exists
        self.mistakes: list[tuple[int, str]] = []
        self._names: dict[str, str | None] = {}
        """The values of names; None: it is measured when the script is played."""

    def complain(self, number: int, reason: str) -> None:
        if (number, reason) not in self.mistakes:  # each row reads the lines again
            self.mistakes.append((number, reason))

    def trials(self, lines: Lines, part: Part) -> Iterator[Trial]:
        """Return the runs of one trial: one for each row, of each of its tables."""
        tables = [*lines.common.tables, *part.tables]
        for rows in itertools.product(*(table.rows for table in tables)):
            self._names = {
                name: value
                for table, row in zip(tables, rows, strict=True)
                for name, value in zip(table.names, row, strict=True)
            }
            label = "-".join(value for row in rows for value in row)
            name = f"{part.name}[{label}]" if tables else part.name
            yield Trial(
                name,
                nodes=self._nodes((*lines.common.lines, *part.lines)),
                on_failure=self._nodes((*part.on_failure, *lines.common.on_failure)),
                at_end=self._nodes((*part.at_end, *lines.common.at_end)),
            )

    def _nodes(self, raw: Sequence[RawLine]) -> tuple[Node, ...]:
        return tuple(node for each in raw if (node := self._node(each)) is not None)

    def _node(self, raw: RawLine) -> Node | None:
        from robotree.vr.base.errors import BadName  # help must not wait for the agents

        try:
            match raw.words:
                case ("repeat", *rest):
                    rounds = _rounds(self._known(rest))
                    self._names["round"] = None
                    return Block(raw.number, raw.text, self._nodes(raw.body), rounds=rounds)
                case ("within", *rest):
                    seconds = values.duration(" ".join(self._known(rest)))
                    return Block(raw.number, raw.text, self._nodes(raw.body), within=seconds)
                case ("let", *rest):
                    return self._let(raw, rest)
                case words:
                    return Step(raw.number, raw.text, self._deed(words, raw.text))
        except (SupervisorError, BadName) as error:
            self.complain(raw.number, str(error))
            return None

    def _known(self, words: Sequence[str]) -> list[str]:
        """Put values in the place of names, where they must be known before anything is played."""
        known = {name: value for name, value in self._names.items() if value is not None}
        return [filled(word, known) for word in words]

    def _let(self, raw: RawLine, words: Sequence[str]) -> Step | None:
        if len(words) < 3 or words[1] != "=" or not blocks.NAME.fullmatch(words[0]):
            raise SupervisorError(f"cannot read {raw.text!r}; write let NAME = VALUE")
        name, source = words[0], " ".join(words[2:])
        if _MEASURED.fullmatch(source):
            self._names[name] = None
            return Step(raw.number, raw.text, Let(name, source))
        self._names[name] = " ".join(self._known(words[2:]))
        return None

    def _deed(self, words: tuple[str, ...], text: str) -> Deed:
        measured = {name for name, value in self._names.items() if value is None}
        if not any(measured & names_in(word) for word in words):
            deed = deed_of(self._surface, tuple(self._known(words)), text)
            _require_source(deed, self._exists)
            return deed
        known = {name: value for name, value in self._names.items() if value is not None}
        later = tuple(
            filled(word, {**known, **{name: f"${{{name}}}" for name in measured}}) for word in words
        )
        _try_with_a_number(self._surface, later, measured, text)
        return Later(later, text)


def _try_with_a_number(surface: Surface, words: Sequence[str], measured: Iterable[str], text: str) -> None:
    """Refuse a line that cannot be one, whatever is measured; the value itself may be of any kind."""
    from robotree.vr.base.errors import BadName

    number = dict.fromkeys(measured, "1")
    try:
        deed_of(surface, tuple(filled(word, number) for word in words), text)
    except (UnknownVerb, BadLine, NotHere):
        raise
    except (SupervisorError, BadName):
        pass  # with a value that fits it may be one


_MEASURED = re.compile(r"result(?:\.\w+|\[\d+])*|reading\s+\S+\.\S+")
_NAMED = re.compile(r"\$(?:(\$)|\{(\w+)}|([A-Za-z_]\w*))")

MOST_ROUNDS = 100_000
"""Of one `repeat`."""


def _rounds(words: Sequence[str]) -> int:
    refusal = f"is no number of rounds, from 1 to {MOST_ROUNDS}"
    return values.whole("repeat", " ".join(words), 1, MOST_ROUNDS, refusal)


def names_in(word: str) -> set[str]:
    """Return the names whose values a word wants."""
    return {found[2] or found[3] for found in _NAMED.finditer(word) if not found[1]}


def filled(word: str, known: Mapping[str, str]) -> str:
    """Put values in the place of names; a value is text, and never more than this one word.

    Raises:
        ValueRefused: a name has no value here.
    """

    def value(found: re.Match[str]) -> str:
        if found[1]:
            return "$"
        name = found[2] or found[3]
        if name not in known:
            has = ", ".join(f"${each}" for each in sorted(known)) or "none"
            raise ValueRefused(
                f"${name}", f"${name} has no value here; known are: {has}; `$$` is a dollar sign"
            )
        return known[name]

    return _NAMED.sub(value, word)


def deed_of(surface: Surface, words: tuple[str, ...], text: str) -> Do | Expect | Sleep:
    """Understand the words of a line that does something.

    Raises:
        SupervisorError: they mean nothing, or a value cannot be meant.
        BadName: a name cannot be one.
    """
    match words[0]:
        case "expect":
            return _expect(" ".join(words[1:]))
        case "sleep":
            return Sleep(values.duration(" ".join(words[1:])))
        case "try":
            if len(words) == 1:
                raise SupervisorError(f"{text!r} names no verb to try")
            return Do(surface.parse(words[1:]), may_fail=True)
        case _:
            return Do(surface.parse(words))


def _require_source(deed: Deed, exists: Callable[[str], bool]) -> None:
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
