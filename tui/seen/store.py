"""What the supervisor knows of its realm: robots, views, states, and what happened. No screen in here.

The fleet's callbacks feed it, `now` in hand; widgets draw it when its `revision` has grown. It remembers
what it heard last and when, so that silence can be told from calm.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Container, Generator, Iterable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Literal

from robotree.tui.seen import mood, wording
from robotree.tui.seen.mood import Condition, Mood
from robotree.tui.terminal import one_line
from robotree.vr.address import Address
from robotree.vr.description import Listing, RobotDescription
from robotree.vr.requests import State

SILENCE = 4.0
"""[s] without a state after which a robot counts as silent: states come at least once a second."""

FLASH = 2.5
"""[s] that an arrival stays highlighted."""

MEMORY = 500
"""Events that are kept."""

PROGRESS = "progress"
"""The reading that tells how far the running command is."""

Weight = Literal["good", "plain", "warning", "error"]


@dataclass(frozen=True, slots=True)
class Happening:
    """Something that happened."""

    at: float
    """[s] on the store's clock."""
    weight: Weight
    text: str


@dataclass(frozen=True, slots=True)
class Row:
    """One robot as the list shows it."""

    name: str
    kind: str
    mood: Mood
    doing: str
    """The mood in words, with the command that runs."""
    host: str
    about: str
    fresh: bool
    """It has just come."""
    stale: bool = False
    """No lookup service says that it is still there."""


@dataclass(slots=True)
class Heard:
    """The newest state of a robot, and when it came."""

    state: State
    at: float


