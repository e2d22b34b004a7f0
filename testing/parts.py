"""The parts in the slots of a rehearsal, and their faults."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, Self

import msgspec

from robotree.vr.author.robot import Robot
from robotree.vr.author.virtual_robot import VirtualRobot

if TYPE_CHECKING:
    from collections.abc import Coroutine

    from robotree.testing.journal import Journal, Step
    from robotree.vr.agents.agent import RobotAgent
    from robotree.vr.running.process import Journal as EventJournal
    from robotree.vr.running.process import Process
    from robotree.vr.world.world import SimulatedProcess, World

What = Literal["refuse", "delay", "lose", "freeze", "stop", "cancel", "crash"]


class Fault(msgspec.Struct, frozen=True, kw_only=True):
    """Something that goes wrong at one step."""

    what: What
    command: str = ""
    """At which command; empty: at any that moves."""
    at: int | None = 1
    """At its how-manieth call, from 1; None: at each."""
    after: float = 0.0
    """[s] from the beginning of that call."""
    by: float = 0.0
    """[s] that it takes longer, or lasts."""
    why: str = ""
    error: Exception | None = None
    path: str = ""
    """Slot of the page that crashes."""

    def __str__(self) -> str:
        where = self.command or "command"
        when = f"{where} {self.at}" if self.at else f"each {where}"
        more = f", {self.after:g} s later" if self.after else ""
        return f"{self.what} at {when}{more}" + (f" by {self.by:g} s" if self.by else "")


class Stage(Protocol):
    """The interface of a rehearsal that a part uses."""

    world: World
    journal: Journal
    """The commands of all robots."""
    mistake: Exception | None
    """The error that a function of the test itself has raised."""

    @property
    def now(self) -> float:
        """[s] of virtual time since the rehearsal began."""
        ...

    def start_robot(self, path: str, robot: Robot) -> None:
        """Let a robot live in a process of its own."""
        ...

    def start_process(
        self, path: str, live: Callable[[SimulatedProcess], Coroutine[Any, Any, None]]
    ) -> SimulatedProcess:
        """Let something live in a process of its own; it calls `lives` when its robot can be called."""
        ...

    def start_page(
        self,
        path: str,
        name: str,
        page: PageSource,
        settings: Mapping[str, Any],
        children: Mapping[str, Parts],
    ) -> None:
        """Make a robot of a page, let it live, and those that are meant for its slots."""
        ...

    def threads(self, process: SimulatedProcess, journal: EventJournal | None = None) -> Process:
        """Return what carries the commands of a simulated process out, and writes them down; see `Team`."""
        ...

    def lives(self, path: str, agent: RobotAgent) -> None:
        """Take note that a robot can be called."""
        ...


class Part:
    """The child in a slot of a rehearsal: a fake, a simulated robot, or another page."""

    def __init__(self) -> None:
        """Begin without faults."""
        self.faults: list[Fault] = []

    def lose(self, command: str = "", *, at: int | None = 1, after: float = 0.0) -> Self:
        """Have its process killed when a command begins.

        Args:
            command: its name; empty: any that moves.
            at: at its how-manieth call, from 1; None: at each.
            after: [s] later.
        """
        return self._add(Fault(what="lose", command=command, at=at, after=after))

    def freeze(
        self, command: str = "", *, at: int | None = 1, after: float = 0.0, lasts: float = 5.0
    ) -> Self:
        """Have its process stand still for a while [s], as by SIGSTOP; else as `lose`."""
        return self._add(Fault(what="freeze", command=command, at=at, after=after, by=lasts))

    def stop(self, command: str = "", *, at: int | None = 1, after: float = 0.0) -> Self:
        """Have the whole team stopped by a protective stop; else as `lose`."""
        return self._add(Fault(what="stop", command=command, at=at, after=after))

    def cancel(self, command: str = "", *, at: int | None = 1, after: float = 0.0) -> Self:
        """Have the operator cancel what the page is doing; else as `lose`."""
        return self._add(Fault(what="cancel", command=command, at=at, after=after))

    def _add(self, fault: Fault) -> Self:
        known = self.known_commands()
        if fault.command and known is not None and fault.command not in known:
            raise ValueError(f"there is no command {fault.command!r} to {fault.what}: {', '.join(known)}")
        self.faults.append(fault)
        return self

    def known_commands(self) -> Sequence[str] | None:
        """Return the names of its commands; None: they are not known before it lives."""
        return None

    def enter(self, team: Stage, path: str, name: str) -> None:
        """Begin to live in a rehearsal.

        Args:
            team: of the rehearsal.
            path: slot that it is meant for, from the page down.
            name: that it takes.
        """
        raise NotImplementedError

    def struck(self, step: Step, fault: Fault) -> None:
        """Take a fault of one step that only it can carry out."""
        raise TypeError(f"{step.robot} cannot {fault.what}: only a Fake can")


PageSource = type[VirtualRobot] | str | Path
"""A page: its class, or the path of its file (`FILE.py` or `FILE.py:CLASS`)."""
Parts = Part | Sequence[Part]
"""The part of one slot, or the parts of a slot for several."""


class Page(Part):
    """Another page, as the child of the page that is rehearsed: `mover=Page(MoveTo, arm=Fake(Arm))`."""

    def __init__(
        self, page: PageSource, /, *, settings: Mapping[str, Any] | None = None, **children: Parts
    ) -> None:
        """Name the page, and what is in its slots."""
        super().__init__()
        self.page, self.settings, self.children = page, dict(settings or {}), children
        self.robot: VirtualRobot | None = None
        """The robot of the present rehearsal, or of the last one."""

    def enter(self, team: Stage, path: str, name: str) -> None:
        team.start_page(path, name, self.page, self.settings, self.children)
