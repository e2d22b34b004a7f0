"""Which keys lie under a pattern, for one key and for many.

Most patterns name what they are about in their first two chunks (`robot/arm-1/*`), nearly all others in the
first (`host/*/*`). Keys and patterns are grouped by these, so that a search does not pass all the others: a
thousand robots cost nothing to who looks for hosts.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from functools import lru_cache
from typing import Generic, TypeVar

T = TypeVar("T")

_NAMED = 2
"""Chunks by which keys are grouped: role and name."""
_ANY = "*"
"""The group of the patterns that name nothing; after a role: of those that name no more than that."""


def matches(pattern: str, key: str) -> bool:
    """Whether a key lies under a pattern: `*` is one chunk, `**` any number of them, none included."""
    if _ANY not in pattern:
        return pattern == key
    return _lies_under(pattern, key)


@lru_cache(4096)
def _lies_under(pattern: str, key: str) -> bool:
    """As `matches`; samples of the same keys come again and again."""
    return _match(_chunks(pattern), key.split("/"))


@lru_cache(4096)
def _chunks(pattern: str) -> list[str]:
    return pattern.split("/")


def _match(pattern: list[str], key: list[str]) -> bool:
    for number, chunk in enumerate(pattern):
        if chunk == "**":
            rest = pattern[number + 1 :]
            return any(_match(rest, key[skipped:]) for skipped in range(number, len(key) + 1))
        if number >= len(key) or chunk not in {_ANY, key[number]}:
            return False
    return len(pattern) == len(key)


@lru_cache(4096)
def _group(pattern: str) -> str:
    """Return the group of a key, or the one in which all keys of a pattern are; `_ANY`: in several."""
    role, *name = _chunks(pattern)[:_NAMED]
    if _ANY in role:
        return _ANY
    return _of_role(role) if name and _ANY in name[0] else "/".join((role, *name))


def _of_role(role: str) -> str:
    """Return the group of all keys of a role."""
    return f"{role}/{_ANY}"


@lru_cache(4096)
def _role_group(key: str) -> str:
    return _of_role(_chunks(key)[0])


class Keys:
    """Keys, each any number of times."""

    def __init__(self) -> None:
        """Begin with none."""
        self._counts: Counter[str] = Counter()
        self._groups: dict[str, set[str]] = {}

    def add(self, key: str) -> bool:
        """Add a key once; returns whether it is new."""
        self._counts[key] += 1
        if self._counts[key] > 1:
            return False
        for group in (_group(key), _role_group(key)):
            self._groups.setdefault(group, set()).add(key)
        return True

    def remove(self, key: str) -> bool:
        """Remove a key once; returns whether it has gone. What is not there stays so."""
        if self._counts[key] > 1:
            self._counts[key] -= 1
            return False
        if not self._counts.pop(key, 0):
            return False
        for name in (_group(key), _role_group(key)):
            group = self._groups[name]
            group.discard(key)
            if not group:
                del self._groups[name]
        return True

    def under(self, pattern: str) -> list[str]:
        """Return the keys under a pattern, in order."""
        group = _group(pattern)
        keys = self._counts if group == _ANY else self._groups.get(group, ())
        return sorted(key for key in keys if matches(pattern, key))

    def __contains__(self, key: str) -> bool:
        return key in self._counts

    def __iter__(self) -> Iterator[str]:
        """Pass each key once."""
        return iter(self._counts)


class Handlers(Generic[T]):
    """Handlers of patterns, by number."""

    def __init__(self) -> None:
        """Begin with none."""
        self._patterns: dict[int, str] = {}
        self._groups: dict[str, dict[int, T]] = {}

    def add(self, number: int, pattern: str, handler: T) -> None:
        """Have a handler for the keys under a pattern."""
        self._patterns[number] = pattern
        self._groups.setdefault(_group(pattern), {})[number] = handler

    def remove(self, number: int) -> str | None:
        """Return the pattern of a handler, which is no more; None: there was none."""
        pattern = self._patterns.pop(number, None)
        if pattern is not None:
            group = self._groups[_group(pattern)]
            del group[number]
            if not group:
                del self._groups[_group(pattern)]
        return pattern

    def of(self, key: str) -> list[T]:
        """Return the handlers of the patterns under which a key lies."""
        return [
            handler
            for group in (_ANY, _role_group(key), _group(key))
            for number, handler in self._groups.get(group, {}).items()
            if matches(self._patterns[number], key)
        ]
