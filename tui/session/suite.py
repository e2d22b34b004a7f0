"""Trials as a test suite: `robotree test FOLDER`, with the manners of pytest.

    robotree test examples/trials                       all *.session files below a folder
    robotree test examples/trials/lift.session::lift    one trial, with all rows of its table
    robotree test examples/trials -k 'lift and not drill' -x    whose names fit, up to a failure
    robotree test examples/trials --junit trials.xml    one test case for each trial

The exit code is 0 if all held, 1 if one did not, 2 for Ctrl-C, a line that cannot be understood or a path
that is not there, 5 if there was no trial. Scripts are read as a whole before the first trial is played.
"""

from __future__ import annotations

import asyncio
import json
import re
import time
from collections.abc import Callable, Coroutine, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from robotree.tui.errors import BadScript, ValueRefused
from robotree.tui.line.grammar import Line
from robotree.tui.processes.realm import only_looking
from robotree.tui.session import junit
from robotree.tui.session.playing import Player, read_file, write_report
from robotree.tui.session.script import PlayedStep, Report, Script, Trial, transcript
from robotree.tui.terminal import aside, put

PASSED, FAILED, ENDED, NONE = 0, 1, 2, 5
"""The exit codes, as pytest has them; 2: it was interrupted, or could not begin."""

PATTERN = "*.session"

Fits = Callable[[str], bool]


class Collected(NamedTuple):
    """One trial that can be played."""

    path: str
    name: str
    script: Script
    trial: Trial

    @property
    def label(self) -> str:
        """How it is named on the command line."""
        return f"{self.path}::{self.name}"


class Tried(NamedTuple):
    """One trial that was played, whole or in part."""

    collected: Collected
    report: Report
    trouble: str = ""
    """Why it was broken off by something that is no step; empty: it was not."""

    @property
    def held(self) -> bool:
        """Whether all its steps did."""
        return self.report.ok and not self.trouble

    @property
    def reason(self) -> str:
        """Which line failed and why, in one line."""
        if (failed := self.report.failed) is None:
            return self.trouble
        seen = failed.seen.splitlines() or [""]
        return f"line {failed.step.number}: {failed.step.text} → {seen[0]}"

    @property
    def case(self) -> junit.Case:
        """Itself in a JUnit report."""
        text = "" if self.held else "\n".join([self.reason, *map(transcript, self.report.told)])
        outcome = "" if self.held else "failure"
        return junit.Case(self.collected.name, self.report.wall_s, outcome, text, self.collected.path)


def selection(expression: str) -> Fits:
    """Return which names fit an expression such as `lift and not (slow or drill)`; empty: all.

    A word fits a name that contains it; upper and lower case are alike.

    Raises:
        ValueRefused: it is none.
    """
    tokens = re.findall(r"[()]|[^\s()]+", expression)
    if not tokens:
        return lambda _: True
    fits, rest = _either(tokens)
    if rest:
        raise _no_expression(expression, f"{rest[0]!r} is too much")
    return fits


def _no_expression(expression: str, reason: str) -> ValueRefused:
    return ValueRefused("EXPRESSION", f"{expression!r} is no expression of words, and, or, not: {reason}")


def _either(tokens: list[str]) -> tuple[Fits, list[str]]:
    fits, rest = _both(tokens)
    while rest[:1] == ["or"]:
        other, rest = _both(rest[1:])
        fits = _joined(fits, other, any)
    return fits, rest


def _both(tokens: list[str]) -> tuple[Fits, list[str]]:
    fits, rest = _single(tokens)
    while rest[:1] == ["and"]:
        other, rest = _single(rest[1:])
        fits = _joined(fits, other, all)
    return fits, rest


def _joined(first: Fits, second: Fits, how: Callable[[Sequence[bool]], bool]) -> Fits:
    return lambda name: how([first(name), second(name)])


def _single(tokens: list[str]) -> tuple[Fits, list[str]]:
    text = " ".join(tokens)
    match tokens:
        case ["not", *rest]:
            inner, rest = _single(rest)
            return (lambda name: not inner(name)), rest
        case ["(", *rest]:
            inner, rest = _either(rest)
            if rest[:1] != [")"]:
                raise _no_expression(text, "a parenthesis is not closed")
            return inner, rest[1:]
        case [word, *rest] if word not in {"and", "or", ")"}:
            wanted = word.lower()
            return (lambda name: wanted in name.lower()), rest
        case _:
            raise _no_expression(text, "a word is missing")


def collected(path: str, *, readonly: bool) -> Iterator[Collected | BadScript]:
    """Return the trials of a PATH, and the scripts that cannot be understood.

    Args:
        path: of a folder or file; with `::NAME` behind it one trial of a file, with all its rows or one of
            them.
        readonly: whether verbs that change robots are absent.

    Raises:
        ValueRefused: there is no such file or trial.
        SessionError: a file cannot be read.
    """
    place, _, name = path.partition("::")
    where = Path(place)
    if not where.exists():
        raise ValueRefused("PATH", f"there is no {place}")
    files = sorted(where.rglob(PATTERN)) if where.is_dir() else [where]
    known = list[str]()
    for file in files:
        try:
            script = read_file(str(file), readonly=readonly)
        except BadScript as error:
            yield error
            continue
        for trial in script.trials:
            full = trial.name if trial.name and not trial.name.startswith("[") else f"{file.stem}{trial.name}"
            known.append(full)
            if not name or name in {full, full.partition("[")[0]}:
                yield Collected(str(file), full, script, trial)
    if name and not any(name in {each, each.partition("[")[0]} for each in known):
        raise ValueRefused("PATH", f"{place} has no trial {name!r}; it has {', '.join(known) or 'none'}")


