"""Where programs keep what must survive a restart: `$XDG_STATE_HOME/robotree/`."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import quote

from robotree.files import opened, private_folder
from robotree.tui.errors import NoPlaceForState, StateInUse
from robotree.tui.terminal import note
from robotree.vr.network import realms

DEMOS = "demos"
"""Folder of what demos keep, beside those of the realms."""

NOWHERE = "none"
"""The word instead of a file when nothing shall be kept."""

KEYS = "keys"
"""Folder of the keys of a realm of several machines, in that of the realm."""

state_home = realms.state_home
"""Returns the folder of all realms; looking makes nothing."""

CONTROLLERS = "controllers"
"""Folder of what simulated controllers keep, beside those of the realms: a controller belongs to none."""


def fence_file(given: str, url: str) -> Path | None:
    """Return the file in which a simulated controller keeps which leases it has obeyed.

    Args:
        given: on the command line: a file, `none`, or nothing.
        url: where the controller listens; the file goes by that.

    Returns:
        The file; None: nothing can or shall be kept. A controller on a port that is free by chance keeps
        nothing: the next one there is another robot.
    """
    if given:
        return None if given == NOWHERE else Path(given)
    if url.partition("?")[0].endswith(":0"):
        return None
    path = state_file(CONTROLLERS, f"{quote(url, safe=':@=&')}.json")
    if path is None:
        note("obeyed leases are forgotten at a restart: their folder cannot be made; give --state FILE")
    return path


@contextmanager
def kept_by_one(path: Path | None) -> Generator[None]:
    """Keep a controller's file for this process: of two that share one each forgets what the other obeyed.

    Args:
        path: of the file; None: there is none.

    Raises:
        StateInUse: a controller that runs keeps it.
    """
    lock = None if path is None else _lock_of(path)
    if lock is None:
        yield
        return
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise StateInUse(str(path)) from None
        yield
    finally:
        os.close(lock)


def _lock_of(path: Path) -> int | None:
    """Open the file that is locked; None: there it cannot be, and nor can the leases, as is told then."""
    try:
        return opened(path.with_name(f".{path.name}.lock"), os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW)
    except OSError:
        return None


def state_file(realm: str, name: str) -> Path | None:
    """Return a file of this name in the realm's folder, which is there then; None: it cannot be made.

    What was open to others, as earlier versions made it, is closed to them, and the user is told.
    """
    top = state_home()
    try:
        were_open = [folder for folder in (top, top / realm) if private_folder(folder)]
    except OSError:
        return None
    for folder in were_open:
        note(f"{folder} was open to other users of this machine; from now on only you can enter it")
    return top / realm / name


def needed_file(realm: str, name: str) -> Path:
    """Return the same of what cannot be done without it.

    Raises:
        NoPlaceForState: it cannot be made.
    """
    found = state_file(realm, name)
    if found is None:
        raise NoPlaceForState
    return found


def journal_folder(realm: str, host: str) -> Path | None:
    """Return the folder in which a host keeps its robots; None: it cannot be made."""
    path = state_file(realm, f"hosts/{host}")
    if path is None:
        note(f"the robots of {host} are forgotten when it ends: the folder for them cannot be made")
    return path


def kept_hosts(realm: str) -> frozenset[str]:
    """Return the names of the hosts whose robots are kept; looking makes nothing."""
    return frozenset(path.parent.name for path in (state_home() / realm / "hosts").glob("*/*.log"))


def journal_folders(realm: str) -> list[Path]:
    """Return the folders in which hosts keep robots, also those of a demo; looking makes nothing."""
    return sorted({folder for top in _tops(realm) for folder in _kept_in(top)}) if realm else []


def _tops(realm: str) -> tuple[Path, Path]:
    """Return the folders of a realm: that of a demo of it, which keeps its things apart, and its own."""
    home = state_home()
    return home / DEMOS / realm / home.name / realm, home / realm


def _kept_in(top: Path) -> Iterator[Path]:
    """Find the folders of hosts, and those of their robots in processes of their own, which may be empty."""
    from robotree.vr.journal.kept import APART, PAGE

    yield from (path.parent for path in top.glob("hosts/*/*.log"))
    yield from (path.with_suffix("") for path in top.glob(f"hosts/*/{APART}/*{PAGE}"))


def history_folder(realm: str, robot: str) -> Path | None:
    """Return the folder in which a proxy keeps what its robot did; None: it cannot be made."""
    return state_file(realm, f"robots/{robot}")


def history_files(realm: str) -> dict[tuple[str, str], Path]:
    """Return the files with what robots did, by `host` or `robot` and its name; looking makes nothing.

    Those of a demo of the realm count, too: it keeps them in a folder of its own.
    """
    found = dict[tuple[str, str], Path]()
    if not realm:
        return found
    for top in _tops(realm):
        for role, folder in (("host", "hosts"), ("robot", "robots")):
            for path in sorted(top.glob(f"{folder}/*/history.db")):
                found[role, path.parent.name] = path
    return found


def directory_folder(realm: str, name: str) -> Path:
    """Return the folder with the memory of a directory, which is there then.

    Raises:
        NoPlaceForState: it cannot be made.
    """
    path = needed_file(realm, f"directories/{name}")
    try:
        private_folder(path)
    except OSError:
        raise NoPlaceForState from None
    return path


def directory_folders(realm: str) -> list[Path]:
    """Return the folders of the directories of a realm on this machine; looking makes nothing."""
    return sorted(path.parent for top in _tops(realm) for path in top.glob("directories/*/directory.db"))


def site_of(realm: str) -> str:
    """Return the name of this machine in a realm of several; empty: there is one machine."""
    folder = state_home() / realm / KEYS
    if not (folder / "realm.json").exists():
        return ""
    from robotree.vr.sites.known import own_name

    return own_name(folder)
