"""Pages for the stories of one host, and what their code can do there that real code does: compute, block."""

from __future__ import annotations

from typing import Any

from greenlet import getcurrent

from robotree.vr.world.virtual_runner import VirtualProcess

_BEGIN = """
from robotree.vr import Child, VirtualRobot, command, state
from tests.world.pages import block, note, toil
"""
_WHEEL = '''
class Wheel(VirtualRobot):
    """A wheel, whose commands note when they begin and end."""
    turns: int = state(0)

    @command
    def turn(self, ticket: float, seconds: float) -> float:
        note(self, "begins", ticket)
        try:
            self.sleep(seconds)
            self.turns += 1
        finally:
            note(self, "ends", ticket)
        return ticket

    @command
    def grind(self, ticket: float, seconds: float) -> float:
        """Compute, and ask nobody if it is cancelled."""
        note(self, "begins", ticket)
        try:
            for _ in range(5):
                toil(seconds)
                self.progress(0.5)
        finally:
            note(self, "ends", ticket)
        return ticket

    @command
    def ignore(self, ticket: float, seconds: float) -> float:
        """Catch what ends it, once."""
        note(self, "begins", ticket)
        try:
            try:
                toil(10 * seconds)
            except BaseException:
                toil(seconds)
        finally:
            note(self, "ends", ticket)
        return ticket

    @command
    def hang(self, ticket: float, seconds: float) -> float:
        """Wait in a call that nothing interrupts."""
        block(15 * seconds)
        return ticket

    @command(effect="read")
    def where(self, ticket: float, seconds: float) -> float:
        return ticket

'''
_AXLE = '''
class Axle(VirtualRobot):
    """Two wheels, which can live on the same host."""
    left = Child("Wheel")
    right = Child("Wheel")

    @command
    def nested(self, ticket: float, seconds: float) -> float:
        note(self, "begins", ticket)
        try:
            self.left.turn(ticket=ticket + 0.1, seconds=seconds)
            self.right.turn(ticket=ticket + 0.2, seconds=seconds)
        finally:
            note(self, "ends", ticket)
        return ticket

    @command
    def both(self, ticket: float, seconds: float) -> float:
        with self.together() as pair:
            pair.start(self.left.turn, ticket=ticket + 0.1, seconds=seconds)
            pair.start(self.right.turn, ticket=ticket + 0.2, seconds=2 * seconds)
        return ticket + sum(pair.results) - sum(pair.results)

    @command
    def race(self, ticket: float, seconds: float) -> float:
        with self.first() as winner:
            winner.start(self.left.turn, ticket=ticket + 0.1, seconds=seconds)
            winner.start(self.right.turn, ticket=ticket + 0.2, seconds=3 * seconds)
        return ticket if winner.result else 0.0

    @command
    def started(self, ticket: float, seconds: float) -> float:
        """Start both, wait for one; the other ends with this command."""
        left = self.left.turn.start(ticket=ticket + 0.1, seconds=seconds)
        self.right.turn.start(ticket=ticket + 0.2, seconds=10 * seconds)
        left.result()
        return ticket

    @command
    def told(self, ticket: float, seconds: float) -> float:
        self.left.turn.tell(ticket=ticket + 0.7, seconds=seconds)
        return self.right.turn(ticket=ticket + 0.2, seconds=seconds) - 0.2

    @command
    def detached(self, ticket: float, seconds: float) -> float:
        self.left.turn.start(ticket=ticket + 0.8, seconds=5 * seconds).detach()
        self.sleep(seconds)
        return ticket

    @command
    def cleaned(self, ticket: float, seconds: float) -> float:
        try:
            self.left.turn(ticket=ticket + 0.1, seconds=seconds)
        finally:
            with self.cleanup(within=2.0):
                self.right.turn(ticket=ticket + 0.9, seconds=0.01)
        return ticket

    @command
    def watched(self, ticket: float, seconds: float) -> float:
        """Look who is there, again and again."""
        for _ in range(3):
            if self.left and self.right:
                self.left.where(ticket=ticket, seconds=0.0)
            self.sleep(seconds / 3)
        return ticket

    @command
    def grinds(self, ticket: float, seconds: float) -> float:
        with self.first() as winner:
            winner.start(self.left.grind, ticket=ticket + 0.1, seconds=seconds)
            winner.start(self.right.ignore, ticket=ticket + 0.2, seconds=seconds)
        return ticket

    @command(effect="read")
    def reads(self, ticket: float, seconds: float) -> float:
        return self.left.where(ticket=ticket, seconds=0.0)

'''
_CART = '''
class Cart(VirtualRobot):
    """An axle."""
    axle = Child("Axle")

    @command
    def drive(self, ticket: float, seconds: float) -> float:
        self.axle.nested(ticket=ticket, seconds=seconds)
        return ticket

    @command
    def grind(self, ticket: float, seconds: float) -> float:
        self.axle.nested(ticket=ticket, seconds=seconds)
        toil(20 * seconds)
        return ticket
'''

SOURCES = {"Wheel": _BEGIN + _WHEEL, "Axle": _BEGIN + _AXLE, "Cart": _BEGIN + _CART}
"""A page for each kind: a host loads each of its robots anew, and so loads no more than it needs."""

DETACHED = (7, 8, 9)
"""Last digits of tickets that go on without the command that has begun them."""

on_note: Any = None
"""Takes a robot, what it does and the ticket; set by the story."""


def note(robot: Any, what: str, ticket: float) -> None:
    """Tell the story."""
    if on_note is not None:
        on_note(robot.name, what, round(ticket, 1))


def toil(seconds: float) -> None:
    """Compute for some time [s]: only an interruption ends it early."""
    process().runner.toil(seconds)


def block(seconds: float) -> None:
    """Wait in the operating system for some time [s]: nothing ends it early."""
    process().waiter().wait(seconds)


def process() -> VirtualProcess:
    """Return the process in whose thread this is."""
    mine: Any = getcurrent()
    found: VirtualProcess = mine.process
    return found
