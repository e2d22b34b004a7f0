"""Which rule fires next. CLIPS finds what is met; its own order depends on how it stores that.

1. The higher priority goes first.
2. Of those that are met at the same time, the rule that stands higher in the script.
3. Of one rule, the match with the oldest facts, compared from its first condition on. A fact that was changed
   keeps its age.

What is met only after that has its turn when these have fired, unless its priority is higher.

So that CLIPS keeps that order, each priority of a script has a range of saliences of its own: a match is new
at its lower end, and is given a place above that once, together with all that are new there.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any

import clips
from clips._clips import ffi, lib
from clips.agenda import activation_pp_string

from robotree.vr.scripts.expression import Atom, Form, form
from robotree.vr.scripts.program import Rule

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
    """The activations of one CLIPS environment, in our order."""

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
