"""Which keys lie under a pattern."""

from __future__ import annotations


def matches(pattern: str, key: str) -> bool:
    """Whether a key lies under a pattern: `*` is one chunk, `**` any number of them, none included."""
    return _match(pattern.split("/"), key.split("/"))


def _match(pattern: list[str], key: list[str]) -> bool:
    if not pattern:
        return not key
    if pattern[0] == "**":
        return any(_match(pattern[1:], key[skipped:]) for skipped in range(len(key) + 1))
    return bool(key) and pattern[0] in {"*", key[0]} and _match(pattern[1:], key[1:])
