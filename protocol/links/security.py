"""Signing for all links of a process: one key file, one time, one table of streams.

security = Security(Keyring(path), time.time)
async with persisting(security):
    endpoint = Endpoint(link, …, **security.signer_pair(link.controller))
"""

from __future__ import annotations

import asyncio
import logging
import secrets
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Protocol, TypedDict

from robotree.protocol.errors import KeyFileError, KeyRefused
from robotree.protocol.links.keyring import PERSIST_PERIOD
from robotree.protocol.links.url import is_private
from robotree.protocol.signing import KEY_BYTES, UNITS, Key, Signer, SigningTime, StreamTable, Verifier

if TYPE_CHECKING:
    from collections.abc import AsyncGenerator, Callable

    from robotree.protocol.links.heard import HeardFile
    from robotree.protocol.links.keyring import Keyring
    from robotree.protocol.links.link import Link

_log = logging.getLogger(__name__)


class SignerPair(TypedDict):
    """Signer and verifier of an `Endpoint`; both None: the link is not signed."""

    signer: Signer | None
    verifier: Verifier | None


class LinkSecurity(Protocol):
    """Decides which links are signed."""

    @property
    def signed(self) -> bool:
        """Whether links are signed; if not, all frames are accepted."""
        ...

    def signer_pair(self, controller: str) -> SignerPair:
        """Signer and verifier for a link with a controller, by the controller's name (`Link.controller`)."""
        ...

    def renewed(self, controller: str, signer_pair: SignerPair) -> bool:
        """Whether a controller's key has changed since a link got this pair."""
        ...

    def rotate(self, link: Link, signer_pair: SignerPair, secret: bytes, moment: int) -> bool:
        """Take a new key that came over a link, in a frame that was signed with the present key.

        Args:
            link: over which it came.
            signer_pair: of the link.
            secret: of the new key, 32 bytes.
            moment: the sender's signing time; ours is advanced to it, within safe limits.

        Returns:
            Whether the links of the controller need a new pair; else the key is the present one.

        Raises:
            KeyRefused: it is not taken.
        """
        ...


class Unsigned:
    """No link is signed, and all frames are accepted."""

    signed = False

    def signer_pair(self, controller: str) -> SignerPair:  # noqa: ARG002  all are alike
        """Nothing."""
        return SignerPair(signer=None, verifier=None)

    def renewed(self, controller: str, signer_pair: SignerPair) -> bool:  # noqa: ARG002  all are alike
        """Never."""
        return False

    def rotate(self, link: Link, signer_pair: SignerPair, secret: bytes, moment: int) -> bool:  # noqa: ARG002  without a file none matters
        """There is no file in which a key could be kept.

        Raises:
            KeyRefused: always.
        """
        raise KeyRefused("This controller has no key file; start with --key FILE.")


UNSIGNED = Unsigned()
"""For programs without keys."""


