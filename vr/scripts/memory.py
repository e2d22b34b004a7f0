"""CLIPS by hand, around the wrappers of clipspy: the facts of one environment, and which rule fires next.

clipspy 1.0.6 never releases a fact that Python has seen (its `Fact.__del__` calls `ReleaseFact` with one
argument too many and swallows the error), so a script would grow with each message. Here each fact is
retained and released exactly once. The version of clipspy is pinned for that.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any

import clips
import clips.facts
from clips._clips import ffi, lib
from clips.agenda import activation_pp_string

from robotree.vr.scripts.expression import Atom, Form, form
from robotree.vr.scripts.program import Rule

PURGE = 512
"""Facts that came and went before those that are gone are let go."""


class WorkingMemory:
    """Asserts, retracts and reads facts."""

    def __init__(self, environment: clips.Environment) -> None:
        """Take an environment whose templates are built."""
        self._environment = environment
        self._raw = environment._env  # noqa: SLF001 # what is below goes around clipspy's wrappers
        self._templates: dict[str, clips.Template] = {}
        self._held: dict[int, Any] = {}
        """By number, the newest last."""
        self._learned = 0

    def insert(self, template: str, **slots: Any) -> Any:
        """Assert a fact and return it; it is held until `remove`."""
        found = self._templates.get(template)
        if found is None:
            found = self._templates[template] = self._environment.find_template(template)
        return found.assert_fact(**slots)._fact  # noqa: SLF001 # clipspy has retained it, and never releases it

    def begin(self, template: str, **slots: Any) -> None:
        """Assert a fact that nobody here removes."""
        lib.ReleaseFact(self.insert(template, **slots))

    @staticmethod
    def remove(fact: Any) -> None:
        """Retract a fact, if a rule has not done so, and let go of it."""
        if lib.FactExistp(fact):
            lib.Retract(fact)
        lib.ReleaseFact(fact)

    @staticmethod
    def number(fact: Any) -> int:
        """Return the number of a fact, as CLIPS shows it: `f-12`."""
        return int(lib.FactIndex(fact))

    def text(self, fact: Any) -> str:
        """Write a fact in one line."""
        return " ".join(clips.facts.fact_pp_string(self._raw, fact).split())

    def each(self) -> Iterator[Any]:
        """Return all facts, the oldest first; none may be asserted or retracted meanwhile."""
        fact = lib.GetNextFact(self._raw, ffi.NULL)
        while fact != ffi.NULL:
            yield fact
            fact = lib.GetNextFact(self._raw, fact)

    def learn(self) -> None:
        """Take note of the facts that are new, so that they can be told of when they are asked for."""
        newest = ffi.NULL
        while self._held:
            number = next(reversed(self._held))
            if lib.FactExistp(self._held[number]):
                newest = self._held[number]
                break
            lib.ReleaseFact(self._held.pop(number))
        while (newest := lib.GetNextFact(self._raw, newest)) != ffi.NULL:
            lib.RetainFact(newest)
            if (before := self._held.pop(int(lib.FactIndex(newest)), None)) is not None:
                lib.ReleaseFact(before)  # the same number: it has been modified
            self._held[int(lib.FactIndex(newest))] = newest
            self._learned += 1
        if self._learned > PURGE:
            self._learned = 0
            for number in [number for number, fact in self._held.items() if not lib.FactExistp(fact)]:
                lib.ReleaseFact(self._held.pop(number))

    def known(self, number: int) -> str:
        """Write the fact of a number; empty: it is gone."""
        fact = self._held.get(number)
        return self.text(fact) if fact is not None and lib.FactExistp(fact) else ""

    def close(self) -> None:
        """Let go of all that is held here."""
        for fact in self._held.values():
            lib.ReleaseFact(fact)
        self._held.clear()


LOWEST, HIGHEST = -10_000, 10_000
"""Saliences that CLIPS allows."""
_FACT = re.compile(r"f-(\d+)")


class Activation:
    """A rule and the facts that meet its conditions."""

    __slots__ = ("basis", "raw", "rule")

    def __init__(self, environment: Any, raw: Any) -> None:
        """Read it; `raw` is valid until it fires or a fact of it changes."""
        self.raw = raw
        _, _, text = activation_pp_string(environment, raw).strip().partition(" ")
        self.rule, _, self.basis = " ".join(text.split()).partition(": ")

    @property
    def numbers(self) -> tuple[int, ...]:
        """The numbers of its facts, in the order of the conditions."""
        return tuple(map(int, _FACT.findall(self.basis)))


class RuleAgenda:
    """The activations of one CLIPS environment, in our order; that of CLIPS depends on how it stores them.

    1. The higher priority goes first.
    2. Of those that are met at the same time, the rule that stands higher in the script.
    3. Of one rule, the match with the oldest facts, compared from its first condition on. A fact that was
       changed keeps its age.

    What is met only after that has its turn when these have fired, unless its priority is higher.

    So that CLIPS keeps that order, each priority of a script has a range of saliences of its own: a match is
    new at its lower end, and is given a place above that once, together with all that are new there.
    """

    def __init__(self, environment: clips.Environment, rules: Sequence[Rule]) -> None:
        """Take the rules in the order of the script."""
        self._environment = environment
        self._raw = environment._env  # noqa: SLF001 # clipspy reads an activation each time that it is touched
        self._places = {rule.name: at for at, rule in enumerate(rules)}
        self._levels = sorted({rule.priority for rule in rules})
        self._range = (HIGHEST - LOWEST) // max(len(self._levels), 1)

    def leveled(self, built: Form, rule: Rule) -> Form:
        """Return a `defrule` with the salience of its priority, for CLIPS."""
        head, name, *rest = built.parts
        if rest and isinstance(rest[0], Form) and rest[0].head == "declare":
            rest = rest[1:]
        salience = LOWEST + self._levels.index(rule.priority) * self._range
        declare = form("declare", form("salience", Atom("number", str(salience))))
        return Form((head, name, declare, *rest), built.mark)

    def first(self) -> Activation | None:
        """Return what fires next; None: no rule wants to."""
        top = lib.GetNextActivation(self._raw, ffi.NULL)
        if top == ffi.NULL:
            return None
        level = lib.ActivationGetSalience(top)
        second = lib.GetNextActivation(self._raw, top)
        if (level - LOWEST) % self._range or second == ffi.NULL or lib.ActivationGetSalience(second) != level:
            return Activation(self._raw, top)
        new = [one for one in self.each() if lib.ActivationGetSalience(one.raw) == level]
        new.sort(key=lambda one: (self._places[one.rule], one.numbers))
        for place, one in enumerate(new[: self._range - 1]):
            lib.ActivationSetSalience(one.raw, level + self._range - 1 - place)
        self._environment.reorder()
        return new[0]

    def each(self) -> Iterator[Activation]:
        """Return all, in the order of CLIPS."""
        raw = lib.GetNextActivation(self._raw, ffi.NULL)
        while raw != ffi.NULL:
            yield Activation(self._raw, raw)
            raw = lib.GetNextActivation(self._raw, raw)

    @staticmethod
    def drop(one: Activation) -> None:
        """Let it not fire."""
        lib.DeleteActivation(one.raw)
