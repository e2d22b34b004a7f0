"""Scripts tried out without any robot: a table of happenings and of the orders that must follow. No threads.

    script: guide.yaml
    tests:
      - test: a visitor is greeted
        parameters: {welcome: Hello}
        missing: []                       # partners that are not there
        roles: {robot: child}             # which they play at the beginning
        steps:
          - when: person_seen Anna kitchen
            then:
              - do robot wave
              - do robot say text="Hello, Anna"
          - when: done robot say as Anna
            then: do robot go_to place=kitchen
            facts: {visitor: {id: Anna, stage: guided}}

A happening in one line: `MESSAGE value …`, `done PARTNER ACT result …`, `failed PARTNER ACT reason`,
`progress PARTNER ACT share`, `timer NAME`, `lost PARTNER`, `found PARTNER ROBOT`, `stopped PARTNER`,
`released PARTNER`, `role PARTNER ROLE`, `reading PARTNER NAME VALUE`, `start`; at its end `as CONVERSATION`
and `from NAME`.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import msgspec

from robotree.vr.base.errors import BrokenScript
from robotree.vr.base.written import (
    Entries,
    Mark,
    Scalar,
    Word,
    Written,
    entries,
    items,
    read,
    value_of,
    word,
)
from robotree.vr.scripts.engine import Engine, ScriptError
from robotree.vr.scripts.explain import in_words, parts
from robotree.vr.scripts.expression import show
from robotree.vr.scripts.happening import Happening, ScriptEnd, nearest, order_line
from robotree.vr.scripts.program import CHOICE, Program
from robotree.vr.scripts.when_then import new_fact

HAPPENINGS = (
    "start", "finish", "done", "failed", "progress", "timer", "lost", "found", "stopped", "released",
    "role", "reading", "answered",
)  # fmt: skip
"""The first words of a line, beside the messages of the script."""
CHANGES = frozenset({"lost", "found", "stopped", "released"})
"""Of these, what happens to a partner."""
ENDED = "the script has ended: no rule fires any more; begin again with a new dry run or test"


class Step(msgspec.Struct, frozen=True, kw_only=True):
    """One happening, and what must follow."""

    when: str
    then: tuple[str, ...] | None
    """Orders, as `order_line` writes them; None: whatever follows."""
    facts: tuple[str, ...] = ()
    mark: Mark = Mark()


class Trial(msgspec.Struct, frozen=True, kw_only=True):
    """One test."""

    name: str
    steps: tuple[Step, ...]
    parameters: dict[str, Scalar] = {}
    missing: tuple[str, ...] = ()
    roles: dict[str, str] = {}
    """Which partners play at the beginning."""
    mark: Mark = Mark()


class Played(msgspec.Struct, frozen=True, kw_only=True):
    """One step as it went."""

    when: str
    orders: tuple[str, ...]
    fired: tuple[str, ...]
    opening: bool = False
    """It belongs to the beginning of every script."""
    fault: str = ""
    """The fault; empty: none."""
    mark: Mark = Mark()


def read_table(source: str, path: str) -> tuple[str, tuple[Trial, ...]]:
    """Read a table of tests.

    Returns:
        Path of the script, as written; and the tests.

    Raises:
        BrokenScript: it cannot be read, and where.
    """
    root = read(source, path)
    if not isinstance(root, Entries):
        raise root.mark.error("a table is written as `script: FILE` and `tests:`")
    root.expect(("script", "tests"), "a table")
    tests = tuple(_trial(one) for one in items(root.get("tests"), root.mark).items)
    if not tests:
        raise root.mark.error("there are no tests")
    return word(root.get("script"), "`script: FILE`", root.mark).text, tests


def _trial(given: Written) -> Trial:
    test = entries(given, "a test", given.mark)
    test.expect(("test", "parameters", "missing", "roles", "steps"), "a test")
    mark = test.mark
    return Trial(
        name=word(test.get("test"), "`test: NAME`", mark).text,
        parameters=test.named_values("parameters", "a value"),
        missing=test.texts("missing", "a partner"),
        roles=test.named_texts("roles", "a role"),
        steps=tuple(_step(one) for one in items(test.get("steps"), mark).items),
        mark=mark,
    )


def _step(given: Written) -> Step:
    step = entries(given, "a step", given.mark)
    step.expect(("when", "then", "facts"), "a step")
    then = step.get("then")
    nothing = isinstance(then, Word) and then.text == "nothing"
    lines = () if nothing else step.texts("then", "an order")
    return Step(
        when=word(step.get("when"), "`when: …`", given.mark).text,
        then=None if then is None else lines,
        facts=tuple(_wanted_fact(one) for one in items(step.get("facts"), given.mark).items),
        mark=given.mark,
    )


def _wanted_fact(given: Written) -> str:
    """Return a fact as CLIPS writes it, also of one that is written as `NAME: {slot: value}`."""
    text = given.text if isinstance(given, Word) else show(new_fact(given, "a fact"))
    try:
        parts(text)
    except (BrokenScript, ValueError):
        raise given.mark.error("a fact is written as `NAME: {slot: value}`") from None
    return text


def happening(line: str, mark: Mark = Mark()) -> Happening:  # noqa: B008, PLR0911 # frozen; one each
    """Read a happening from one line.

    Raises:
        BrokenScript: it is none.
    """
    words, conversation, sender = _words(line, mark)
    head, *rest = words
    values = tuple(value_of(Word(one, mark)) for one in rest)
    least = {"done": 2, "failed": 2, "progress": 3, "timer": 1, "role": 2, "reading": 3, "answered": 1}.get(
        head, 1 if head in CHANGES else 0
    )
    if len(rest) < least:
        raise mark.error(f"{head} needs {least} values: {line}")
    told = Happening(act=head, sender=sender, arguments=values, conversation=conversation)
    change = partial(msgspec.structs.replace, told)
    match head:
        case "done" | "progress" | "role" | "reading":
            return change(sender=rest[0], arguments=values[1:])
        case "reading" if isinstance(values[-1], str | bool):
            raise mark.error(f"a reading is a number, not {values[-1]!r}: {line}")
        case "answered":
            return change(sender="operator", arguments=(rest[0], sender))
        case "failed":
            reason = values[2:] or ("it failed",)
            return change(performative="failure", act=rest[1], sender=rest[0], arguments=reason)
        case "lost":
            return change(sender=rest[0], partner=rest[0], arguments=(*values, "it was lost")[:2])
        case "found" | "released":
            return change(sender=rest[0], partner=rest[0], robot=rest[-1], arguments=values[-1:])
        case "stopped":
            reason = (*values, "it was stopped")[:2]
            return change(sender=rest[0], partner=rest[0], robot=rest[0], arguments=reason)
        case _:
            return change(sender="script") if head in {"timer", "start"} else told


def words_of(line: str, mark: Mark) -> list[str]:
    """Return the words of a line.

    Raises:
        BrokenScript: a quote is not closed.
    """
    try:
        return shlex.split(line)
    except ValueError:
        raise mark.error(f"a quote is not closed: {line}") from None


def _words(line: str, mark: Mark) -> tuple[list[str], str, str]:
    """Return the words of a line without its end, and the conversation and sender of its end."""
    words = words_of(line, mark)
    said = {"as": "none", "from": "operator"}
    while len(words) > 2 and words[-2] in said:
        said[words[-2]] = words[-1]
        del words[-2:]
    if not words:
        raise mark.error("a happening is missing")
    return words, said["as"], said["from"]


class Rehearsal:
    """A script at work without robots: all partners are there but those that are said to be missing."""

    def __init__(
        self,
        program: Program,
        parameters: Mapping[str, Scalar] | None = None,
        missing: Sequence[str] = (),
        roles: Mapping[str, str] | None = None,
        choices: Mapping[str, Sequence[tuple[str, str]]] | None = None,
    ) -> None:
        """Begin as `start` does.

        Args:
            program: the script.
            parameters: those that differ from their defaults.
            missing: partners that are not there.
            roles: which partners play.
            choices: arguments and the values that they take, by kind of robot.

        Raises:
            ScriptError: the rules cannot be built, or fail at the beginning.
        """
        self.program = program
        self.engine = Engine(program, parameters)
        self.opening: list[Played] = []
        self._choices = choices or {}
        self._ended = False
        for partner in program.partners:
            if partner.name not in missing:
                self._open(f"found {partner.name}")
        for name, role in (roles or {}).items():
            self.engine.role(name, role)
        self._open("start")

    def _found(self, name: str) -> None:
        """Tell what the commands of a partner take."""
        for partner in self.program.partners if self.program.wanted(CHOICE) else ():
            if name in {partner.name, *partner.slots}:
                also = ((argument, one) for argument, values in partner.takes.items() for one in values)
                for argument, value in (*self._choices.get(partner.kind, ()), *also):
                    self.engine.choice(name, argument, value)

    def _open(self, line: str) -> None:
        played = self._played(happening(line), line, Mark())
        self.opening.append(msgspec.structs.replace(played, opening=True))

    def play(self, line: str, mark: Mark = Mark()) -> Played:  # noqa: B008 # frozen
        """Tell the rules one happening.

        Raises:
            BrokenScript: the line is none, or the script does not know the message.
        """
        told = happening(line, mark)
        if self._ended:
            return Played(when=line, orders=(), fired=(), fault=ENDED, mark=mark)
        heard = next((hear for hear in self.program.hears if hear.name == told.act), None)
        special = line.split(maxsplit=1)[0] in HAPPENINGS
        if heard is None and not special and not _wanted(self.program, told.act):
            hears = [hear.name for hear in self.program.hears]
            meant = nearest(told.act, [*hears, *HAPPENINGS])
            raise mark.error(
                f"the script does not hear {told.act!r}{meant}; it hears: {', '.join(hears) or 'nothing'}"
            )
        if heard is not None and told.performative == "inform" and len(told.arguments) != len(heard.parts):
            takes = ", ".join(name for name, _ in heard.parts) or "none"
            needs = f"{heard.name} needs {len(heard.parts)} value(s) ({takes})"
            raise mark.error(
                f"{needs}, and {len(told.arguments)} stand here; put a text of several words in quotes"
            )
        return self._played(told, line, mark)

    def _played(self, told: Happening, line: str, mark: Mark) -> Played:
        before = self.engine.happened + 1
        fault = ""
        orders: tuple[str, ...] = ()
        if told.act == "role":
            self.engine.role(told.sender, str(told.arguments[0]))
        if told.act == "found":
            self._found(told.partner)
        if told.act == "reading":
            self.engine.reading(told.sender, str(told.arguments[0]), float(told.arguments[1]))
        try:
            given = self.engine.feed(told)
            self._ended = self._ended or any(isinstance(order, ScriptEnd) for order in given)
            orders = tuple(map(order_line, given))
        except ScriptError as error:
            fault = str(error)
        fired = tuple(firing.rule for firing in self.engine.firings if firing.number == before)
        return Played(when=line, orders=orders, fired=fired, fault=fault, mark=mark)


def _wanted(program: Program, act: str) -> bool:
    """Whether a rule looks for this message, or for any."""
    texts = [rule.clips for rule in program.rules]
    return any(f"(act {act})" in text or "(act ?" in text for text in texts) or any(
        "(msg" in text and "(act" not in text for text in texts
    )


def run(
    program: Program, trial: Trial, choices: Mapping[str, Sequence[tuple[str, str]]] | None = None
) -> Iterator[Played]:
    """Play a test; its first step with a fault is the last one.

    Raises:
        BrokenScript: a line of it cannot be read.
        ScriptError: the rules cannot be built.
    """
    known = [partner.name for partner in program.partners]
    known += [parameter.name for parameter in program.parameters]
    for name in (*trial.missing, *trial.parameters, *trial.roles):
        if name not in known:
            raise trial.mark.error(
                f"the script has no partner or parameter {name!r}; it has: {', '.join(known)}"
            )
    rehearsal = Rehearsal(program, trial.parameters, trial.missing, trial.roles, choices)
    for step in trial.steps:
        played = rehearsal.play(step.when, step.mark)
        fault = played.fault or _differs(step, played) or _lacks(step, rehearsal.engine.facts(), program)
        yield msgspec.structs.replace(played, fault=fault)
        if fault:
            return


def _differs(step: Step, played: Played) -> str:
    if step.then is None or step.then == played.orders:
        return ""
    return f"orders: {'; '.join(played.orders) or 'nothing'}; expected: {'; '.join(step.then) or 'nothing'}"


def _lacks(step: Step, facts: Sequence[str], program: Program) -> str:
    """Say which wanted fact is not there; one that names some slots only is met whatever the others hold."""
    for wanted in step.facts:
        head, slots = parts(wanted)
        same = [fact for fact in facts if fact.startswith((f"({head} ", f"({head})"))]
        if not any(slots.items() <= parts(fact)[1].items() for fact in same):
            there = f"; there are: {' '.join(in_words(fact, program) for fact in same)}" if same else ""
            return f"there is no fact {in_words(wanted, program)}{there}"
    return ""
