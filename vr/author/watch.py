"""Slots for robots that are only watched: without a lease, by as many as want to.

    class Listener(VirtualRobot):
        robot = Watch("Reporter")

        @command
        def listen(self) -> None:
            for word in self.robot.words():  each value of its stream `words`
                print(word)

    self.robot.readings.battery      its readings, as those of a child
    self.robot.words.latest          the newest value; waits for the first
    self.robot.words.next("5 s")     the next one
    self.robot.force(hz=5)           the newest one, five times in a second at most

`robotree enslave listener.robot NAME` fills such a slot, beside whatever commands that robot. It stays filled
while the robot is away: the robot's next life is watched as soon as it is there.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, overload

import msgspec

from robotree.vr.author.child import HasSlots, Slotted, observed, readable
from robotree.vr.author.context import CallLimit, WhichValue, running
from robotree.vr.author.kind import Kind
from robotree.vr.author.readings import Readings
from robotree.vr.base.address import Address
from robotree.vr.base.description import SlotSpec


class Watch(Slotted):
    """A slot for a robot that is watched, declared in the class body: `rover = Watch("Rover")`."""

    def __init__(self, kind: str | type[Kind], doc: str = "", *, optional: bool = False) -> None:
        """Declare the slot.

        Args:
            kind: the robot must be of a class of this name, or of a subclass; `"Robot"` takes any.
            doc: what it is for.
            optional: the page can be used without it.

        Raises:
            TypeError: `kind` is none.
        """
        super().__init__(kind, doc)
        self.optional = optional

    @overload
    def __get__(self, robot: None, owner: type[Any]) -> Watch: ...
    @overload
    def __get__(self, robot: HasSlots, owner: type[Any]) -> WatchedRobot: ...
    def __get__(self, robot: HasSlots | None, owner: type[Any]) -> Watch | WatchedRobot:
        if robot is None:
            return self
        watched = vars(robot)[self.name] = WatchedRobot(robot, self.name)  # from now on found there at once
        return watched

    def spec(self) -> SlotSpec:
        """Describe the empty slot."""
        return msgspec.structs.replace(super().spec(), watch=True)


class WatchedRobot:
    """The robot in a slot that only watches, false while that is empty. Its attributes are its streams."""

    def __init__(self, robot: HasSlots, slot: str) -> None:
        """Made by access to the slot."""
        self._robot, self._slot = robot, slot

    def __bool__(self) -> bool:
        return self._watched() is not None

    def __str__(self) -> str:
        watched = self._watched()
        return f"nobody in {self._slot}" if watched is None else watched.name

    @property
    def readings(self) -> Readings:
        """Its readings, as it publishes them."""
        return Readings(self._slot)

    def __getattr__(self, stream: str) -> StreamReader:
        if stream.startswith("_"):
            raise AttributeError(stream)
        return StreamReader(self._robot, self._slot, stream)

    def _watched(self) -> Address | None:
        """Return who is in the slot; in a running command that is one of its steps."""
        found: Address | None = observed(lambda: self._robot.child_slots[self._slot].watched)
        return found


class StreamReader:
    """One stream of a watched robot, as a command receives it; the first value after it began to listen.

    A command keeps up to `feed.MOST_KEPT` values that it has not read yet; of more, the oldest are lost.
    """

    __slots__ = ("_robot", "_slot", "_stream")

    def __init__(self, robot: HasSlots, slot: str, stream: str) -> None:
        """Made by access to the robot's attribute."""
        self._robot, self._slot, self._stream = robot, slot, stream

    def __call__(
        self, *values: Any, hz: float | None = None, within: float | str | None = None, **arguments: Any
    ) -> Iterator[Any]:
        """Yield each value that was not read yet, in order. Ends only by an error.

        Args:
            *values: there are none: it is no command.
            hz: [1/s] how many are yielded at most, then the newest one each time; None: all of them.
            within: [s], or text with a unit: for how long each value is waited for; None: until the deadline
                of the command. Values that come between two calls are not lost, as they are with `next`.
            **arguments: there are no others.

        Raises:
            TimeoutError: none came in time.
            SlotEmpty: nobody is watched any more.
            ValueError: `hz` is not above 0.
            TypeError: something was given as to a command.
        """
        if values or arguments:
            where = f"{self._robot.child_slots.robot}.{self._slot} only watches"
            raise TypeError(
                f"{where}: `{self._stream}` is a stream; a robot is commanded by a slot of Child(…)"
            )
        if hz is not None and not hz > 0.0:
            raise ValueError(f"{self._stream}(hz={hz!r}): give a rate above 0, such as 5")
        return self._each(0.0 if hz is None else 1.0 / hz, CallLimit.of(within))

    def _each(self, period: float, limit: CallLimit | None) -> Iterator[Any]:
        which: WhichValue = "newest" if period else "each"
        at = 0.0
        while True:
            value = running().next_sample(self._slot, self._stream, which, at=at, limit=limit)
            at = running().now() + period
            yield readable(value)

    @property
    def latest(self) -> Any:
        """The newest value; waits for the first."""
        return readable(running().next_sample(self._slot, self._stream, "latest"))

    def next(self, within: float | str | None = None) -> Any:
        """Wait for a value that comes from now on.

        Args:
            within: [s], or text with a unit; None: until the deadline of the command.

        Raises:
            TimeoutError: none came in time.
            SlotEmpty: nobody is watched any more.
        """
        return readable(running().next_sample(self._slot, self._stream, "next", limit=CallLimit.of(within)))

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(
            f"{self._slot}.{self._stream} is a stream of a robot that is watched, without {name!r}; "
            "a robot is commanded by a slot of Child(…)"
        )
