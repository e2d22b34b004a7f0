"""One call of a robot in its process: who waits for it, how far it is, why it is to end, and its code."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

from robotree.vr.base.errors import VrError
from robotree.vr.base.requests import Raised, Returned
from robotree.vr.core.events import StepResult
from robotree.vr.core.machine import Lap
from robotree.vr.running.process import Worker

NO_PROGRESS = (math.nan, "")
"""How far a command is that has not said so: progress from 0 to 1, here unknown, and a text."""


OfferedTurn = Callable[[Callable[[Worker], None]], bool]
"""Has the worker of a caller, which waits, carry a command out; returns whether it still waits."""


class Listener(Protocol):
    """A listener for the progress and the end of a call. Called in any thread; must not block."""

    def note(self, fraction: float, text: str) -> None:
        """Take the progress: 0 to 1, NaN where it is unknown."""
        ...

    def settle(self, reply: Returned | Raised) -> None:
        """Take how it ended."""
        ...

    def go_elsewhere(self) -> None:
        """Take note that the robot goes on in another process, where the call is to be asked again."""
        ...


class HeldStep(NamedTuple):
    """A step before which a command of a paused robot waits."""

    call: str
    """Key of the call."""
    step: str
    """The step in words: `step 3: arm.go_to(x=0.3)`."""
    wake: Callable[[], None]
    """Has the command look again. From any thread."""


class Run:
    """The data of one call of its robot in a process, beside the state that a journal keeps.

    The runtime of the robot makes it when the call is accepted, and forgets it when the call has ended.
    """

    turn: OfferedTurn | None = None
    """Has the worker of its caller, which waits for it, carry it out; see `ChildCall.give_turn`."""
    cause: VrError | None = None
    """Why its code was asked to end."""
    final: bool = False
    """Whether not even a clean-up may command children any more: see `core.machine.AcceptedCall.final`."""
    interrupt: Callable[[], None] | None = None
    """Has its code take note of `cause`; None: its turn has not come, or its code has ended."""
    shown: tuple[float, str] = NO_PROGRESS
    """How far it is, as others see it."""
    own: tuple[float, str] = NO_PROGRESS
    """The same without the progress of its children."""
    waited: bool = False
    """Whether the person who called it was told that it waits."""
    recall: dict[str, StepResult] | None = None
    """The steps that it took before its process was started again, by path; None: it begins now."""
    fields: Mapping[str, Any] = MappingProxyType({})
    """The fields of its robot, as they are or were at the place of the page where it is."""
    wake: Callable[[], None] = staticmethod(lambda: None)
    """Has its code look again at what it waits for."""
    answer: str = ""
    """The answer of a person to its question; empty: none yet."""
    asks: object = None
    """The part of it that asks a person; None: none does."""
    ahead: tuple[Lap, ...] = ()
    """The laps that it takes again after the present one."""
    lap: str = ""
    """The prefix of its steps since its last checkpoint."""
    callers: frozenset[str] = frozenset()
    """Keys under which those are present with whom it ends; empty: it goes on without them."""

    passes_on: tuple[Callable[[float], None], ...] = ()
    """Those who tell a child that a command of it is attended, which this one has called; see `Attend`."""
    listeners: tuple[Listener, ...] = ()
    """Those who are told how it fares."""

    def attend(self, listener: Listener | None, turn: OfferedTurn | None) -> None:
        """Take who wants to know how it fares, and whose worker may carry it out; see `turn`."""
        self.turn = self.turn or turn
        if listener is not None:
            self.listeners += (listener,)

    def begin_lap(self, lap: Lap) -> None:
        """Go on with what the robot kept when a lap began, and with its keys."""
        self.lap, self.fields = f"{lap.number}." if lap.number else "", dict(lap.fields)

    def tell(self, fraction: float, text: str) -> None:
        """Tell those who listen how far it is."""
        for listener in self.listeners:
            listener.note(fraction, text)

    def end(self, cause: VrError, *, final: bool) -> None:
        """Ask its code to end, also code that has not begun. From any thread."""
        self.cause, self.final = cause, self.final or final
        if self.interrupt is not None:
            self.interrupt()