def test(line: Line, realm: str) -> int | Coroutine[Any, Any, int]:
    """Play the trials that a line names; returns the exit code, or how it comes about.

    Args:
        line: `test [PATH …]`, understood.
        realm: in which they are played.

    Raises:
        ValueRefused: there is no such file or trial, or the selection is none.
        SessionError: a file cannot be read or written.
        TransportError: the realm cannot be joined.
    """
    readonly = only_looking(given=line.flag("--readonly"))
    fits = selection(line.text("--select"))
    found = [each for path in line.many("PATH") or (".",) for each in collected(path, readonly=readonly)]
    errors = [each for each in found if isinstance(each, BadScript)]
    every = [each for each in found if isinstance(each, Collected)]
    chosen = [each for each in every if fits(each.label)]
    if errors:
        if junit_file := line.text("--junit"):
            write_report(junit_file, junit.of_error(errors[0].path, errors[0]))
        mistakes = [mistake for error in errors for mistake in str(error).splitlines()]
        raise BadScripts(mistakes)
    session = Suite(line, chosen, len(every) - len(chosen))
    if line.flag("--collect-only") or not chosen:
        return session.listed()
    return session.play(realm)


class BadScripts(BadScript):
    """Scripts of a suite cannot be understood; nothing was played."""

    def __init__(self, lines: Sequence[str]) -> None:
        """Keep what is wrong, one sentence for each line of a script."""
        super().__init__("", ())
        self.args = ("\n".join([*lines, "nothing was played"]),)


class Suite:
    """The trials of one call of `robotree test`."""

    def __init__(self, line: Line, chosen: Sequence[Collected], left_out: int) -> None:
        """Take what is played, and how many trials were not chosen."""
        self._line, self._chosen, self._left_out = line, chosen, left_out
        self._json = line.flag("--json")
        self._tried = list[Tried]()
        self._began = time.monotonic()

    def listed(self) -> int:
        """Print which trials there are; returns the exit code."""
        if self._json:
            put(json.dumps([each.label for each in self._chosen], ensure_ascii=False))
        else:
            for each in self._chosen:
                put(each.label)
            put(f"{len(self._chosen)} trials{self._not_chosen}")
        self._report()
        return PASSED if self._chosen else NONE

    @property
    def _not_chosen(self) -> str:
        return f", {self._left_out} not chosen" if self._left_out else ""

    async def play(self, realm: str) -> int:
        """Play the trials one after the other; returns the exit code."""
        from robotree.client.joining import joined

        interrupted = False
        async with joined(realm) as realm_client:
            for each in self._chosen:
                steps, began = list[PlayedStep](), time.monotonic()
                try:
                    report = await Player(realm_client, each.script, steps.append).play(each.trial)
                    self._take(Tried(each, report))
                except asyncio.CancelledError:  # Ctrl-C: what was played is told, as pytest does
                    report = Report(script=each.path, told=tuple(steps), wall_s=time.monotonic() - began)
                    self._take(Tried(each, report, "interrupted"))
                    interrupted = True
                    break
                if self._line.flag("--exitfirst") and not self._tried[-1].held:
                    break
        self._report()
        self._tell_summary(interrupted=interrupted)
        if interrupted:
            return ENDED
        return PASSED if all(each.held for each in self._tried) else FAILED

    def _take(self, tried: Tried) -> None:
        self._tried.append(tried)
        if self._json:
            return
        how = "passed" if tried.held else "FAILED"
        put(f"{tried.collected.label}  {how}  {tried.report.wall_s:.1f} s")
        if not tried.held:
            for step in tried.report.told:
                aside(transcript(step))

    def _tell_summary(self, *, interrupted: bool) -> None:
        wall = time.monotonic() - self._began
        failed = [each for each in self._tried if not each.held]
        if self._json:
            trials = [
                {
                    "trial": each.collected.label,
                    "held": each.held,
                    "reason": "" if each.held else each.reason,
                    **each.report.structure(),
                }
                for each in self._tried
            ]
            counts = {"passed": len(trials) - len(failed), "failed": len(failed), "wall_s": round(wall, 3)}
            put(json.dumps({"ok": not failed, **counts, "trials": trials}, ensure_ascii=False))
            return
        for each in failed:
            put(f"FAILED {each.collected.label} - {each.reason}")
        parts = [f"{len(failed)} failed"] if failed else []
        parts += [f"{len(self._tried) - len(failed)} passed"]
        left = len(self._chosen) - len(self._tried)
        parts += [f"{left} not played"] if left else []
        end = "; interrupted" if interrupted else ""
        put(f"{', '.join(parts)}{self._not_chosen} in {wall:.1f} s{end}")

    def _report(self) -> None:
        if junit_file := self._line.text("--junit"):
            cases = [each.case for each in self._tried]
            write_report(junit_file, junit.written("robotree", time.monotonic() - self._began, cases))
