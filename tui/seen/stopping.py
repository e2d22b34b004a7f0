"""One protective stop that was asked for here: who has confirmed it and how soon, and who has not. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

ASKED = "asked, no answer yet"
AWAKE = "answers again and is not stopped: stop once more, or resume"


@dataclass(slots=True)
class StopRound:
    """The answers to one stop."""

    asked: float
    """[s] when it was asked for."""
    open: dict[str, str] = field(default_factory=dict[str, str])
    """Why, by the name of each robot that has not confirmed it."""
    confirmed: dict[str, float] = field(default_factory=dict[str, float])
    """[s] that it took, by the name of each robot that has."""

    @classmethod
    def begin(cls, names: Iterable[str], now: float) -> StopRound:
        """Ask these robots."""
        return cls(now, dict.fromkeys(sorted(names), ASKED))

    def confirm(self, name: str, now: float) -> None:
        """Take that a robot stands."""
        self.open.pop(name, None)
        self.confirmed.setdefault(name, now - self.asked)

    def end(self, told: Iterable[str], untold: Mapping[str, str], now: float) -> None:
        """Take what came of the asking: who has confirmed, and why the others have not.

        Who is in neither was not there to be asked.
        """
        for name in told:
            if name not in untold:
                self.confirm(name, now)
        self.open = {name: why for name, why in untold.items() if name not in self.confirmed}

    def wake(self, name: str) -> None:
        """Note that a robot whose process hung answers again: it was not stopped."""
        if name in self.open:
            self.open[name] = AWAKE

    def dismiss(self, name: str) -> None:
        """Leave out a robot of which a person says that it is settled."""
        self.open.pop(name, None)

    def settle(self) -> list[str]:
        """Leave out the robots that answer again and are not stopped, and return them: a person resumes."""
        awake = [name for name, why in self.open.items() if why == AWAKE]
        for name in awake:
            del self.open[name]
        return awake

    @property
    def longest(self) -> float:
        """[s] until the last one of those that have confirmed had."""
        return max(self.confirmed.values(), default=0.0)
