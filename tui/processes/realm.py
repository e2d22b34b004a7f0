"""Joining a realm: the one place where the supervisor opens a transport."""

from __future__ import annotations

import contextlib
import os
from collections.abc import AsyncGenerator
from typing import TYPE_CHECKING

from robotree.tui.errors import sentence

if TYPE_CHECKING:
    from pathlib import Path

    from robotree.vr.supervision.fleet import Fleet


def chosen(given: str) -> str:
    """Return the realm that was asked for, else that of the environment, else the default one.

    Raises:
        BadName: it cannot be a name.
    """
    from robotree.vr.network.rendezvous import realm_name

    return realm_name(given or None)


READONLY_VARIABLE = "ROBOTREE_READONLY"
_NO = {"", "0", "no", "off", "false"}


def only_looking(*, given: bool) -> bool:
    """Whether what changes robots shall be absent: `--readonly` was given, or the environment says so."""
    return given or os.environ.get(READONLY_VARIABLE, "").strip().lower() not in _NO


def anybody_met(realm: str) -> bool:
    """Whether anybody is in a realm or has been: joining it would make its folder where nobody has."""
    from robotree.vr.network.rendezvous import met

    return met(realm)


def folder_of(realm: str) -> Path:
    """Return the folder in which a realm's processes meet, made if need be; only its owner can enter it.

    Raises:
        RealmUnusable: it cannot be made, or belongs to somebody else.
    """
    from robotree.files import private_folder
    from robotree.vr.base.errors import RealmUnusable
    from robotree.vr.network.rendezvous import runtime_directory

    top = runtime_directory()
    try:
        for folder in (top, top / realm):
            private_folder(folder)
    except OSError as error:
        reason = f"{sentence(error)}; set XDG_RUNTIME_DIR to a directory of your own"
        raise RealmUnusable(realm=realm, reason=reason) from None
    return top / realm


@contextlib.asynccontextmanager
async def joined(realm: str, *, looking: bool = True) -> AsyncGenerator[Fleet]:
    """Join a realm and see its fleet; leave when the block ends.

    Args:
        realm: its name.
        looking: wait until those who are there have answered. A stop is given without that.

    Raises:
        TransportError: the realm cannot be joined.
    """
    from robotree.vr.network.local import join
    from robotree.vr.network.mesh import GREETING
    from robotree.vr.supervision.fleet import Fleet

    transport = await join(realm, greeting=GREETING if looking else 0)
    try:
        fleet = Fleet(transport)
        if looking:
            await fleet.start()
        try:
            yield fleet
        finally:
            await fleet.close()
    finally:
        await transport.close()
