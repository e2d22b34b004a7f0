"""How large a JPEG picture is, from its header (ITU-T T.81, annex B)."""

from __future__ import annotations

_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Second bytes of the markers that begin a frame."""


def jpeg_size(picture: bytes) -> tuple[int, int]:
    """Return width and height [px]; zeros when the bytes are no JPEG."""
    at = 2 if picture[:2] == b"\xff\xd8" else len(picture)
    while at + 9 <= len(picture) and picture[at] == 0xFF:
        marker = picture[at + 1]
        if marker in _FRAMES:
            height, width = (int.from_bytes(picture[at + i : at + i + 2], "big") for i in (5, 7))
            return width, height
        at += 2 + int.from_bytes(picture[at + 2 : at + 4], "big")
    return 0, 0
