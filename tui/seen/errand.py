"""Something that a person has had begun: who hears how far it is, and what came of it. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from robotree.tui.seen import wording
from robotree.tui.seen.behaviours import Behaviour


class CallListener:
    """What has started a command, and gets its progress and result; its page may be closed meanwhile."""

    def started(self) -> None:
        """The command was sent."""

    def progressed(self, fraction: float, text: str) -> None:
        """The command reported how far it is."""

    def succeeded(self, value: Any, seconds: float) -> None:
        """It succeeded."""

    def failed(self, reason: str) -> None:
        """It was refused or failed."""


@dataclass(slots=True, eq=False)
class Errand(CallListener):
    """One command."""

    behaviour: Behaviour
    robot: str
    began: float
    """[s] on the clock of the screen."""
    fraction: float = math.nan
    """How far it is, 0 to 1; NaN: it does not say."""
    note: str = ""
    """What the command says of how far it is."""
    runs: bool = True
    why: str = ""
    """Why it failed; empty: it did not."""
    result: list[tuple[str, str]] = field(default_factory=list[tuple[str, str]])
    """Its result, as rows of name and text."""

    @property
    def title(self) -> str:
        """What it is, in the words of its author."""
        return self.behaviour.title

    def words(self, now: float) -> str:
        """Return how it is [now in s]."""
        if self.runs:
            share = "" if math.isnan(self.fraction) else f"{min(max(self.fraction, 0.0), 1.0):.0%}  "
            return f"{share}{now - self.began:.0f} s  {self.note}".strip()
        if self.why:
            return f"failed: {self.why}"
        told = ", ".join(f"{name} {text}".strip() for name, text in self.result)
        return f"done: {told}" if told else "done"

    def progressed(self, fraction: float, text: str) -> None:
        """It reports how far it is."""
        self.fraction, self.note = fraction, text

    def succeeded(self, value: Any, seconds: float) -> None:
        """It succeeded."""
        del seconds
        self.runs = False
        self.result = wording.result(self.behaviour.spec.result, value) if not _empty(value) else []

    def failed(self, reason: str) -> None:
        """It was refused or failed."""
        self.runs, self.why = False, reason


def _empty(value: Any) -> bool:
    return value is None or (isinstance(value, Mapping) and not value)
