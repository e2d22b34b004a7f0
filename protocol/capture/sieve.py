"""What of a recording may be kept or sent again: no frame with a secret, and none that commands. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.capture.commanding import commands
from robotree.protocol.capture.framing import Splitter
from robotree.protocol.capture.secrecy import carries_secret, may_carry_secret

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable

    from robotree.protocol.capture.captured import Captured


class Sieve:
    """Lets captured frames pass, but none that carries a secret.

    Args:
        passive: nor one that commands somebody.
    """

    def __init__(self, *, passive: bool = False) -> None:
        self._passive = passive
        self.withheld = 0
        """Frames with a secret that did not pass."""
        self.commands = 0
        """Frames that command and did not pass."""

    def sift(self, records: Iterable[Captured]) -> Generator[Captured]:
        """The records, each without its frames that do not pass; one with nothing left is left out.

        Yields:
            What may be sent or kept.
        """
        for record in records:
            if not self._passive and not may_carry_secret(record.data):
                yield record
                continue
            splitter = Splitter()
            pieces = splitter.feed(record.data) + splitter.flush()
            passing = [piece.data for piece in pieces if not (piece.framed and self._holds_back(piece.data))]
            if passing:
                yield msgspec.structs.replace(record, data=b"".join(passing))

    def _holds_back(self, frame: bytes) -> bool:
        if carries_secret(frame):
            self.withheld += 1
            return True
        commanding = self._passive and commands(frame)
        self.commands += commanding
        return commanding
