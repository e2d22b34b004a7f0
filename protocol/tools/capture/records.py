"""The parts of a recording, and the errors of recordings. Pure.

Bytes in a recording never raise: they are counted. Only a file that cannot be used at all raises::

    ProtocolError
      BadRecording     the file cannot be read or written, or lacks what is needed
        NoFrame        the file has no frame that we know
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import msgspec

from robotree.protocol.errors import ProtocolError
from robotree.protocol.messages import fields_of

if TYPE_CHECKING:
    from collections.abc import Collection

    from robotree.protocol.frame import Frame

FIRST_TIME, LAST_TIME = 0, 4_102_444_800_000_000
"""[us] since 1970, until 2100. A clock that was never set begins in 1970; what is later is damage."""
HIDDEN = "<hidden>"
"""The text in place of a secret."""
MOST_SHOWN = 8
"""Ids that an error names."""


class Captured(msgspec.Struct, frozen=True, gc=False):
    """Some bytes that crossed a wire: usually one frame, from a raw stream a piece cut anywhere."""

    data: bytes
    time: int | None = None
    """[us] since 1970; None: the recording has no times."""
    route: str = ""
    """Tells the links of one recording apart; empty: it has only one."""


def plausible_time(time: int) -> bool:
    """Whether something may have been captured at a time, [us] since 1970."""
    return FIRST_TIME <= time < LAST_TIME


def plain_fields(frame: Frame) -> dict[str, Any]:
    """The fields of a frame's message; uint8_t arrays become lists of numbers, and secrets are hidden.

    NaN and infinity stay: msgspec writes them as null, since JSON has neither.
    """
    fields, secrets = fields_of(frame.message), frame.codec.definition.secrets
    plain = {name: [*value] if isinstance(value, bytes) else value for name, value in fields.items()}
    return plain | dict.fromkeys(secrets, HIDDEN)


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
