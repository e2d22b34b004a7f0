"""Where the processes of one realm on one machine meet, without a server and without a port.

A private directory holds one entry for each process: the address of its socket, in a file that the process
keeps locked for as long as it lives. Whoever comes locks the door, sweeps out the entries that nobody holds
any more, dials all others, and writes its own. The lock on the door puts arrivals in order, so of any two
processes the later one dials the earlier one, and never both: two that dial each other can end up split for
ever (zenoh issue 2806; measured with Zenoh 1.10.2).

Beside its entry each process keeps a list of what it has announced. A process that hangs says nothing to the
network, and nothing at all to those who come later; here it is still seen, with all that it holds.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import secrets
import stat
import tempfile
import threading
import time
from collections.abc import Generator, Iterator
from pathlib import Path

from robotree.vr.address import check_name
from robotree.vr.errors import RealmUnusable

REALM_VARIABLE = "ROBOTREE_REALM"
DEFAULT_REALM = "default"

DOOR_LIMIT = 10.0
"""[s] to wait at the door: others hold it for the tenth of a second that dialing takes."""

LONGEST_SOCKET = 100
"""Characters of a path that every Unix takes for a socket; the smallest limit is 104, final zero included."""

_ENTRY = ".entry"
_HELD = ".held"
_NEW = ".new"


def runtime_directory() -> Path:
    """Return where this user's realms lie: private, and gone after a restart of the machine."""
    private = os.environ.get("XDG_RUNTIME_DIR")
    return Path(private) / "robotree" if private else _fallback()


def _fallback() -> Path:
    return Path(tempfile.gettempdir()) / f"robotree-{os.geteuid()}"


def realm_name(realm: str | None) -> str:
    """Return the realm that was named, else the one of the environment, else the default.

    Raises:
        BadName: it cannot be a name.
    """
    return check_name(realm or os.environ.get(REALM_VARIABLE) or DEFAULT_REALM)


def met(realm: str) -> bool:
    """Whether a realm's meeting place is there: somebody has made it, now or once. Looking makes nothing."""
    return (runtime_directory() / realm).is_dir()


