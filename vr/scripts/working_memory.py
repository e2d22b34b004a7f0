"""The facts of one CLIPS environment, held by hand.

clipspy 1.0.6 never releases a fact that Python has seen (its `Fact.__del__` calls `ReleaseFact` with one
argument too many and swallows the error), so a script would grow with each message. Here each fact is
retained and released exactly once. The version of clipspy is pinned for that.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import clips
import clips.facts
from clips._clips import ffi, lib

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
