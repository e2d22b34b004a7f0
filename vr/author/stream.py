"""Streams that a robot sends to whoever watches it: words, forces, poses, pictures.

    class Reporter(VirtualRobot):
        words = Stream(str)
        force = Stream(Annotated[float, Unit("N")], rate=50)

        @command
        def report(self) -> None:
            self.words.send("I begin")

Nobody who listens takes a lease, and nothing is sent while nobody listens. `Watch` is the other side.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Generic, TypeVar, overload

import msgspec

from robotree.vr.author.context import activity_here
from robotree.vr.author.robot import Robot, attributes_of
from robotree.vr.author.typed import field_of
from robotree.vr.base.description import FieldSpec, StreamSpec

T = TypeVar("T")
FASTEST = 1000.0
"""[1/s] Highest rate of a stream."""


class DeclaredStream:
    """A stream as the body of a class declares it."""

    def __init__(self, value: Any, doc: str = "", *, rate: float = 0.0) -> None:
        """Declare the stream.

        Args:
            value: type of what is sent, as a parameter of a command has it: `str`, `bytes`, a dataclass,
                `Annotated[float, Unit("N")]`.
            doc: what it is.
            rate: [1/s] that are sent at most: what comes earlier is left out; 0: every value is sent.

        Raises:
            TypeError: `rate` is no such number, or `doc` no text.
        """
        said: Any = doc
        if not isinstance(said, str):
            raise TypeError(f"Stream(…, {doc!r}): say what is sent as a text, and the rate as rate=10")
        if not (math.isfinite(rate) and 0.0 <= rate <= FASTEST):
            raise TypeError(f"Stream(…, rate={rate!r}): the rate is from 0 to {FASTEST:g} values in a second")
        self.annotation, self.doc, self.rate, self.name = value, doc, float(rate), ""
        self._field: FieldSpec | None = None

    def __set_name__(self, owner: type[Any], name: str) -> None:
        self.name, self._owner = name, owner.__name__

    def spec(self) -> StreamSpec:
        """Describe it, without listeners.

        Raises:
            TypeError: such a value cannot travel.
        """
        if self._field is None:
            where = f"{self._owner}.{self.name}"
            field = field_of(self.name, self.annotation, where)
            self._field = msgspec.structs.replace(field, doc=self.doc or field.doc)
        return StreamSpec(value=self._field, rate=self.rate)


class Stream(DeclaredStream, Generic[T]):
    """A stream of a robot, declared in the body of its class: `words = Stream(str)`."""

    def __init__(self, value: type[T] | Any, doc: str = "", *, rate: float = 0.0) -> None:
        """See `DeclaredStream`."""
        super().__init__(value, doc, rate=rate)

    @overload
    def __get__(self, robot: None, owner: type[Any]) -> Stream[T]: ...
    @overload
    def __get__(self, robot: Robot, owner: type[Any]) -> Sending[T]: ...
    def __get__(self, robot: Robot | None, owner: type[Any]) -> Stream[T] | Sending[T]:
        return self if robot is None else Sending(robot, self.name)


class Sending(Generic[T]):
    """A stream of one robot, for its own code."""

    __slots__ = ("_name", "_robot")

    def __init__(self, robot: Robot, name: str) -> None:
        """Made by access to the robot's attribute."""
        self._robot, self._name = robot, name

    @property
    def wanted(self) -> bool:
        """Whether somebody listens: ask before a value is made that takes long to make."""
        outlet = self._robot.stream_outlet
        return outlet is not None and outlet.wanted(self._name)

    def send(self, value: T) -> None:
        """Send a value to all who listen. From any thread; never waits, and is no step of a command.

        A listener that is too slow misses values. A command that goes on after a crash sends nothing twice,
        but what was sent last before the crash may not have arrived.

        Raises:
            BadArgument: the value is not of the stream's type, or too large.
        """
        outlet = self._robot.stream_outlet
        if outlet is None:
            return
        activity = activity_here()
        if activity is None:
            outlet.send(self._name, value)
        else:
            activity.keep(lambda: outlet.send(self._name, value))


def streams_of(cls: type[Any]) -> Mapping[str, DeclaredStream]:
    """Return the streams that a class and its bases declare, by name."""
    return {name: value for name, value in attributes_of(cls).items() if isinstance(value, DeclaredStream)}
