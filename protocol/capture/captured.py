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