@dataclass(slots=True)
class Store:
    """The supervisor's memory."""

    robots: dict[str, Listing] = field(default_factory=dict[str, Listing])
    """Free robots by name: those that are listed, or that are known while no lookup service lists any."""
    views: dict[str, Listing] = field(default_factory=dict[str, Listing])
    descriptions: dict[str, RobotDescription] = field(default_factory=dict[str, RobotDescription])
    """All robots that answered at the last look, enslaved ones too."""
    services: tuple[str, ...] = ()
    hosts: tuple[str, ...] = ()
    stale: bool = False
    """No lookup service lives: the lists are as old as that."""
    joined: bool = False
    """The realm has been joined; before that emptiness means nothing."""
    happenings: deque[Happening] = field(default_factory=lambda: deque[Happening](maxlen=MEMORY))
    revision: int = 0
    """Grows with each change that can be seen."""
    shape: int = 0
    """Grows when somebody should look again who commands whom."""
    missed: dict[Address, Listing | RobotDescription] = field(
        default_factory=dict[Address, "Listing | RobotDescription"]
    )
    """Agents that are seen no more: they hang or have gone, as somebody should find out."""
    _heard: dict[str, Heard] = field(default_factory=dict[str, Heard])
    _were_listed: bool = True
    """A lookup service said so of the robots and views that are known; else they were only seen."""
    _came: dict[str, float] = field(default_factory=dict[str, float])
    _asked: dict[str, int] = field(default_factory=dict[str, int])
    """How many commands of ours a robot has not answered yet."""
    _elsewhere: set[str] = field(default_factory=set[str])
    """Robots that carry out what others asked for."""
    _told_of: deque[tuple[Address, str]] = field(
        default_factory=lambda: deque[tuple[Address, str]](maxlen=MEMORY)
    )
    """What has been told of those that are missed."""

    # -- what is told ------------------------------------------------------------------------------

    def tell(self, text: str, weight: Weight, now: float) -> Happening:
        """Enter something that happened."""
        happening = Happening(now, weight, one_line(text))
        self.happenings.append(happening)
        self.revision += 1
        return happening

    def take_lists(
        self,
        robots: Iterable[Listing],
        views: Iterable[Listing],
        now: float,
        present: Container[Address] | None = None,
    ) -> None:
        """Take the lists of the lookup services, or what is known without one; tell who came and left.

        Args:
            robots: that are free.
            views: all.
            now: [s] on the store's clock.
            present: who is seen alive, listed or not; None: everybody. Who is not is missed.
        """
        first, were_listed = not self.joined, self._were_listed
        self.joined, self._were_listed = True, not self.stale
        before = {**self.robots, **self.views}
        self.robots = {one.name: one for one in robots}
        self.views = {one.name: one for one in views}
        after = {**self.robots, **self.views}
        for name, listing in after.items():
            known = before.get(name)
            if (known is None or known.address != listing.address) and not first:
                self._came[name] = now
                where = "has come, but no lookup service lists it" if self.stale else "is listed"
                self.tell(f"{name} ({listing.kind}) {where}", "good", now)
        for name, listing in before.items():
            if name not in after:
                self._came.pop(name, None)
                if present is not None and listing.address not in present:
                    self.missed[listing.address] = listing
                elif were_listed:
                    self.tell(f"{name} ({listing.kind}) left the list", "plain", now)
        self.revision += 1
        self.shape += 1

    def tell_missed(self, address: Address, why: str, now: float) -> None:
        """Tell once what has become of an agent that is missed."""
        told, who = (address, why), self.missed[address]
        if told not in self._told_of:
            self._told_of.append(told)
            self.tell(f"{who.name} ({who.kind}): its process {why}", "error", now)

    def take_services(self, services: Sequence[str], now: float, *, stale: bool) -> None:
        """Take which lookup services live."""
        if stale and self.services:
            self.tell("no lookup service is left: the lists may be old", "error", now)
        if self.orphaned and not stale:
            self.tell("a lookup service is back", "good", now)
        self.services, self.stale = tuple(sorted(services)), stale
        self.revision += 1

    def take_hosts(self, hosts: Iterable[str]) -> None:
        """Take which hosts live."""
        self.hosts = tuple(sorted(hosts))
        self.revision += 1

    def take_state(self, name: str, state: State, now: float) -> None:
        """Take the state that a robot told."""
        before = self._heard.get(name)
        self._heard[name] = Heard(state, now)
        if before is None or _outline(before.state) != _outline(state):
            self.shape += 1
        if before is not None:
            self._tell_change(name, before.state, state, now)
        self.revision += 1

    @contextmanager
    def asking(self, name: str) -> Generator[None]:
        """Note that what a robot begins meanwhile was asked for here: whoever asked tells of it."""
        self._asked[name] = self._asked.get(name, 0) + 1
        try:
            yield
        finally:
            self._asked[name] -= 1

    def _tell_commands(self, name: str, before: State, after: State, now: float) -> None:
        """Tell what others have a robot do; what a parent asks of a child is part of its own command."""
        if before.busy == after.busy:
            return
        if before.busy and name in self._elsewhere:
            self._elsewhere.discard(name)
            self.tell(f"{name}.{before.busy} has ended, asked for elsewhere", "plain", now)
        if after.busy and after.bond is None and not self._asked.get(name):
            self._elsewhere.add(name)
            self.tell(f"{name}.{after.busy} has begun, asked for elsewhere", "plain", now)

    def _tell_change(self, name: str, before: State, after: State, now: float) -> None:
        self._tell_commands(name, before, after, now)
        if before.online and not after.online:
            self.tell(f"{name} lost its controller: its readings are stale", "error", now)
        if after.online and not before.online:
            self.tell(f"{name} has its controller back", "good", now)
        if after.stopped and not before.stopped:
            why = f": {after.stop_reason}" if after.stop_reason else ""
            self.tell(f"{name} is in protective stop{why}", "error", now)
        if before.stopped and not after.stopped:
            self.tell(f"{name} was resumed: its stop has ended", "good", now)

    def take_descriptions(self, descriptions: Iterable[RobotDescription]) -> None:
        """Take how all robots describe themselves; who is not among them does not live."""
        enslaved = self.enslaved
        self.descriptions = {one.name: one for one in descriptions}
        self.missed |= {one.address: one for one in enslaved if one.name not in self.descriptions}
        living = self.descriptions.keys() | self.robots.keys()
        self._heard = {name: heard for name, heard in self._heard.items() if name in living}
        self.revision += 1

    # -- what is asked -----------------------------------------------------------------------------

    @property
    def orphaned(self) -> bool:
        """Whether there is somebody, but no lookup service that would say so."""
        return self.stale and bool(self.robots or self.views or self.descriptions)

    @property
    def stopped(self) -> tuple[str, ...]:
        """Names of the robots in protective stop."""
        return tuple(sorted(name for name, heard in self._heard.items() if heard.state.stopped))

    @property
    def enslaved(self) -> list[RobotDescription]:
        """Robots under a parent, as far as they said so: they are on no list that they could leave."""
        return [
            robot
            for name, robot in self.descriptions.items()
            if name not in self.robots and (told := self._told(name)) and told.bond is not None
        ]

    def state(self, name: str) -> State | None:
        """Return the newest state of a robot."""
        heard = self._heard.get(name)
        return heard.state if heard else None

    def age(self, name: str, now: float) -> float | None:
        """Return [s] since a robot told its state; None: never."""
        heard = self._heard.get(name)
        return now - heard.at if heard else None

    def mood(self, name: str, now: float) -> Mood:
        """Return how a robot is, in one word."""
        if self._silent(name, now):
            return "silent"
        told = self._told(name)
        return mood.mood(told) if told else "free"

    def doing(self, name: str, now: float) -> str:
        """Return how a robot is, in words."""
        if self._silent(name, now):
            return f"silent {self.age(name, now) or 0:.0f} s"
        told, state = self._told(name), self.state(name)
        if told is None:
            return "free"
        if mood.mood(told) == "enslaved" and state and state.bond:
            return f"under {state.bond.name}"
        return mood.doing(told, self.progress(name))

    def _silent(self, name: str, now: float) -> bool:
        age = self.age(name, now)
        return age is not None and age > SILENCE

    def _told(self, name: str) -> Condition | None:
        """Return what a robot tells of itself: its newest state; before the first one its description."""
        return self.state(name) or self.descriptions.get(name)

    def readings(self, name: str) -> dict[str, float]:
        """Return the readings of a robot, over those of the child that its exposed commands lead to."""
        found: dict[str, float] = {}
        for one in self._downwards(name):
            state = self.state(one)
            found = {**(state.readings if state else {}), **found}
        found.pop(PROGRESS, None)
        return found

    def units(self, name: str) -> dict[str, str]:
        """Return the units of those readings, by name."""
        found: dict[str, str] = {}
        for one in self._downwards(name):
            robot, state = self.descriptions.get(one), self.state(one)
            told = state.readings if state else {}
            own = robot.units if robot else {}
            found = {**{key: own.get(key, "") for key in told}, **found}
        return found

    def _downwards(self, name: str) -> Iterable[str]:
        seen: set[str] = set()
        while name and name not in seen:
            seen.add(name)
            yield name
            name = self._beneath(name)

    def progress(self, name: str) -> float | None:
        """Return how far the running command of a robot is, 0 to 1; None: it does not say."""
        state = self.state(name)
        return state.readings.get(PROGRESS) if state else None

    def _beneath(self, name: str) -> str:
        """Return the child that a robot's exposed commands lead to, or its only child."""
        robot = self.descriptions.get(name)
        if robot is None:
            return ""
        children = {slot.name: slot.child.name for slot in robot.slots if slot.child}
        through = [command.through.partition(".")[0] for command in robot.commands if command.through]
        wanted = next((slot for slot in through if slot in children), next(iter(children), ""))
        return children.get(wanted, "")

    def rows(self, letters: str, now: float) -> list[Row]:
        """Return the listed robots whose row or description contains these letters, by name."""
        rows = [self._row(listing, now) for _, listing in sorted(self.robots.items())]
        wanted = letters.lower()
        return [
            row
            for row in rows
            if wanted in f"{row.name} {row.kind} {row.doing} {row.host} {row.about}".lower()
            or self.about(row.name, letters)
        ]

    def about(self, name: str, letters: str) -> bool:
        """Whether a robot speaks of these letters where it describes itself and its commands."""
        robot = self.descriptions.get(name)
        if robot is None:
            return False
        said = [*robot.kinds, robot.doc, *(f"{one.name} {one.doc}" for one in robot.commands)]
        return letters.lower() in " ".join(said).lower()

    def _row(self, listing: Listing, now: float) -> Row:
        name = listing.name
        return Row(
            name=name,
            kind=listing.kind,
            mood=self.mood(name, now),
            doing=self.doing(name, now),
            host=listing.host,
            about=wording.summary(listing.doc),
            fresh=now - self._came.get(name, -FLASH) < FLASH,
            stale=self.stale,
        )

    def candidates(self, parent: str, kind: str) -> list[Listing]:
        """Return the free robots that a slot of this kind takes, without the parent and those above it."""
        above = self.lineage(parent)
        return [one for name, one in sorted(self.robots.items()) if kind in one.kinds and name not in above]

    def lineage(self, name: str) -> tuple[str, ...]:
        """Return a robot and all that command it, upwards."""
        line: list[str] = []
        while name and name not in line:
            line.append(name)
            robot = self.descriptions.get(name)
            name = robot.bond.parent.name if robot and robot.bond else ""
        return tuple(line)


def _outline(state: State) -> tuple[object, ...]:
    return (state.bond, state.epoch, state.online)
