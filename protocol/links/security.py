"""Signing for all links of a process: one key file, one time, one table of streams.

security = Security(Keyring(path), time.time)
endpoint = Endpoint(link, …, **security.seals(link.address))
…
security.persist()      # every `keyring.PERSIST_PERIOD`, and at the end
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypedDict

from robotree.protocol.signing import Signer, SigningTime, StreamTable, Verifier

if TYPE_CHECKING:
    from collections.abc import Callable

    from robotree.protocol.links.keyring import Keyring


class Seals(TypedDict):
    """What an `Endpoint` needs; both None: the link is not signed."""

    signer: Signer | None
    verifier: Verifier | None


class Security:
    """Hands every link its signer and verifier.

    Args:
        keyring: the keys, and where time is persisted.
        clock: the wall clock, Unix time in [s].

    Raises:
        KeyFileError: the persisted time cannot be read.
    """

    def __init__(self, keyring: Keyring, clock: Callable[[], float]) -> None:
        self._keyring = keyring
        self._time = SigningTime(clock, keyring.persisted())
        self._streams = StreamTable()
        self._links = 0

    def seals(self, address: str) -> Seals:
        """What the link at an address needs. Every link of ours has an id of its own, modulo 256."""
        if (key := self._keyring.key_for(address)) is None:
            return Seals(signer=None, verifier=None)
        link_id, self._links = self._links & 0xFF, self._links + 1
        return Seals(
            signer=Signer(key, self._time, link_id), verifier=Verifier(key, self._time, self._streams)
        )

    def persist(self) -> None:
        """Remember the time, so that a wall clock that is set back does no harm after a restart."""
        self._keyring.persist(self._time.now())
