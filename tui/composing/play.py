"""What a composition commands, without any robot: what its test expects. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import msgspec

from robotree.tui.composing.steps import (
    Checked,
    Comparison,
    ComposedBranch,
    ComposedCall,
    ComposedExpectation,
    ComposedPart,
    ComposedRepeat,
    ComposedStep,
    ComposedTogether,
    ComposedWait,
    Kinds,
    Value,
    Variable,
    walk,
)
from robotree.tui.errors import BadComposition

LONGEST: Final = 5000
"""Steps that one call may take."""

Order = tuple[str, str, dict[str, Any]]
"""Slot, command, arguments."""


class Played(msgspec.Struct):
    """What one call of a composition does."""

    orders: list[Order] = []
    """What is commanded, in its order; what only reads is left out."""
    reads: dict[tuple[str, str], list[dict[str, Any]]] = {}
    """The results of the commands that only read, one after the other: those with which all that is expected
    holds, and each `if`, and each `until` at the second time; empty where nothing is compared."""
    seconds: float = 0.0
    """Of fakes, whose commands take a second."""
    unordered: bool = False
    """Whether some of it begins at the same time: then it is compared sorted, so each number is exact."""


def play(checked: Checked, kinds: Kinds, arguments: Mapping[str, Any]) -> Played:
    """Play a composition.

    Args:
        checked: it can be meant.
        kinds: of its robots.
        arguments: other values than the defaults of its parameters.

    Raises:
        BadComposition: it takes more than `LONGEST` steps.
    """
    player = _StepPlayer(checked, kinds, arguments)
    player.steps(checked.composition.steps)
    return player.played


class _StepPlayer:
    def __init__(self, checked: Checked, kinds: Kinds, arguments: Mapping[str, Any]) -> None:
        steps = checked.composition.steps
        self.played = Played(unordered=any(isinstance(step, ComposedTogether) for _, step in walk(steps)))
        self._slots = dict(checked.composition.slots)
        self._kinds = kinds
        self._given = dict(checked.composition.parameters) | dict(arguments)
        self._left = LONGEST

    def steps(self, steps: Sequence[ComposedStep]) -> None:
        for step in steps:
            self._left -= 1
            if self._left < 0:
                raise BadComposition(f"one call would take more than {LONGEST} steps; repeat less")
            self._step(step)

    def _step(self, step: ComposedStep) -> None:
        match step:
            case ComposedCall():
                self._call(step)
            case ComposedWait(seconds):
                self.played.seconds += float(self._value(seconds))
            case ComposedExpectation(that):
                self._read(that)
            case ComposedPart(_, inside):
                self.steps(inside)
            case ComposedRepeat(times, inside, until):
                count = int(self._value(times))
                rounds = count if until is None else min(count, 2)
                for number in range(1, rounds + 1):
                    self.steps(inside)
                    if until is not None:
                        self._read(until, holds=number == rounds)
            case ComposedBranch(that, then, _):
                self._read(that)
                self.steps(then)
            case ComposedTogether(inside):
                self.steps(inside)

    def _call(self, step: ComposedCall) -> None:
        spec = self._kinds[self._slots[step.slot]][step.command]
        if spec.effect != "read":
            given = {name: self._value(value) for name, value in step.arguments}
            self.played.orders.append((step.slot, step.command, given))
            self.played.seconds += 1.0
        else:
            self.played.reads.setdefault((step.slot, step.command), []).append({})

    def _value(self, value: Value) -> Any:
        if isinstance(value, Variable):
            given, plus = self._given[value.name], round(abs(value.plus), 9)
            if not plus:
                return given
            moved = given - plus if value.plus < 0 else given + plus  # as the page computes it
            return moved if self.played.unordered else round(moved, 9)
        return value

    def _read(self, that: Comparison, *, holds: bool = True) -> None:
        """Have the reading be one with which the comparison holds, or does not."""
        value = self._value(that.value)
        match that.relation, holds:
            case ("is", True) | ("is not", False):
                found = value
            case ("above", True) | ("below", False):
                found = value + 1
            case ("below", True) | ("above", False):
                found = value - 1
            case _:
                found = not value if isinstance(value, bool) else self._other(that, value)
        result = {that.field: found}
        self.played.reads.setdefault((that.slot, that.command), []).append(result)

    def _other(self, that: Comparison, value: Any) -> Any:
        """Return another value than this one."""
        spec = self._kinds[self._slots[that.slot]][that.command]
        part = next(each for each in spec.result if each.name == that.field)
        others = [choice for choice in part.choices if choice != value]
        if others:
            return others[0]
        return value + 1 if isinstance(value, int | float) else f"not {value}"
