"""The robots and views that there are, as they describe themselves: asked again when the lists change.

A list of tools for a thousand robots must not ask a thousand robots. So each is asked once in its life, and
again when what it lists changes.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Final

import msgspec

from robotree.vr.base.errors import VrError
from robotree.vr.base.policy import fits

if TYPE_CHECKING:
    from robotree.vr.base.description import CommandSpec, Listing, RobotDescription
    from robotree.vr.supervision.realm_client import RealmClient

TOGETHER: Final = 25
"""Robots that are asked at the same time."""
SETTLES: Final = 0.05
"""[s] in which several changes of the lists are one."""
AGAIN: Final = 2.0
"""[s] after which a robot that did not answer is asked again."""
MOST_SPECS: Final = 10_000
"""Commands that are known as those of several robots."""


class Catalogue:
    """The free robots and the views of a realm, limited to names that fit a pattern."""

    def __init__(self, realm_client: RealmClient, pattern: str = "*") -> None:
        """Prepare; `start` begins to look.

        Args:
            realm_client: a realm that was joined.
            pattern: of the names of robots; `*` stands for any characters.
        """
        self._realm_client, self._pattern = realm_client, pattern
        self._known: dict[tuple[str, int], RobotDescription] = {}
        self._specs: dict[bytes, CommandSpec] = {}
        """The commands of all, each once: robots of one kind have the same ones, and who makes something of a
        command makes it once."""
        self.robots: dict[str, RobotDescription] = {}
        """By name. What is shown to somebody is less: the policy decides."""
        self.views: Sequence[Listing] = ()
        self.version = 0
        """Grows with each change."""
        self._listeners: list[Callable[[], object]] = []
        self._news, self._looked = asyncio.Event(), asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self._end: Callable[[], None] = lambda: None

    async def start(self) -> None:
        """Begin to look; returns when all robots that are listed now have been asked once."""
        self._end = self._realm_client.on_change(self._news.set)
        self._news.set()
        self._task = asyncio.create_task(self._look())
        await self._looked.wait()

    async def close(self) -> None:
        """Look no more."""
        self._end()
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)

    def on_change(self, listener: Callable[[], object]) -> None:
        """Call back after each change."""
        self._listeners.append(listener)

    async def _look(self) -> None:
        while True:
            await self._news.wait()
            await asyncio.sleep(SETTLES if self._looked.is_set() else 0)
            self._news.clear()
            await self._refresh()
            self._looked.set()

    async def _refresh(self) -> None:
        listed = [each for each in self._realm_client.robots() if fits(self._pattern, each.name)]
        missing = [each for each in listed if (each.address.key, each.revision) not in self._known]
        for first in range(0, len(missing), TOGETHER):
            await asyncio.gather(*map(self._learn, missing[first : first + TOGETHER]))
        known = {(each.address.key, each.revision): each for each in listed}
        self._known = {key: robot for key, robot in self._known.items() if key in known}
        robots = {
            known[key].name: robot for key, robot in sorted(self._known.items(), key=lambda each: each[0])
        }
        views = sorted(self._realm_client.views(), key=lambda view: view.name)
        if len(self._known) < len(known):
            asyncio.get_running_loop().call_later(AGAIN, self._news.set)
        if robots != self.robots or views != self.views:
            self.robots, self.views = robots, views
            self.version += 1
            for listener in self._listeners:
                listener()

    async def _learn(self, listing: Listing) -> None:
        with contextlib.suppress(VrError):
            described = await self._realm_client.describe(listing.name)
            if described.address.key == listing.address.key:
                commands = tuple(map(self._once, described.commands))
                described = msgspec.structs.replace(described, commands=commands)
                self._known[listing.address.key, listing.revision] = described

    def _once(self, spec: CommandSpec) -> CommandSpec:
        """Return the spec that is equal to this one and came first."""
        if len(self._specs) > MOST_SPECS:
            self._specs.clear()
        return self._specs.setdefault(msgspec.msgpack.encode(spec), spec)
