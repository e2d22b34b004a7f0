"""Where the processes of one realm on one machine meet, without a server, a port or a lock.

A private folder holds three files for each process, all named after the same *tag* (its process id and a
random number):

    TAG.sock   the socket on which it listens
    TAG.beat   the time of its last sign of life, written by its network thread, read by all
    TAG.held   the keys under which it is present, for processes that it has not greeted yet, one a line; a
               line that begins with - takes one back. The first line is a seal: length and checksum of the
               others, so that a list that was cut is not taken for a short one

A newcomer listens on a hidden name, gives it its visible name, and only then looks who is there: of two that
come at the same moment at least one sees the other. A visible name that refuses a connection is therefore
that of a dead process, and its files are removed. A process that is stopped in the middle of this keeps
nobody out.
"""

from __future__ import annotations

import contextlib
import errno
import os
import re
import stat
import struct
import zlib
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from robotree.vr.base.address import check_name, mark
from robotree.vr.base.errors import RealmUnusable
from robotree.vr.base.principal import user_name
from robotree.vr.base.system import THIS_SYSTEM, Socket, System
from robotree.vr.network.realms import (
    DEFAULT_REALM,
    HELD,
    REALM_VARIABLE,
    SOCKET,
    TAG,
    dial,
    keys_of,
    leads_to,
    listening,
    places,
    process_of,
    realm_folder,
    seal,
    sealed,
)
from robotree.vr.network.shared import ENTRY, FILE, shared_realm

BACKLOG = 4096
"""Connections that may wait for a process that hangs."""

SHORT_LIST = 64
"""Lines that a list of keys may have beside two for each key."""

ABANDONED = 60.0
"""[s] after which a file that was never given its final name is removed."""

_BEAT = ".beat"
_HIDDEN = re.compile(rf"\.({TAG.pattern})")
_MOMENT = struct.Struct("d")


def realm_name(realm: str | None) -> str:
    """Return the realm that was named, else the one of the environment, else the default.

    Raises:
        BadName: it cannot be a name.
    """
    return check_name(realm or os.environ.get(REALM_VARIABLE) or DEFAULT_REALM)


def met(realm: str) -> bool:
    """Whether a realm's folder is there, or a process that made it still runs. Creates no folder."""
    directory = realm_folder(realm)
    return directory.is_dir() or bool(listening(directory))


class Beat:
    """The moment of a process's last sign of life, in a file that the others read."""

    def __init__(self, path: Path, system: System, *, make: bool = False, shared: bool = False) -> None:
        """Open the file; `make` it first, if it is the own one, for a group if the realm is `shared`.

        Raises:
            OSError: it cannot be opened, or made.
        """
        self._system = system
        with system.opening:
            self._handle = system.opened(path, writes=make, makes=make)
            if shared:
                os.fchmod(self._handle, FILE)
            system.owns(self)

    def in_child(self) -> Iterable[int]:
        return (self._handle,)

    def write(self, now: float) -> None:
        """Give a sign of life [s, CLOCK_MONOTONIC]."""
        self._system.pwrite(self._handle, _MOMENT.pack(now), 0)

    def read(self) -> float:
        """Return the moment of the last one [s, CLOCK_MONOTONIC]; long ago if it cannot be read."""
        try:
            return float(_MOMENT.unpack(self._system.pread(self._handle, _MOMENT.size, 0))[0])
        except (OSError, struct.error):
            return 0.0

    def close(self) -> None:
        """Close it. Once."""
        handle, self._handle = self._handle, -1
        self._system.close(handle)


