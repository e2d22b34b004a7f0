"""Realms as the command line sees them: which one is meant, who is in it, and a visit for a stop."""

from __future__ import annotations

import contextlib
import os
from collections.abc import AsyncGenerator
from typing import TYPE_CHECKING

from robotree.tui.errors import NothingToAsk, sentence

if TYPE_CHECKING:
    from pathlib import Path

    from robotree.vr.supervision.realm_client import RealmClient


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
    from robotree.vr.network.realms import owner_of, realm_folder, runtime_directory

    found = realm_folder(realm)
    if owner_of(found) is not None:  # what is private there lies apart
        found = runtime_directory() / realm
    try:
        for folder in (found.parent, found):
            private_folder(folder, strict=True)
    except OSError as error:
        reason = f"{sentence(error)}; set XDG_RUNTIME_DIR to a directory of your own"
        raise RealmUnusable(realm=realm, reason=reason) from None
    return found


@contextlib.asynccontextmanager
async def visited(folder: Path) -> AsyncGenerator[RealmClient]:
    """See the realm client of a realm from outside, for a stop: nothing is written, and nobody is waited for.

    Args:
        folder: of the realm.

    Raises:
        RealmUnusable: there are too few descriptors.
        OSError: as above.
        RuntimeError: there are too few threads.
    """
    from robotree.vr.base.envelope import sitting_at, this_terminal
    from robotree.vr.network.local import join
    from robotree.vr.supervision.realm_client import RealmClient

    with sitting_at(this_terminal()):
        transport = await join(folder.name, root=folder.parent, greeting=0, listed=False)
        try:
            realm_client = RealmClient(transport, folder.name)
            try:
                yield realm_client
            finally:
                await realm_client.close()
        finally:
            await transport.close()


def nothing_to_ask(realm: str, *, stopping: bool = False) -> NothingToAsk:
    """Return the error for a realm in which nobody is: it names the realms of this user that have robots."""
    from robotree.vr.network.realms import all_realms, realm_folder, robots_in, runtime_directory

    own, usual = realm_folder(realm), runtime_directory()
    elsewhere: dict[str, list[str]] = {}
    for folder in all_realms():
        if folder != own and (robots := robots_in(folder)):
            root, how = folder.parent, f"--realm {folder.name}"
            if root.name != "robotree":
                how = f"env -u XDG_RUNTIME_DIR robotree {how}"
            elif root not in {own.parent, usual}:
                how = f"XDG_RUNTIME_DIR={root.parent} robotree {how}"
            elsewhere[how] = robots
    return NothingToAsk(realm, elsewhere, stopping=stopping)
