"""Tables that remember the newest entries alone. Pure."""

from __future__ import annotations

from typing import TypeVar

K = TypeVar("K")
V = TypeVar("V")


def keep_newest(known: dict[K, V], key: K, value: V, most: int) -> None:
    """Enter a value into a table that has `most` entries at most: the oldest ones make room."""
    known[key] = value
    while len(known) > most:
        del known[next(iter(known))]
