"""A driver with rovers below it, and one more on top of the driver."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable
from typing import Annotated, Any

import msgspec
import pytest

from robotree.vr import Child, ChildCancelled, Range, Robot, Unit, VirtualRobot, VrError, command

Metres = Annotated[float, Unit("m"), Range(-5, 5), "ahead"]


class Where(msgspec.Struct):
    x: Annotated[float, Unit("m")]
    moves: int


class Rover(Robot):
    """A rover; if it is `silent`, its controller answers when the test lets it."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.x = 0.0
        self.keys: list[str] = []
        self.epochs: list[int] = []
        self.deadlines: list[float] = []
        self.stops: list[str] = []
        self.silent = False
        self.answers: list[asyncio.Future[None]] = []

    @command(effect="once")
    def move(self, x: Metres, y: float = 0.0) -> None:  # noqa: ARG002 # a straight rover
        """Drive."""
        self.keys.append(self.context.key)
        self.epochs.append(self.context.epoch)
        self.deadlines.append(self.context.deadline_at)
        for _ in range(10):
            self.sleep(abs(x) / 10)
            self.x += x / 10
            self.progress(0.5)

    @command(effect="read")
    def get_info(self) -> Where:
        return Where(self.x, len(self.keys))

    @command
    def fall(self) -> None:
        raise ValueError("over")

    def safe_stop(self, reason: str) -> Awaitable[None] | None:
        self.stops.append(reason)
        return self.answer()

    def resume(self) -> Awaitable[None] | None:
        self.stops.append("resumed")
        return self.answer()

    def answer(self) -> Awaitable[None] | None:
        if not self.silent:
            return None
        self.answers.append(asyncio.get_running_loop().create_future())
        return self.answers[-1]


class Driver(VirtualRobot):
    """Drives two rovers."""

    left = Child("Rover")
    right = Child("Rover")

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.saw: list[Any] = []

    @command
    def square(self, length: float) -> Any:
        for x, y in ((length, 0), (0, length), (-length, 0), (0, -length)):
            self.left.move(x, y=y)
        return self.left.get_info().moves

    @command
    def both(self, length: float) -> None:
        first, second = self.left.move.start(x=length), self.right.move.start(x=length)
        self.saw += [first.done, math.isnan(first.progress)]
        first.result()
        second.result()
        self.saw += [first.done, first.progress]

    @command
    def impatient(self) -> None:
        future = self.left.move.start(x=5)
        with pytest.raises(TimeoutError):
            future.result(timeout=0.0)
        future.cancel()
        with pytest.raises(ChildCancelled):
            future.result()

    @command
    def fire_and_forget(self) -> None:
        self.left.move.tell(x=4)

    @command
    def clumsy(self, how: str) -> None:
        match how:
            case "fall":
                self.left.fall()
            case "unknown":
                getattr(self.left, "fly")()  # noqa: B009 # so that the slot does not expect it
            case "wrong":
                self.left.move(x="3 kg")
            case "many":
                self.left.move(1, 2, 3)
            case "twice":
                self.left.move(1, x=1)
            case "part":
                _ = self.left.get_info().colour
            case "empty":
                self.right.move(1)
            case _:
                self.left._private()

    @command
    def stubborn(self) -> None:
        while True:
            try:
                self.left.move(x=1)
            except VrError:
                self.saw.append("again")

    drive = left.exposed("move")
    get_info = left.exposed()


class Top(VirtualRobot):
    """On top of a driver."""

    driver = Child("Driver")
    go = driver.exposed("drive")

    @command
    def tour(self) -> None:
        self.driver.square(length=1)


async def crew(realm: Any, *slots: str) -> tuple[Any, ...]:
    slots = slots or ("left",)
    driver = await realm.team(Driver("driver"), **{slot: Rover(f"rover-{slot}") for slot in slots})
    return (driver, *(getattr(driver, slot) for slot in slots))
