"""A recording that is played: how everything was at one moment of it. No clock is read here.

What a moment shows is what the recorded realm said before it, so going back means to begin anew.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from robotree.tui.recording.tape import (
    Content,
    RecordedEnd,
    RecordedLine,
    RecordedPicture,
    RecordedState,
    Tape,
)
from robotree.vr.base.address import Address
from robotree.vr.base.description import Listing, RobotDescription
from robotree.vr.base.requests import LoggedLine, State, ViewDescribed

RECORDED = "recorded"
"""The incarnation of a recorded view, or host: a recording has only its name."""

LINES = 200
"""Lines of logs that somebody hears who begins to listen."""


class Playback:
    """One moment of a recording, which moves forward."""

    def __init__(self, tape: Tape) -> None:
        """Begin before the first entry."""
        self.tape = tape
        self.position = tape.began
        """[s] since 1970: all up to here has been said."""
        self.robots = dict[str, RobotDescription]()
        """As they described themselves last, by name."""
        self.views = dict[str, dict[str, RecordedPicture]]()
        """The newest picture of each camera, by view and camera."""
        self.revisions = dict[str, int]()
        """By name of a robot: the entry that described it last, or told its end."""
        self._states = dict[str, State]()
        self._lines = dict[str, list[LoggedLine]]()
        self._next = 0

    @property
    def over(self) -> bool:
        """Whether all has been said."""
        return self._next >= len(self.tape.entries)

    def advance(self, unix: float) -> Sequence[Content]:
        """Go forward to a moment [s since 1970]; returns what was said meanwhile, in its order."""
        said = list[Content]()
        while not self.over and self.tape.entries[self._next].unix <= unix:
            content = self.tape.entries[self._next].content
            self._next += 1
            self._take(content)
            said.append(content)
        self.position = max(self.position, min(unix, self.tape.ended))
        return said

    def moment(self) -> Sequence[Content]:
        """Return what somebody must hear who begins to listen now: the newest states, and the last lines."""
        states = [RecordedState(name, state) for name, state in self._states.items()]
        lines = [RecordedLine(name, line) for name, lines in self._lines.items() for line in lines]
        return [*states, *sorted(lines, key=lambda said: said.line.unix)[-LINES:]]

    def _take(self, content: Content) -> None:
        match content:
            case RobotDescription():
                self.robots[content.name] = content
                self.revisions[content.name] = self._next
            case RecordedState(name, state):
                self._states[name] = state
            case RecordedLine(name, line):
                self._lines.setdefault(name, []).append(line)
            case RecordedEnd(name):
                self.robots.pop(name, None)
                self.revisions[name] = self._next
                self._states.pop(name, None)
            case RecordedPicture(view, camera, _):
                self.views.setdefault(view, {})[camera] = content
            case _:
                pass

    def described(self, name: str) -> RobotDescription | None:
        """Return how a robot would describe itself at this moment."""
        robot, state = self.robots.get(name), self._states.get(name)
        if robot is None or state is None:
            return robot
        return msgspec.structs.replace(
            robot, busy=state.busy, waiting=state.waiting, epoch=state.epoch, online=state.online,
            stopped=state.stopped, stop_reason=state.stop_reason, stops=max(state.stops, 0),
            abandoned=state.abandoned, readings=state.readings, paused=state.paused, held=state.held,
            drill=state.drill,
            asks=state.asks, bond=robot.bond if state.bond is not None else None,
        )  # fmt: skip

    def log(self, name: str) -> tuple[LoggedLine, ...]:
        """Return the log of a robot up to this moment."""
        return tuple(self._lines.get(name, ()))

    def view(self, name: str) -> ViewDescribed:
        """Return how a view would describe itself."""
        return ViewDescribed(address=view_address(name), cameras=tuple(sorted(self.views[name])))

    def robots_of(self, host: str) -> tuple[Address, ...]:
        """Return the robots of a host."""
        return tuple(robot.address for robot in self.robots.values() if robot.host == host)

    def listings(self) -> tuple[Listing, ...]:
        """Return what a lookup service would list: free robots, and views."""
        robots = (self.listing(robot) for robot in self.robots.values() if robot.bond is None)
        return (*robots, *map(view_listing, self.views))

    def listing(self, robot: RobotDescription) -> Listing:
        """Return what a lookup service would list of a free robot."""
        return Listing(
            address=robot.address,
            kinds=robot.kinds,
            doc=robot.doc,
            host=robot.host,
            attributes=robot.attributes,
            commands=tuple(command.name for command in robot.commands if command.available),
            revision=self.revisions[robot.name],
        )


def view_address(name: str) -> Address:
    """Return the address of a recorded view."""
    return Address("view", name, RECORDED)


def view_listing(name: str) -> Listing:
    """Return what a lookup service would list of a view; whoever reads lists leaves out revision 0."""
    return Listing(address=view_address(name), kinds=("View",), revision=1)
