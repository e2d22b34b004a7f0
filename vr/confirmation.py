"""Who of many that were told the same has confirmed it: all, or one error that names the others. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal

from robotree.vr.errors import NoAnswer, NotConfirmed, Unreachable, VrError

SHARE = 0.8
"""Of the time that somebody waits for a robot, what that waits for its hardware and its children: a tree of
any depth knows who did not answer before the one at the top gives up."""

LONGEST = 60.0
"""[s] Nobody waits longer for a stop."""

Order = Literal["the protective stop", "the resume"]

_ADVICE: dict[Order, str] = {
    "the protective stop": "press the emergency stop of whatever they drive",
    "the resume": "look at them, then resume again",
}


class Confirmations:
    """What came back of one order."""

    def __init__(self, order: Order) -> None:
        """Begin: nobody has confirmed."""
        self._order: Order = order
        self._told: set[str] = set()
        self._untold: dict[tuple[str, str], None] = {}
        self._advice: dict[str, None] = {_ADVICE[order]: None}

    @property
    def complete(self) -> bool:
        """Whether nobody is known who has not confirmed."""
        return not self._untold

    def names(self, name: str) -> bool:
        """Whether anything is known of a robot."""
        return name in self._told or any(name == untold for untold, _ in self._untold)

    def take(self, name: str, answer: Iterable[str] | BaseException) -> None:
        """Take the answer of one robot, for itself and for all below it.

        Args:
            name: of the robot.
            answer: it has confirmed, and these below it. An error: it has not, or one below it has not.

        Raises:
            BaseException: `answer`, when it is nothing that a robot could have answered.
        """
        if not isinstance(answer, BaseException):
            self._told.update((name, *answer))
        elif isinstance(answer, NotConfirmed):  # it says itself who has and who has not
            self._told.update(answer.data["told"])
            for below, reason in answer.data["untold"]:
                self._untold[below, reason] = None
            self._advice.update(dict.fromkeys(answer.data["advice"]))
            if not self.names(name):
                self._told.add(name)
        elif isinstance(answer, VrError):
            self.deny(name, _reason(answer))
        else:
            raise answer

    def deny(self, name: str, reason: str) -> None:
        """Note one that has not confirmed.

        Args:
            name: of the robot.
            reason: as a clause.
        """
        self._untold[name, reason] = None

    def miss(self, name: str, where: str, remedy: str) -> None:
        """Note one that lives and could not even be asked.

        Args:
            name: of the robot.
            where: it lives, for people.
            remedy: what a person can do about it.
        """
        self.deny(name, f"in {where}, which hangs")
        self._advice[remedy] = None

    def settle(self) -> Sequence[str]:
        """Return the names of those that have confirmed, if all have.

        Raises:
            NotConfirmed: some have not; names both sides, and what to do next.
        """
        if self._untold:
            raise NotConfirmed(
                order=self._order,
                told=sorted(self._told - {name for name, _ in self._untold}),
                untold=[list(pair) for pair in self._untold],
                advice=list(self._advice),
            )
        return sorted(self._told)


def share(within: float) -> float:
    """Return how long to wait for hardware and children, so that the one above still hears who is late [s].

    Args:
        within: [s] for which whoever asked waits.
    """
    return SHARE * within if 0 < within < LONGEST else SHARE * LONGEST


def _reason(error: VrError) -> str:
    match error:
        case NoAnswer():
            return "it did not answer"
        case Unreachable():
            return "it ended or cannot be reached"
        case _:
            return str(error)
