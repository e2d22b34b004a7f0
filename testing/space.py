"""The space of a rehearsal, in memory: what a test puts there for the page, and what the page has left.

team = rehearse(Porter)
team.space.write(Delivery("hall"))
team.call("work")
assert team.space.take(Report) == Report("hall")
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, TypeVar

from robotree.vr.base.entry import entry_of, revived, template_of
from robotree.vr.base.requests import FOR_EVER, AnyRequest, EntriesFound, EntryLeased, FindEntries, WriteEntry
from robotree.vr.space.memory import MemoryStore
from robotree.vr.space.service import SpaceService
from robotree.vr.world.world import SimulatedProcess

SPACE = "space"
"""Its name."""
MOST = 1000
"""Entries that one call returns at most."""
_T = TypeVar("_T")

Ask = Callable[[str, AnyRequest, type[Any]], Any]
"""Asks the agent under a key, lets time pass until it has answered, and returns the answer."""


class TeamSpace:
    """See the module; `Team.space`. Its methods raise what those of a page's `self.space` raise."""

    def __init__(self, ask: Ask) -> None:
        """Made by a team; `live` is its process."""
        self._ask = ask
        self.key = ""
        """Of its agent; empty: it does not live yet."""

    async def live(self, process: SimulatedProcess) -> None:
        """Be the space."""
        loop = asyncio.get_running_loop()
        service = SpaceService(process.transport, SPACE, MemoryStore(SPACE, loop.time))
        await service.start()
        self.key = service.address.key
        await asyncio.Event().wait()

    def write(self, entry: object, *, lease: float = FOR_EVER, key: str = "") -> None:
        """Put an entry into it; `lease` [s]."""
        self._ask(self.key, WriteEntry(entry=entry_of(entry), term=lease, key=key), EntryLeased)

    def read(self, wanted: type[_T], /, **fields: Any) -> _T | None:
        """Return the oldest entry that matches; None: there is none."""
        return next(iter(self._find(wanted, fields, take=False)), None)

    def read_all(self, wanted: type[_T], /, **fields: Any) -> list[_T]:
        """Return the entries that match, the oldest first."""
        return self._find(wanted, fields, take=False, most=MOST)

    def take(self, wanted: type[_T], /, **fields: Any) -> _T | None:
        """As `read`, but take it out."""
        return next(iter(self._find(wanted, fields, take=True)), None)

    def _find(self, wanted: type[_T], fields: dict[str, Any], *, take: bool, most: int = 1) -> list[_T]:
        kind, given = template_of(wanted, fields)
        request = FindEntries(kind=kind, fields=given, take=take, most=most)
        found = self._ask(self.key, request, EntriesFound)
        return [revived(entry, wanted) for _, entry in found.entries]