class Security:
    """Gives each link its signer and verifier.

    Args:
        keyring: the keys, and where time is persisted.
        clock: the wall clock, Unix time in [s].
        heard: of a controller, what it remembers of the newest time that it has heard; None: nothing.
        first_link: id of the first link, 0 to 255; by chance, so that programs that speak as the same system
            are different streams: else the one whose frame is overtaken by the other's would be refused.

    Raises:
        KeyFileError: the persisted time cannot be read.
    """

    signed = True

    def __init__(
        self,
        keyring: Keyring,
        clock: Callable[[], float],
        *,
        first_link: int = 0,
        heard: HeardFile | None = None,
    ) -> None:
        self._keyring = keyring
        persisted = keyring.persisted()
        self._time = SigningTime(clock, heard=heard)
        if persisted > self._time.now():
            # The wall clock was set back. Go on ahead of all that may have been signed before.
            self._time = SigningTime(clock, persisted + int(PERSIST_PERIOD * UNITS), heard)
        self._heard = heard
        self._streams = StreamTable()
        self._links = first_link
        self._nobodys = Key(secrets.token_bytes(KEY_BYTES))
        """Of controllers that no line of the file matches: with a key file, no link is open."""
        self._trouble = ""

    def signer_pair(self, controller: str) -> SignerPair:
        """The signers of a link with a controller. Every link of ours has an id of its own, modulo 256.

        The key is the one that the file has now; if the file cannot be used, the one that it had before. A
        controller without one gets a key that nobody else has: it hears nobody, and nobody hears it.
        """
        self._refresh()
        key = self._keyring.key_for(controller) or self._nobodys
        link_id, self._links = self._links & 0xFF, self._links + 1
        return SignerPair(
            signer=Signer(key, self._time, link_id), verifier=Verifier(key, self._time, self._streams)
        )

    def renewed(self, controller: str, signer_pair: SignerPair) -> bool:
        """Whether a controller's key has changed since a link got this pair."""
        self._refresh()
        key, verifier = self._keyring.key_for(controller), signer_pair["verifier"]
        return key is not None and (verifier is None or verifier.key.fingerprint != key.fingerprint)

    def rotate(self, link: Link, signer_pair: SignerPair, secret: bytes, moment: int) -> bool:
        """Take a key that came over a link, in a frame that was signed with the link's present one.

        Raises:
            KeyRefused: it is not taken.
        """
        verifier = signer_pair["verifier"]
        if not is_private(link.address):
            raise KeyRefused("A key is taken only over TCP or UDP from this machine; edit the key file.")
        if verifier is None or self._keyring.key_for(link.controller) is None:
            raise KeyRefused("This link has no key that could be replaced; edit the key file.")
        if not any(secret):
            raise KeyRefused("Signing is not switched off over the wire; edit the key file.")
        if Key(secret).fingerprint == verifier.key.fingerprint:
            return False
        self._time.advance(moment)
        try:
            self._keyring.replace(link.controller, verifier.key, secret, self.now)
        except KeyFileError as error:
            _log.warning("a key that came over %s was not taken: %s", link.address, error)
            raise KeyRefused("The key file was changed, or cannot be written; the old key stays.") from error
        return True

    def _refresh(self) -> None:
        try:
            self._keyring.refresh()
        except KeyFileError as error:
            if self._trouble != str(error):
                _log.warning("%s; the keys stay as they were", error)
            self._trouble = str(error)
        else:
            self._trouble = ""

    @property
    def now(self) -> int:
        """The signing time of this moment."""
        return self._time.now()

    def persist(self, moment: int | None = None) -> None:
        """Remember the time, so that a wall clock that is set back does no harm after a restart.

        Waits for other programs that use the file: not for an event loop.

        Args:
            moment: a signing time; None: now. Given one, any thread may call this.

        Raises:
            KeyFileError: it cannot be kept.
        """
        moment = self.now if moment is None else moment
        if self._heard is not None:
            self._heard.reserve(moment)
        self._keyring.persist(moment)


@asynccontextmanager
async def persisting(security: Security, period: float = PERSIST_PERIOD) -> AsyncGenerator[Security]:
    """Have the signing time persisted inside the block, every `period` [s], and at its end.

    Yields:
        What was handed in.

    Raises:
        KeyFileError: the time cannot be kept; without it a restart could be fooled by old recordings.
    """

    async def persist_on() -> None:
        while True:
            await asyncio.sleep(period)
            try:
                await asyncio.to_thread(security.persist, security.now)
            except KeyFileError as error:  # the disk may be full for a while; the links must go on
                _log.warning("%s", error)

    # A folder where nothing can be kept is told before anything is opened. In a thread, here and at the end,
    # because another program may hold the file: the loop has robots to stop meanwhile.
    await asyncio.to_thread(security.persist, security.now)
    keeping = asyncio.get_running_loop().create_task(persist_on(), name="signing time")
    try:
        yield security
    finally:
        keeping.cancel()
        await asyncio.gather(keeping, return_exceptions=True)
        await asyncio.to_thread(security.persist, security.now)
