"""The confirmations of an order to many: all of them, or one error that names the others. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal

from robotree.vr.base.errors import NoAnswer, NotConfirmed, Unreachable, VrError

UNMEASURED = 0.2
"""Share of its patience that an asker keeps for the way there and back, while it has not measured that."""

TURN = 0.1
"""[s] A robot keeps this much at most for its own turn: its process takes an answer and passes it on."""

FOOT = 20
"""Shares of the time for the hardware at the foot of a tree, where each level takes one."""

LEAST = 0.001
"""[s] A shorter time is none: the order is carried out, and nobody waits for what follows from it."""

HOPELESS = 0.6
"""[s] after which a stop no longer waits for a robot whose process is stopped; somebody may wake it."""

LONGEST = 60.0
"""[s] Nobody waits longer for a stop."""

NO_ANSWER = "it did not answer"
UNREACHED = "it ended or cannot be reached"
HEARSAY = frozenset((NO_ANSWER, UNREACHED))
"""Reports that other agents may give about a robot. Its own report counts more."""

ConfirmedOrder = Literal["the protective stop", "the resume"]

_ADVICE: dict[ConfirmedOrder, str] = {
    "the protective stop": "press the emergency stop of whatever they drive",
    "the resume": "look at them, then resume again",
}


class Confirmations:
    """The answers to one order."""

    def __init__(self, order: ConfirmedOrder) -> None:
        """Begin: nobody has confirmed."""
        self._order: ConfirmedOrder = order
        self._confirmed: set[str] = set()
        self._first_hand: set[str] = set()
        """Those who have answered themselves; of the others a robot above them has reported."""
        self._unconfirmed: dict[tuple[str, str], None] = {}
        self._advice: dict[str, None] = {_ADVICE[order]: None}

    @property
    def complete(self) -> bool:
        """Whether nobody is known who has not confirmed."""
        return not self._open()

    def names(self, name: str) -> bool:
        """Whether anything is known of a robot."""
        return name in self._confirmed or any(name == untold for untold, _ in self._unconfirmed)

    def take(self, name: str, answer: Iterable[str] | BaseException) -> None:
        """Take the answer of one robot, for itself and for all below it.

        Args:
            name: of the robot.
            answer: it has confirmed, and these below it. An error: it has not, or one below it has not.

        Raises:
            BaseException: `answer`, when it is nothing that a robot could have answered.
        """
        if not isinstance(answer, BaseException):
            self._confirmed.update((name, *answer))
            self._first_hand.add(name)
        elif isinstance(answer, NotConfirmed):  # it says itself who has and who has not
            self._first_hand.add(name)
            self.report(answer)
            if not self.names(name):
                self._confirmed.add(name)
        elif isinstance(answer, VrError):
            self.deny(name, _reason(answer))
        else:
            raise answer

    def confirm(self, name: str) -> None:
        """Note one that has confirmed, as its site reports."""
        self._confirmed.add(name)

    def report(self, answer: NotConfirmed) -> None:
        """Take what another one reports of many."""
        self._confirmed.update(answer.data["told"])
        for below, reason in answer.data["untold"]:
            self._unconfirmed[below, reason] = None
        self._advice.update(dict.fromkeys(answer.data["advice"]))

    def advise(self, remedy: str) -> None:
        """Note what a person can do next."""
        self._advice[remedy] = None

    def deny(self, name: str, reason: str) -> None:
        """Note one that has not confirmed.

        Args:
            name: of the robot.
            reason: as a clause.
        """
        self._unconfirmed[name, reason] = None

    def miss(self, name: str, reason: str, remedy: str) -> None:
        """Note a robot that runs and could not be asked; no other agent has reported about it.

        Args:
            name: of the robot, or of what may have robots.
            reason: as a clause: `in process 4711, which hangs`.
            remedy: what a person can do about it.
        """
        self._first_hand.add(name)
        self.deny(name, reason)
        self._advice[remedy] = None

    def settle(self) -> Sequence[str]:
        """Return the names of those that have confirmed, if all have.

        Raises:
            NotConfirmed: some have not; names both sides, and what to do next.
        """
        if untold := self._open():
            raise NotConfirmed(
                order=self._order,
                told=sorted(self._confirmed - {name for name, _ in untold}),
                untold=[list(pair) for pair in untold],
                advice=list(self._advice),
            )
        return sorted(self._confirmed)

    def _open(self) -> list[tuple[str, str]]:
        """Return who has not confirmed, and why; a robot's own answer replaces reports of others."""
        return [
            (name, reason)
            for name, reason in self._unconfirmed
            if not (name in self._first_hand and reason in HEARSAY)
        ]


class Budget:
    """How long a robot that has an order waits: for its own hardware, and for those below it.

    Of a tree of any depth, the one at the top hears who is late before its own time is over. So each level
    keeps the measured way to its children and a short turn of its own: one share of what the ways below
    leave, but no more than `TURN`. Each level below takes one share, too; the hardware at the foot has `FOOT`
    of them.
    """

    def __init__(self, within: float, *, depth: int = 0, round_trips: float = 0.0) -> None:
        """Begin when the order arrives.

        Args:
            within: [s] after which the answer must leave.
            depth: levels of robots below this one; 0: none.
            round_trips: [s] that the ways down through all levels and back take together.
        """
        self.within = within if 0 < within < LONGEST else LONGEST
        """[s] from the arrival of the order until its answer leaves."""
        self._half_turn = min(TURN, max(self.within - round_trips, 0.0) / (max(depth, 0) + FOOT)) / 2
        self.wait = self.within - self._half_turn
        """[s] to wait for hardware and for those below."""

    def below(self, way: float, waited: float = 0.0) -> float:
        """Return within which time [s] of its arrival a child must answer.

        Args:
            way: [s] that the way to the child and back takes.
            waited: [s] that are gone already.
        """
        return max(self.wait - waited - way - self._half_turn, LEAST)


def unmeasured(patience: float) -> float:
    """Return within which time [s] a robot must answer to which the way has not been measured.

    Args:
        patience: [s] for which the asker waits.
    """
    return (1 - UNMEASURED) * patience


def _reason(error: VrError) -> str:
    match error:
        case NoAnswer():
            return NO_ANSWER
        case Unreachable():
            return UNREACHED
        case _:
            return str(error)
