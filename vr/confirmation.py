"""Who of many that were told the same has confirmed it: all, or one error that names the others. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from robotree.vr.errors import NoAnswer, NotConfirmed, Unreachable, VrError

Order = Literal["the protective stop", "the release of the stop"]

_ADVICE: dict[Order, str] = {
    "the protective stop": "press the emergency stop of whatever they drive",
    "the release of the stop": "look at them, then release it again",
}


class Confirmations:
    """What came back of one order."""

    def __init__(self, order: Order) -> None:
        """Begin: nobody has confirmed."""
        self._order: Order = order
        self._told: set[str] = set()
        self._untold: dict[tuple[str, str], None] = {}
        self._advice: dict[str, None] = {_ADVICE[order]: None}

    def take(self, name: str, answer: BaseException | None) -> None:
        """Take the answer of one robot, for itself and for all below it.

        Args:
            name: of the robot.
            answer: None: it has confirmed. An error: it has not, or one below it has not.

        Raises:
            BaseException: `answer`, when it is nothing that a robot could have answered.
        """
        if answer is not None and not isinstance(answer, VrError):
            raise answer
        if answer is None or isinstance(answer, NotConfirmed):
            self._told.add(name)
        if isinstance(answer, NotConfirmed):  # the robot itself has; some below it have not
            self._told.update(answer.data["told"])
            for below, reason in answer.data["untold"]:
                self._untold[below, reason] = None
            self._advice.update(dict.fromkeys(answer.data["advice"]))
        elif answer is not None:
            self._untold[name, _reason(answer)] = None

    def miss(self, name: str, where: str, remedy: str) -> None:
        """Note one that lives and could not even be asked.

        Args:
            name: of the robot.
            where: it lives, for people.
            remedy: what a person can do about it.
        """
        self._untold[name, f"in {where}, which hangs"] = None
        self._advice[remedy] = None

    def settle(self) -> Sequence[str]:
        """Return the names of those that have confirmed, if all have.

        Raises:
            NotConfirmed: some have not; names both sides, and what to do next.
        """
        if self._untold:
            raise NotConfirmed(
                order=self._order,
                told=sorted(self._told),
                untold=[list(pair) for pair in self._untold],
                advice=list(self._advice),
            )
        return sorted(self._told)


def _reason(error: VrError) -> str:
    match error:
        case NoAnswer():
            return "it did not answer"
        case Unreachable():
            return "it ended or cannot be reached"
        case _:
            return str(error)
