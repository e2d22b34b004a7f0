"""Whose agent a key names, in a realm that several users of one machine share. Pure.

There every user could announce the key of another one's robot, and be given its orders. So the last part of a
key, which its agent's process draws, ends with the number of its user (`0123456789abcdefu1000`). The kernel
says whose process announces a key: `Mesh` believes no other user than the one whose number is in it. A realm
that its user has alone has no such ends.
"""

from __future__ import annotations

import re
from typing import Final

from robotree.vr.base.chance import token

_MARKED: Final = re.compile(r"(?:caller|[a-z]+/[A-Za-z0-9][A-Za-z0-9_-]{0,63})/[^/]*u(\d{1,10})(?:/.*)?")
"""A key, or that of a sample, which begins with its agent's."""

_mark = ""


def mark(user: int | None) -> None:
    """Have all keys that this process draws from now on end with the number of a user; None: with none."""
    global _mark  # noqa: PLW0603 # a process has one user
    _mark = "" if user is None else f"u{user}"


def unique() -> str:
    """Draw the last part of a key that nobody ever had."""
    return token() + _mark


def user_of(key: str) -> int | None:
    """Return the number of the user whose agent a key names; None: it names none."""
    found = _MARKED.fullmatch(key)
    return None if found is None else int(found[1])
