"""Where names, keys and addresses that nobody else may have get their chance from.

In production that is the operating system's source of secrets; in the World it is the seed, so that the same
seed gives the same keys.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Generator

Bits = Callable[[int], int]
"""Draws a number of so many random bits."""


def _from_the_system(count: int) -> int:  # `secrets` would take a while to import
    return int.from_bytes(os.urandom(-(-count // 8)), "big") >> -count % 8


_draw: Bits = _from_the_system


def bits(count: int) -> int:
    """Draw a number of `count` random bits."""
    return _draw(count)


def token() -> str:
    """Draw 16 hexadecimal digits that nobody else has drawn."""
    return f"{_draw(64):016x}"


def fraction() -> float:
    """Draw a number from 0 up to but not including 1."""
    return _draw(53) / 2**53


@contextlib.contextmanager
def drawn_from(draw: Bits) -> Generator[None]:
    """Take all chance from another source inside the block, in all threads of this process."""
    global _draw  # noqa: PLW0603 # one source for the whole process: keys are drawn in many places
    before, _draw = _draw, draw
    try:
        yield
    finally:
        _draw = before
