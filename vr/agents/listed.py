"""Keeps an agent's listing in the lookup services as it is wanted, one change after the other."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from typing import Protocol

from robotree.vr.address import Address
from robotree.vr.description import Listing
from robotree.vr.errors import VrError

_PATIENCE = 5.0
"""[s] for one change; a lookup service that hangs must not keep the others from the next one."""

_log = logging.getLogger(__name__)


class Listings(Protocol):
    """Where agents are listed: what an agent needs of `lookup.registrar.Registrar`."""

    async def enter(self, listing: Listing) -> None:
        """List an agent, or change its listing; renewed until it leaves."""
        ...

    async def leave(self, address: Address) -> None:
        """Take an agent out."""
        ...


class Listed:
    """One agent's listing. `want` may be called at any time, as often as one likes."""

    def __init__(self, listings: Listings | None, address: Address) -> None:
        """Begin unlisted."""
        self._listings, self._address = listings, address
        self._wanted: Listing | None = None
        self._present: Listing | None = None
        self._work: asyncio.Task[None] | None = None

    def want(self, listing: Listing | None) -> None:
        """Say how it should be listed from now on; None: not at all."""
        self._wanted = listing
        if self._work is None and self._listings is not None and not self._same():
            self._work = asyncio.get_running_loop().create_task(self._change(self._listings))

    async def settled(self) -> None:
        """Wait until what is wanted is so."""
        while self._work is not None:
            await asyncio.wait([self._work])

    def _same(self) -> bool:
        return self._wanted == self._present

    async def _change(self, listings: Listings) -> None:
        try:
            while not self._same():
                wanted = self._wanted
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(_PATIENCE):
                        await self._apply(listings, wanted)
                self._present = wanted
        finally:
            self._work = None

    async def _apply(self, listings: Listings, wanted: Listing | None) -> None:
        try:
            if wanted is None:
                await listings.leave(self._address)
            else:
                await listings.enter(wanted)
        except VrError as error:
            _log.warning("%s: %s", self._address.name, error)
