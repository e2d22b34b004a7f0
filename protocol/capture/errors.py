"""What can go wrong with recordings.

Bytes in a recording never raise: they are counted. What raises is a file that cannot be used at all::

    ProtocolError
      BadRecording     a file that cannot be read or written, or has not what is needed of it
        NoFrame        a file without any frame that we know
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotree.protocol.errors import ProtocolError

if TYPE_CHECKING:
    from collections.abc import Collection

MOST_SHOWN = 8
"""Ids that an error names."""


class BadRecording(ProtocolError):
    """A recording cannot be used. `name` is its file."""

    def __init__(self, name: str, problem: str) -> None:
        self.name, self.problem = name, problem
        super().__init__(f"{name}: {problem}")


class NoFrame(BadRecording):
    """A recording holds no frame that we know. `strange` are the ids of those that we do not."""

    def __init__(self, name: str, strange: Collection[int] = ()) -> None:
        self.strange = strange
        doubt = "is it a recording, and not compressed?"
        if strange:
            shown = ", ".join(map(str, sorted(strange)[:MOST_SHOWN])) + ", …" * (len(strange) > MOST_SHOWN)
            doubt = f"what it has is of unknown ids ({shown}); name the dialect that has them with --xml"
        super().__init__(name, f"there is no frame in it that we know; {doubt}")
