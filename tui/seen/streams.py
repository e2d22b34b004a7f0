"""Streams of robots as readings over time: `arm-1.stream/force` is a number in the stream force of arm-1.

A stream is sent only while somebody listens, so it is heard only while one of its numbers is ticked. A stream
of one number has one reading; where it sends several, each has its own: `stream/pose/x`, `stream/forces/0`.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from robotree.tui.seen.series import Reading
from robotree.vr.base.description import FieldSpec, RobotDescription

if TYPE_CHECKING:
    from robotree.vr.base.transport import Registration
    from robotree.vr.supervision.realm_client import RealmClient

STREAM: Final = "stream/"
"""Begin of the names of such readings: no robot's own reading has a slash."""


def numbers_of(robot: RobotDescription) -> dict[str, str]:
    """Return the numbers in the streams of a robot as readings, each with its unit, as they are declared."""
    return {
        f"{STREAM}{path}": field.unit
        for stream in robot.streams
        for path, field in _declared(stream.value, stream.name)
    }


def _declared(field: FieldSpec, path: str) -> Iterator[tuple[str, FieldSpec]]:
    if field.type in {"int", "float"}:
        yield path, field
    elif field.type == "record":
        for part in field.items:
            yield from _declared(part, f"{path}/{part.name}")
    elif field.type == "tuple":
        for at, part in enumerate(field.items):
            yield from _declared(part, f"{path}/{at}")


def numbers_in(value: Any, path: str) -> Iterator[tuple[str, float]]:
    """Yield the numbers in a value that was sent, by the names of their readings."""
    if isinstance(value, Mapping):
        for name, part in value.items():  # pyright: ignore[reportUnknownVariableType] # plain data
            yield from numbers_in(part, f"{path}/{name}")
    elif isinstance(value, list | tuple):
        for at, part in enumerate(value):  # pyright: ignore[reportUnknownVariableType, reportUnknownArgumentType]
            yield from numbers_in(part, f"{path}/{at}")
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield path, float(value)


class HeardStreams:
    """Listens to the streams of which something is ticked, and to no other."""

    def __init__(self, client: RealmClient, take: Callable[[str, Mapping[str, float]], None]) -> None:
        """Begin with none; `take` gets the name of a robot and what it has sent."""
        self._client, self._take = client, take
        self._heard: dict[Reading, Registration] = {}
        self._turn = asyncio.Lock()

    async def follow(self, ticked: Iterable[Reading]) -> None:
        """Listen to the streams of these readings only."""
        wanted = {
            (robot, name.removeprefix(STREAM).partition("/")[0])
            for robot, name in ticked
            if name.startswith(STREAM)
        }
        async with self._turn:
            for one in self._heard.keys() - wanted:
                await self._heard.pop(one).close()
            for robot, stream in wanted - self._heard.keys():
                hear = partial(self._hear, robot, f"{STREAM}{stream}")
                self._heard[robot, stream] = await self._client.watch_stream(robot, stream, hear)

    def _hear(self, robot: str, path: str, value: Any) -> None:
        self._take(robot, dict(numbers_in(value, path)))
