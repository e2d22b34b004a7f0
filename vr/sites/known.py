"""The sites that belong to a realm, as this machine remembers them: a stop names those that it did not reach.

It is read by each `robotree stop`, also where nothing for keys is installed.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import msgspec

from robotree.files.opening import read
from robotree.vr.base.errors import PolicyUnusable
from robotree.vr.network.policy_file import member_of

FILE = "sites.json"
"""In the folder of a realm's keys."""

LONGEST = 1 << 20
"""[bytes] of the file."""


class KnownSite(msgspec.Struct, frozen=True):
    """A site that was here."""

    name: str
    kind: Literal["person", "site"]
    serial: int
    ends: float
    """[s since 1970] End of its last certificate."""


def read_sites(folder: Path) -> Sequence[KnownSite]:
    """Return the sites that were here, by name.

    Args:
        folder: of the realm's keys.

    Raises:
        OSError: the list cannot be read.
    """
    try:
        return msgspec.json.decode(read(folder / FILE, LONGEST), type=tuple[KnownSite, ...])
    except FileNotFoundError:
        return ()
    except msgspec.MsgspecError as error:
        raise OSError(f"{folder / FILE} is damaged: {error}") from None


def names_of_sites(folder: Path) -> Sequence[str]:
    """Return the names of the sites that were here; one that stands for all, if nobody knows them."""
    try:
        return [site.name for site in read_sites(folder)]
    except OSError as error:
        return [f"of an unknown name ({error})"]


def own_name(folder: Path) -> str:
    """Return the name of this machine among the members of the realm; empty: nobody knows it.

    Args:
        folder: of the realm's keys.
    """
    try:
        member = member_of(folder)
    except PolicyUnusable:
        return ""
    return "" if member is None else member.name
