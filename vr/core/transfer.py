"""The move of a robot from one host to another, as two machines: the host that it leaves, and the other one.

    the source     preparing ─► writing ─► freezing ─► out ─► gone
                       └───────────┴───────────┴─────────┴──► back
    the destination    asked ─► ready ─► taken
                         └────────┴────► never

Both are driven by the journals of their hosts and by nothing else: the source writes that the robot is out
before it freezes and sends it, the destination writes that it has it before it says so, and that one record
is the commit. From the freezing to the commit nobody acts, and the source asks for as long as it takes, also
after it was started again: it has no other way to know. A destination that has not taken the robot writes
that it never will, before it says so. So of two processes at most one has the robot at any time, whichever of
them dies. Pure.
"""

from __future__ import annotations

from typing import Literal

import msgspec

from robotree.vr.base.newest import keep_newest

Phase = Literal["preparing", "writing", "freezing", "out", "gone", "back"]

BEFORE: tuple[Phase, ...] = ("preparing", "writing", "freezing")
"""While the robot acts at the source: a process that is started again then does not know that, and asks."""

MOST_REMEMBERED = 4096
"""Transfers of which a destination remembers what became of them."""


class _Value(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """One event or one effect."""


# -- what happens to the source --------------------------------------------------------------------


class DestinationReady(_Value, frozen=True, kw_only=True):
    """The destination has loaded the page and has room."""

    log: str
    """Name of the log in which it writes what it takes."""


class Refused(_Value, frozen=True, kw_only=True):
    """The destination does not want it, or it cannot travel."""

    reason: str


class Still(_Value, frozen=True, kw_only=True):
    """All its code waits, and nothing changes it any more."""


class StopCame(_Value, frozen=True, kw_only=True):
    """A protective stop comes."""

    reason: str
    order: str = ""


class OutWritten(_Value, frozen=True, kw_only=True):
    """That it may be out survives this process, and a loss of power; it acts here until it is frozen."""


class WordCame(_Value, frozen=True, kw_only=True):
    """The destination has said what is true for ever."""

    taken: bool


class NoWord(_Value, frozen=True, kw_only=True):
    """Nobody has answered."""


SourceEvent = DestinationReady | Refused | Still | StopCame | OutWritten | WordCame | NoWord

# -- what the source does --------------------------------------------------------------------------


class Freeze(_Value, frozen=True, kw_only=True):
    """Bring its code to a stand: `Still` or `Refused` follows."""


class WriteOut(_Value, frozen=True, kw_only=True):
    """Write that it is about to leave: `OutWritten` or `Refused` follows."""


class Send(_Value, frozen=True, kw_only=True):
    """Send it: `WordCame` or `NoWord` follows."""


class AskOther(_Value, frozen=True, kw_only=True):
    """Ask what became of it: `WordCame` or `NoWord` follows."""


class StopBelow(_Value, frozen=True, kw_only=True):
    """Stop its children at once: nobody else does at the moment."""

    reason: str
    order: str


class WriteBack(_Value, frozen=True, kw_only=True):
    """Write that it stays here."""


class Thaw(_Value, frozen=True, kw_only=True):
    """Go on here."""

    reason: str
    """Why it has not moved, as a clause."""


class LeaveHere(_Value, frozen=True, kw_only=True):
    """Write that it has gone, and be there no longer."""


SourceEffect = Freeze | WriteOut | Send | AskOther | StopBelow | WriteBack | Thaw | LeaveHere


class Departing:
    """One robot that is to leave; see the module."""

    def __init__(self, phase: Phase = "preparing") -> None:
        """Begin; `out`: the process was started again while it was on its way."""
        self.phase: Phase = phase
        self.stop: StopCame | None = None
        """The stop that has come while it was on its way."""
        self.log = ""
        """Name of the destination's log."""

    @property
    def begins(self) -> list[SourceEffect]:
        """What a source does first that was started again."""
        return [AskOther()] if self.phase == "out" else []

    def handle(self, event: SourceEvent) -> list[SourceEffect]:  # noqa: PLR0911 # one for each
        """Change; return what is to be done, in this order. What comes too late changes nothing."""
        match self.phase, event:
            case "preparing", DestinationReady(log=log):
                self.log, self.phase = log, "writing"
                return [WriteOut()]
            case "writing", OutWritten():
                self.phase = "freezing"
                return [Freeze()]
            case "freezing", Still():
                self.phase = "out"
                return [Send()]
            case _, Refused(reason=reason) if self.phase in BEFORE:
                return self._taken_back(reason)
            case _, StopCame(reason=reason) if self.phase in BEFORE:
                return self._taken_back(f"it was stopped: {reason}")
            case "out", StopCame(reason=reason, order=order):
                self.stop = event
                return [StopBelow(reason=reason, order=order)]
            case "out", WordCame(taken=True):
                self.phase = "gone"
                return [LeaveHere()]
            case "out", WordCame():
                return [WriteBack(), *self._back("the other host has not taken it")]
            case "out", NoWord():
                return [AskOther()]
            case _:
                return []

    def _taken_back(self, reason: str) -> list[SourceEffect]:
        """Stay here: the robot has not been sent to anybody."""
        written: list[SourceEffect] = [] if self.phase == "preparing" else [WriteBack()]
        return written + self._back(reason)

    def _back(self, reason: str) -> list[SourceEffect]:
        self.phase = "back"
        return [Thaw(reason=reason)]


# -- the destination -------------------------------------------------------------------------------


class WriteTaken(_Value, frozen=True, kw_only=True):
    """Write the whole robot as one record: the commit."""


class WriteNever(_Value, frozen=True, kw_only=True):
    """Write that it is never taken under this transfer."""


class BeginHere(_Value, frozen=True, kw_only=True):
    """Serve it, be present, and then go on."""


class SayDecision(_Value, frozen=True, kw_only=True):
    """Answer."""

    taken: bool


DestinationEffect = WriteTaken | WriteNever | BeginHere | SayDecision


class Destination:
    """What one host knows of the robots that were to come; see the module."""

    def __init__(self, taken: dict[str, None] | None = None, never: dict[str, None] | None = None) -> None:
        """Begin with what its log says."""
        self.taken: dict[str, None] = dict(taken or {})
        self.never: dict[str, None] = dict(never or {})
        self.ready: dict[str, None] = {}
        """Transfers whose robots may come; what the process knows, and no log."""

    def prepare(self, transfer: str) -> bool:
        """Be ready for a robot; returns whether it may come."""
        if transfer in self.taken or transfer in self.never:
            return False
        self.ready[transfer] = None
        return True

    def take(self, transfer: str) -> list[DestinationEffect]:
        """Take a robot that comes, if it is expected."""
        if transfer in self.taken:
            return [SayDecision(taken=True)]
        if transfer not in self.ready:
            return self._never(transfer)
        del self.ready[transfer]
        keep_newest(self.taken, transfer, None, MOST_REMEMBERED)
        return [WriteTaken(), BeginHere(), SayDecision(taken=True)]

    def ask(self, transfer: str) -> list[DestinationEffect]:
        """Answer whether a robot is here; else it never comes."""
        if transfer in self.taken:
            return [SayDecision(taken=True)]
        return self._never(transfer)

    def not_written(self, transfer: str) -> None:
        """Take back that a robot is taken: it could not be written."""
        self.taken.pop(transfer, None)

    def _never(self, transfer: str) -> list[DestinationEffect]:
        self.ready.pop(transfer, None)
        if transfer in self.never:
            return [SayDecision(taken=False)]
        keep_newest(self.never, transfer, None, MOST_REMEMBERED)
        return [WriteNever(), SayDecision(taken=False)]
