"""Pages by their hash: those that a host has, and how it gets others from the hosts that have them.

What comes is the page that was asked for, whoever sends it: its hash is computed anew. Whether it runs is
decided as for any other page (`bundle.admission`).
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import OrderedDict

from msgspec.structs import replace

from robotree.vr.base.address import everyone
from robotree.vr.base.errors import NoSuchBundle, VrError
from robotree.vr.base.principal import Principal
from robotree.vr.base.requests import BundleRead, ReadBundle
from robotree.vr.base.transport import Transport
from robotree.vr.bundle import Bundle
from robotree.vr.bundle.bundle import bundle_of
from robotree.vr.exchange.asking import ask

MOST = 128
"""Pages that are remembered, the latest."""
MOST_BYTES = 64_000_000
"""[bytes] of all of them; the latest stays in any case."""
ANSWERS_WITHIN = 3.0
"""[s] for a host to send a page; another one may have it, too."""
AT_ONCE = 8
"""Hosts that are asked at the same time."""


class KnownBundles:
    """The pages of one host. On its event loop."""

    def __init__(self, transport: Transport, own: str) -> None:
        """Know none; `own` is the key of the host."""
        self._transport, self._own = transport, own
        self._by_hash: OrderedDict[str, Bundle] = OrderedDict()

    def keep(self, bundle: Bundle) -> str:
        """Remember a page; returns its hash."""
        digest = bundle.hash
        self._by_hash[digest] = bundle
        self._by_hash.move_to_end(digest)
        while len(self._by_hash) > 1 and (len(self._by_hash) > MOST or self._size > MOST_BYTES):
            self._by_hash.popitem(last=False)
        return digest

    @property
    def _size(self) -> int:
        return sum(len(one.source) + sum(map(len, one.files.values())) for one in self._by_hash.values())

    def answer(self, request: ReadBundle) -> BundleRead:
        """Answer another host."""
        found = self._by_hash.get(request.hash)
        return BundleRead(page=None if found is None else found.request())

    async def find(self, digest: str, asker: Principal) -> Bundle:
        """Return the page of a hash, from whoever has it.

        Args:
            digest: its hash.
            asker: who wants it: if that is a host, it is asked first. What it has is what it asks for; what
                others have, unsigned, counts as theirs, for they may be on another machine.

        Raises:
            NoSuchBundle: nobody has it who answers.
        """
        if (known := self._by_hash.get(digest)) is not None:
            return known
        hosts = [key for key in self._transport.presence.keys(everyone("host")) if key != self._own]
        hosts.sort(key=lambda key: key != asker.agent)
        for at in range(0, len(hosts), AT_ONCE):
            answers = await asyncio.gather(*(self._ask(key, digest) for key in hosts[at : at + AT_ONCE]))
            for key, page in zip(hosts[at:], answers, strict=False):
                if page is not None:
                    others = page.signed is None and not page.sender and key != asker.agent
                    found = replace(page, sender=f"host {key.split('/')[1]}") if others else page
                    self.keep(found)
                    return found
        raise NoSuchBundle(hash=digest[:16])

    async def _ask(self, key: str, digest: str) -> Bundle | None:
        """Ask a host for a page; None: it has none, or sends another one."""
        with contextlib.suppress(VrError):
            request = ReadBundle(hash=digest)
            answer = await ask(self._transport, key, request, BundleRead, timeout=ANSWERS_WITHIN)
            if answer.page is not None:
                found = bundle_of(answer.page)
                return found if found.hash == digest else None
        return None