class Rendezvous:
    """The meeting place of one realm, as one process sees it. Its methods may be called in any thread."""

    def __init__(
        self,
        realm: str,
        root: Path | None = None,
        *,
        listed: bool = True,
        system: System = THIS_SYSTEM,
    ) -> None:
        """Make the folder, if it is not there.

        Args:
            realm: a name.
            root: where realms lie; None: where this one lies, see `realm_folder`.
            listed: whether the others find this process here. One that is not listed writes nothing, also
                makes no folder: it sees the others, and they know of it while it is connected to them.
            system: on which this process and the others live.

        Raises:
            RealmUnusable: the folder cannot be made, or somebody else may write into it.
        """
        self.realm, self.listed, self.system = realm, listed, system
        self.directory = root / realm if root else realm_folder(realm)
        self.shared = shared_realm(self.directory)
        """The realm, if several users of this machine share it."""
        if self.shared is not None:
            mark(system.user())
        self._refused = dict[str, int]()
        """Entries of dead processes that only their user can remove, with the numbers of their sockets."""
        if listed:
            self._make_folders()
        self.tag = f"{system.pid()}-{system.chance(4).hex()}"
        self._keys = Counter[str]()
        self._lines = 0
        """Lines in the own list of keys."""
        self._size = self._checksum = 0
        """Of these lines [bytes], for their seal."""
        self._list: tuple[int, int, int] | None = None
        """State of that list after this process has written it; see `_state_of_list`."""
        self._lock = system.lock()
        self._there = False
        self._beat: Beat | None = None

    # -- this process

    def register(self) -> Socket:
        """Listen, and be seen. Called again it replaces what was there: see `registered`.

        Raises:
            RealmUnusable: the folder or a file in it cannot be made.
        """
        self._make_folders()
        hidden = self.directory / f".{self.tag}"
        door: Socket | None = None
        try:
            door = self.system.listen(hidden, BACKLOG)
            if self.shared is not None:
                hidden.chmod(ENTRY)
            with self._lock:
                self._there = True
                before, self._beat = self._beat, None  # the new one may find no room
                if before is not None:
                    before.close()
                self._beat = Beat(self._path(_BEAT), self.system, make=True, shared=self.shared is not None)
                self._beat.write(self.system.now())
                self._write_keys()
                self.system.rename(hidden, self._path(SOCKET))
        except OSError as error:
            if door is not None:
                door.close()
            with contextlib.suppress(OSError):
                self.system.unlink(hidden)
            raise RealmUnusable(realm=self.realm, reason=f"{error}") from None
        return door

    def registered(self) -> bool:
        """Whether others can still find all its files: somebody may have removed or renamed the folder.

        Somebody may also have written into its list of keys.
        """
        if not self.listed:
            return True
        with self._lock:
            found = self._state_of_list()
            return (found is not None and found == self._list) and all(
                self._there_is(self._path(end)) for end in (SOCKET, _BEAT)
            )

    def beat(self, now: float) -> None:
        """Give a sign of life [s, CLOCK_MONOTONIC]."""
        with self._lock:
            if self._beat is not None:
                self._beat.write(now)

    def hold(self, key: str) -> None:
        """Write down that this process is present under a key."""
        with self._lock:
            self._keys[key] += 1
            self._append(key)

    def drop(self, key: str) -> None:
        """Write down that it is so no longer."""
        with self._lock:
            if not self._keys[key]:
                return
            self._keys[key] -= 1
            if not self._keys[key]:
                del self._keys[key]
            if self._lines > 2 * len(self._keys) + SHORT_LIST:
                self._write_keys()
            else:
                self._append(f"-{key}")

    def leave(self) -> None:
        """Remove what belongs to this process. Twice is once."""
        with self._lock:
            there, self._there = self._there, False
            if there:
                self.forget(self.tag)
            if self._beat is not None:
                self._beat.close()
                self._beat = None

    def forsake(self) -> None:
        """In a forked child: what belongs to this process is its parent's."""
        self._there, self._beat = False, None

    # -- the others

    def others(self) -> list[str]:
        """Return the tags of all other processes with an entry, also of those that have ended."""
        found: list[str] = []
        for place in self._places():
            with contextlib.suppress(OSError):
                for name in self.system.names(place):
                    tag = name.removesuffix(SOCKET).removeprefix(".")
                    if not TAG.fullmatch(tag) or tag == self.tag:
                        continue
                    if self.shared is not None and not self._is_told_by_its_user(tag, name):
                        continue
                    if name == f"{tag}{SOCKET}":
                        found.append(tag)
                    elif name == f".{tag}":
                        self._sweep(place / name)
        return sorted(found)

    def dial(self, tag: str, patience: float = 0.0) -> Socket:
        """Connect to another process; as `realms.dial`, but later nothing blocks."""
        line = dial(self.place_of(tag), tag, patience, self.system)
        line.setblocking(False)
        return line

    def leads_to(self, line: Socket, tag: str) -> bool:
        """Whether a connection leads to the process that has a tag, and one that belongs here."""
        if self.system.far_end(line)[0] != process_of(tag):
            return False
        here = leads_to(line, self.place_of(tag), tag, self.system)
        return here and (self.shared is None or self.shared.admits(line))

    def admits(self, line: Socket) -> bool:
        """Whether who has connected belongs here."""
        if self.shared is not None:
            return self.shared.admits(line)
        return self.system.far_end(line)[1] == self.system.user()

    def place_of(self, tag: str) -> Path:
        """Return the folder in which a process has its entry; the own one if it has none."""
        first, *rest = self._places()
        if rest and tag != self.tag and not self._there_is(first / f"{tag}{SOCKET}"):
            return next((place for place in rest if self._there_is(place / f"{tag}{SOCKET}")), first)
        return first

    def beat_of(self, tag: str) -> Beat | None:
        """Return the sign of life of another process; None: it has none."""
        try:
            return Beat(self.place_of(tag) / f"{tag}{_BEAT}", self.system)
        except OSError:
            return None

    def keys_of(self, tag: str) -> list[str] | None:
        """Return the keys under which another process is present; see `realms.keys_of`."""
        return keys_of(self.place_of(tag), tag, self.system)

    def forget(self, tag: str) -> None:
        """Remove the files of a process that has ended."""
        place = self.place_of(tag)
        for end in (SOCKET, _BEAT, HELD):
            try:
                self.system.unlink(place / f"{tag}{end}")
            except OSError:
                if self.shared is not None and end == SOCKET:
                    self._refused[tag] = self._number_of(tag)

    def living(self) -> set[str]:
        """Return the tags of all other processes of the realm that have not ended, entering ones included.

        Somebody may have removed the files of a process; the kernel still knows that it listens. The kernel
        is asked first: what comes into the folder meanwhile is found there. What only has the name of a
        socket is nobody.
        """
        heard = (name for place in self._places() for name in listening(place, self.system))
        listen = {found[1] for name in heard if (found := _HIDDEN.fullmatch(name))}
        seen = {tag for tag in self.others() if self._is_socket(self.place_of(tag) / f"{tag}{SOCKET}")}
        return {tag for tag in (listen | seen) - {self.tag} if self.system.lives(process_of(tag))}

    # -- inside

    def _is_told_by_its_user(self, tag: str, name: str) -> bool:
        """Whether an entry of a shared realm is of the user whose process it names, and may live."""
        if tag in self._refused and self._refused[tag] == self._number_of(tag):
            return False
        return self.shared is not None and self.shared.is_own_entry(tag, name)

    def _number_of(self, tag: str) -> int:
        """Return the number of the socket of an entry: a process that comes back makes another one."""
        try:
            return self.system.status(self.directory / f"{tag}{SOCKET}").st_ino
        except OSError:
            return 0

    def _path(self, end: str) -> Path:
        return self.directory / f"{self.tag}{end}"

    def _places(self) -> list[Path]:
        return places(self.directory, self.system)

    def _there_is(self, path: Path) -> bool:
        try:
            self.system.status(path)
        except OSError:
            return False
        return True

    def _is_socket(self, path: Path) -> bool:
        try:
            return stat.S_ISSOCK(self.system.status(path).st_mode)
        except OSError:
            return False

    def _write_keys(self) -> None:
        """At once: who reads meanwhile reads the old list or the new one."""
        if not self._there:
            return
        self._lines = self._keys.total()
        lines = "".join(f"{key}\n" for key in self._keys.elements()).encode()
        self._size, self._checksum = len(lines), zlib.crc32(lines)
        new = self.directory / f".{self.tag}.new"
        try:
            self._write_whole(new, sealed(lines))
            self.system.rename(new, self._path(HELD))
            self._list = self._state_of_list()
        except OSError:  # the folder is gone, or the disk full; `register` writes them anew
            self._remove_list()

    def _write_whole(self, path: Path, data: bytes) -> None:
        """Write a file anew.

        Raises:
            OSError: it cannot be written whole.
        """
        handle = self.system.opened(path, writes=True, makes=True, empties=True)
        try:
            if self.shared is not None:
                os.fchmod(handle, FILE)
            if self.system.append(handle, data) != len(data):
                raise OSError(errno.ENOSPC, "no space left on device")
        finally:
            self.system.close(handle)

    def _append(self, line: str) -> None:
        """Write one line more: with many keys, all of them would take longer than to make what one names."""
        if not self._there:
            return
        if self._state_of_list() != self._list:
            self._write_keys()
            return
        try:
            handle = self.system.opened(self._path(HELD), writes=True)
        except OSError:
            self._write_keys()
            return
        try:
            whole = self._add(handle, f"{line}\n".encode())
        except OSError:
            whole = False
        finally:
            self.system.close(handle)
        self._list = self._state_of_list()
        if not whole:
            self._remove_list()

    def _add(self, handle: int, line: bytes) -> bool:
        """Put a line at the end, then seal it: until then who reads reads the list without it.

        Returns:
            Whether the list is whole.

        Raises:
            OSError: it cannot be written.
        """
        self._lines += 1
        self._size += len(line)
        self._checksum = zlib.crc32(line, self._checksum)
        packed = seal(self._size, self._checksum)
        system = self.system
        return system.append(handle, line) == len(line) and system.pwrite(handle, packed, 0) == len(packed)

    def _state_of_list(self) -> tuple[int, int, int] | None:
        """Return what changes when somebody writes into the own list of keys, or puts another one there."""
        try:
            found = self.system.status(self._path(HELD))
        except OSError:
            return None
        return found.st_ino, found.st_size, found.st_mtime_ns

    def _remove_list(self) -> None:
        """Have no list at all rather than a wrong one: a process without one is named by each stop."""
        with contextlib.suppress(OSError):
            self.system.unlink(self._path(HELD))

    def _sweep(self, hidden: Path) -> None:
        """Remove what a process left that was killed before it could be seen."""
        with contextlib.suppress(OSError):
            if self.system.unix() - self.system.status(hidden).st_mtime > ABANDONED:
                self.system.unlink(hidden)

    def _make_folders(self) -> None:
        if self.shared is not None:
            try:
                self.shared.prepare()
            except OSError as error:
                reason = f"{error}; ask {user_name(self.shared.owner)}, who shares it"
                raise RealmUnusable(realm=self.realm, reason=reason) from None
            return
        for folder in (self.directory.parent, self.directory):
            try:
                self.system.private_folder(folder)
            except OSError as error:
                reason = f"{error}; set XDG_RUNTIME_DIR to a directory of your own"
                raise RealmUnusable(realm=self.realm, reason=reason) from None