class Rendezvous:
    """The meeting place of one realm, as one process sees it."""

    def __init__(self, realm: str, root: Path | None = None) -> None:
        """Make the place, if it is not there.

        Args:
            realm: a name.
            root: where realms lie; None: `runtime_directory()`.

        Raises:
            RealmUnusable: the directory cannot be made, or somebody else may write into it.
        """
        self.realm = realm
        root = root or runtime_directory()
        self.directory = root / realm
        for directory in (root, self.directory):
            self._make_private(directory)
        self._tag = f"{os.getpid()}-{secrets.token_hex(4)}"
        self._lock: int | None = None
        self._held: list[str] = []
        self._holding = threading.Lock()
        self.socket = self._short(self.directory / self._tag)

    @property
    def locator(self) -> str:
        """The address under which this process listens."""
        return f"unixsock-stream/{self.socket}"

    @contextlib.contextmanager
    def door(self, limit: float = DOOR_LIMIT) -> Generator[list[str]]:
        """Lock the door and see who is there; nobody else can come meanwhile.

        Args:
            limit: [s] to wait for whoever holds the door.

        Yields:
            The locators of all living processes that came before.

        Raises:
            RealmUnusable: the door stays locked.
        """
        handle = os.open(self.directory / ".door", os.O_RDWR | os.O_CREAT, 0o600)
        try:
            self._lock_door(handle, limit)
            yield self._living()
        finally:
            os.close(handle)

    def enter(self) -> None:
        """Write the own entry. Only while the door is locked."""
        path = self._entry(self._tag)
        self._lock = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
        fcntl.flock(self._lock, fcntl.LOCK_EX)
        os.write(self._lock, self.locator.encode())

    def leave(self) -> None:
        """Take the own entry back. Twice is once."""
        with self._holding:
            lock, self._lock = self._lock, None
            if lock is not None:
                self._forget(self._tag)
                os.close(lock)

    def hold(self, key: str) -> None:
        """Write down what this process is about to announce. From any thread."""
        with self._holding:
            self._held.append(key)
            self._write_held()

    def let_go(self, key: str) -> None:
        """Strike out what this process has announced no longer. From any thread."""
        with self._holding:
            self._held.remove(key)
            self._write_held()

    def held(self) -> dict[str, int]:
        """Return what all living processes hold: process ids by key. Takes no door, waits for nobody."""
        found: dict[str, int] = {}
        for tag, _ in self._held_entries():
            with contextlib.suppress(OSError):  # it has announced nothing, or left just now
                keys = (self.directory / f"{tag}{_HELD}").read_text().splitlines()
                found.update(dict.fromkeys(keys, int(tag.partition("-")[0])))
        return found

    def _write_held(self) -> None:
        if self._lock is None:
            return
        path = self.directory / f"{self._tag}{_HELD}"
        new = path.with_suffix(_NEW)
        new.write_text("\n".join(self._held))
        new.rename(path)  # at once: whoever reads meanwhile reads the old list or the new one

    def _forget(self, tag: str) -> None:
        for suffix in (_HELD, _NEW, _ENTRY):
            (self.directory / f"{tag}{suffix}").unlink(missing_ok=True)

    def _entry(self, tag: str) -> Path:
        return self.directory / f"{tag}{_ENTRY}"

    def _lock_door(self, handle: int, limit: float) -> None:
        latest = time.monotonic() + limit
        while True:
            with contextlib.suppress(BlockingIOError):
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            if time.monotonic() > latest:
                holder = os.pread(handle, 20, 0).decode(errors="replace").strip()
                raise RealmUnusable(
                    realm=self.realm,
                    reason=f"process {holder} has held the door {self.directory} for {limit:g} s; end it",
                )
            time.sleep(0.01)
        os.ftruncate(handle, 0)
        os.pwrite(handle, str(os.getpid()).encode(), 0)

    def _living(self) -> list[str]:
        """Read the entries that somebody holds; sweep out the others, with the sockets they left behind."""
        return [locator for _, locator in self._held_entries(sweep=True) if locator]

    def _held_entries(self, *, sweep: bool = False) -> Iterator[tuple[str, str]]:
        """Return tag and locator of each entry that somebody holds.

        Args:
            sweep: remove the others. Only while the door is locked: whoever enters holds its entry not yet.
        """
        for path in sorted(self.directory.glob(f"*{_ENTRY}")):
            try:
                handle = os.open(path, os.O_RDWR)
            except FileNotFoundError:
                continue  # it left just now; leaving takes no door
            try:
                # shared: two who look at the entry of a dead process must not take each other for it
                fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                yield path.name.removesuffix(_ENTRY), os.pread(handle, 4096, 0).decode()
            else:
                if sweep:
                    self._sweep(path, os.pread(handle, 4096, 0).decode(errors="replace"))
            finally:
                os.close(handle)

    def _sweep(self, entry: Path, locator: str) -> None:
        tag = entry.name.removesuffix(_ENTRY)
        _, _, socket = locator.partition("/")
        if Path(socket).name == tag:
            Path(socket).unlink(missing_ok=True)
            Path(f"{socket}.lock").unlink(missing_ok=True)
        self._forget(tag)

    def _short(self, wanted: Path) -> Path:
        """Return the path, or one elsewhere if the system does not take so long a path for a socket."""
        if len(os.fsencode(wanted)) <= LONGEST_SOCKET:
            return wanted
        elsewhere = _fallback() / "sockets"
        for directory in (elsewhere.parent, elsewhere):
            self._make_private(directory)
        path = elsewhere / self._tag
        if len(os.fsencode(path)) > LONGEST_SOCKET:
            reason = f"{path} is too long for a socket; set TMPDIR or XDG_RUNTIME_DIR to a shorter path"
            raise RealmUnusable(realm=self.realm, reason=reason)
        return path

    def _make_private(self, directory: Path) -> None:
        try:
            directory.mkdir(mode=0o700, parents=True, exist_ok=True)
            found = directory.lstat()
            if not stat.S_ISDIR(found.st_mode):
                raise NotADirectoryError(f"{directory} is not a directory")
            if found.st_uid != os.geteuid():
                raise PermissionError(f"{directory} belongs to somebody else (user {found.st_uid})")
            if found.st_mode & 0o077:
                directory.chmod(0o700)
        except OSError as error:
            reason = f"{error}; set XDG_RUNTIME_DIR to a directory of your own"
            raise RealmUnusable(realm=self.realm, reason=reason) from None
