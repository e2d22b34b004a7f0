"""What a recording is made of."""

from __future__ import annotations

import msgspec


class Captured(msgspec.Struct, frozen=True, gc=False):
    """Some bytes that crossed a wire: usually one frame, from a raw stream a piece cut anywhere."""

    data: bytes
    time: int | None = None
    """[us] since 1970; None: the recording has no times."""
    route: str = ""
    """Tells the links of one recording apart; empty: it has only one."""


FIRST_TIME, LAST_TIME = 0, 4_102_444_800_000_000
"""[us] since 1970, until 2100. A clock that was never set begins in 1970; what is later is damage."""


def plausible_time(time: int) -> bool:
    """Whether something may have been captured at a time, [us] since 1970."""
    return FIRST_TIME <= time < LAST_TIME
