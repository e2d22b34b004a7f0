"""The keys of a realm's assistants: `assistants.json`, beside what the realm keeps.

A key is 32 random bytes that `robotree assistant invite NAME` prints once. The file has only its hash, until
when it is good, and the name that it proves; what that name may do says the policy.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

import msgspec

from robotree.files import private_folder, read, replace
from robotree.vr.base.errors import AssistantUnknown

FILE: Final = "assistants.json"
LARGEST: Final = 1 << 20
"""[B] of the file."""
GOOD: Final = 90 * 24 * 3600.0
"""[s] for which a key is good."""
BEGIN: Final = "rtk_"
"""Begins each key, so that people and scanners of secrets know it."""


class AssistantKey(msgspec.Struct, frozen=True, omit_defaults=True):
    """The record of an assistant's key; the key itself is not kept."""

    hash: str
    """SHA-256 of the key, in hexadecimal."""
    made: float
    """[s] since 1970."""
    ends: float
    """[s] since 1970."""


class AssistantKeys:
    """The keys of one realm."""

    def __init__(self, folder: Path, unix: Callable[[], float] = time.time) -> None:
        """Take the folder in which the realm keeps its things, and the clock [s since 1970]."""
        self._path, self._unix = folder / FILE, unix

    def all(self) -> Mapping[str, AssistantKey]:
        """Return what is kept of all keys, by the names of their assistants.

        Raises:
            AssistantUnknown: the file cannot be read: then no key is believed.
        """
        try:
            return msgspec.json.decode(read(self._path, LARGEST), type=dict[str, AssistantKey])
        except FileNotFoundError:
            return {}
        except (OSError, msgspec.MsgspecError) as error:
            raise AssistantUnknown(detail=f"the keys of assistants cannot be read: {error}") from None

    def invite(self, name: str) -> str:
        """Make a key for an assistant and return it; one that it had is good no more.

        Raises:
            OSError: it cannot be kept.
        """
        key, now = f"{BEGIN}{secrets.token_urlsafe(32)}", self._unix()
        private_folder(self._path.parent)
        self._write({**self.all(), name: AssistantKey(_hash(key), now, now + GOOD)})
        return key

    def revoke(self, name: str) -> None:
        """Take back the key of an assistant.

        Raises:
            AssistantUnknown: it has none.
        """
        kept = dict(self.all())
        if kept.pop(name, None) is None:
            raise AssistantUnknown(detail=f"no assistant {name} has a key")
        self._write(kept)

    def proved(self, key: str) -> tuple[str, str]:
        """Return the assistant that has a key, and what is kept of the key: `good` tells later of both.

        Raises:
            AssistantUnknown: nobody has it, or it has ended.
        """
        given, found = _hash(key), ""
        for name, kept in self.all().items():
            if hmac.compare_digest(kept.hash, given) and self._unix() < kept.ends:
                found = name
        if not found:
            raise AssistantUnknown(detail="this key is no assistant's, has ended, or was taken back")
        return found, given

    def good(self, name: str, proof: str) -> bool:
        """Return whether an assistant still has the key that it has proved, and no other one.

        Raises:
            AssistantUnknown: the keys cannot be read.
        """
        kept = self.all().get(name)
        return kept is not None and hmac.compare_digest(kept.hash, proof) and self._unix() < kept.ends

    def _write(self, kept: Mapping[str, AssistantKey]) -> None:
        replace(self._path, msgspec.json.format(msgspec.json.encode(kept)))


def _hash(key: str) -> str:
    return hashlib.sha256(key.encode(errors="replace")).hexdigest()
