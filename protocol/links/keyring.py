"""Where signing keys lie: a file that only its owner can read, and beside it the time that was last signed.

The file has one line per key, `PATTERN KEY`: the first pattern (`*` and `?` as in a shell) that matches the
name of a controller (`Link.controller`) gives the key, 64 hexadecimal digits. A line with the very name has
this controller's own key; from any other line each controller's key is derived, so that no two have the same.
Lines that begin with # are for people::

    # the arm in the cell
    tcp:127.0.0.1:5760   6f1b…
    # all others
    tcp:127.0.0.1:*      07c9…

Several programs of one machine may use one file: the time beside it only ever grows. When a key in it is
replaced, by one of them or by an editor, all find the new one at the next link that they open.
"""

from __future__ import annotations

import fcntl
import os
import secrets
import socket
import stat
import time
from collections import Counter
from contextlib import contextmanager, suppress
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, NamedTuple

from robotree.files import opened, own, sync_folder
from robotree.protocol.errors import KeyFileError, UnmatchedLink
from robotree.protocol.links.sockets import name
from robotree.protocol.links.url import parse
from robotree.protocol.signing import KEY_BYTES, Key, secret_of

if TYPE_CHECKING:
    from collections.abc import Generator
    from pathlib import Path

ANY_PORT = (1024, 34567, 65535)
"""Ports of which a listener may take some when it is told to take any."""


def names(text: str) -> list[str]:
    """The names that the controller at an address has, or may have, before its link is open: for its key.

    An address that a person types is not always the name of its controller (`Link.controller`): a host may
    have a name, and a listener may take any port that is free.

    Args:
        text: the address, as it is handed to `connect` or `listen`.

    Returns:
        One of these will be its name. Empty: the host has no address, so there will be no link.

    Raises:
        BadUrl: the address means nothing.
    """
    url = parse(text)
    if url.controller:
        return [url.controller]
    if url.scheme == "serial":
        from robotree.protocol.links import serial

        return [str(serial.read(url))]
    if url.scheme == "can":
        from robotree.protocol.links.can import address

        return [str(address.read(url)).partition("&")[0]]
    host, port = url.host_and_port()
    found: list[str] = []
    with suppress(OSError):
        all_found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        found = list(dict.fromkeys(str(one[4][0]) for one in all_found))
    return [name(url.scheme, (one, each)) for one in found for each in ((port,) if port else ANY_PORT)]


LARGEST = 1_000_000
"""[bytes] of a key file: ten thousand keys."""
_LOOK = 0.002
"""[s] between two attempts to lock a file."""


class State(NamedTuple):
    """Tells whether a file is still the one that was read."""

    device: int
    inode: int
    size: int
    changed: int
    """[ns]"""


class Content(NamedTuple):
    """A file that was read."""

    text: str
    state: State


class Line(NamedTuple):
    """A line with a key."""

    number: int
    """From 0."""
    pattern: str
    key: Key


def key_lines(path: Path, text: str) -> list[Line]:
    """The lines with keys.

    Raises:
        KeyFileError: one makes no sense; it is named by its number.
    """
    stripped = [line.strip() for line in text.splitlines()]
    return [_line(path, i, line) for i, line in enumerate(stripped) if line and not line.startswith("#")]


def with_key(path: Path, text: str, controller: str, secret: bytes) -> str:
    """The text of a whole file with another key for one controller, and everything else as it was.

    Raises:
        KeyFileError: a line makes no sense.
    """
    lines = text.splitlines(keepends=True)
    line = next((each for each in key_lines(path, text) if each.pattern == controller), None)
    if line is None:  # before all others: the first pattern that matches decides
        return f"{controller} {secret.hex()}\n{text}"
    before, pattern, after = lines[line.number].partition(line.pattern)
    lines[line.number] = before + pattern + after.replace(after.strip(), secret.hex())
    return "".join(lines)


def _line(path: Path, number: int, line: str) -> Line:
    pattern, _, digits = line.partition(" ")
    try:
        return Line(number, pattern, Key(bytes.fromhex(digits)))
    except ValueError:  # its text would show the key
        problem = f"line {number + 1} is no pattern and key of {2 * KEY_BYTES} digits"
        raise KeyFileError(path, problem) from None


def read(path: Path) -> Content:
    """Read a file that nobody else may.

    Raises:
        KeyFileError: others can, or nobody.
    """
    try:
        # What is no UTF-8 in a comment, and how lines end, must come back when the file is written again.
        with os.fdopen(
            opened(path, os.O_RDONLY | own(path)), encoding="utf-8", errors="surrogateescape", newline=""
        ) as file:
            status = os.fstat(file.fileno())
            if stat.S_IMODE(status.st_mode) & 0o077:
                raise KeyFileError(path, "others can read it; run chmod 600 on it and change the keys")
            if status.st_uid != os.geteuid():
                raise KeyFileError(path, "it belongs to somebody else; make one of your own")
            if status.st_size > LARGEST:
                raise KeyFileError(path, f"it is larger than {LARGEST // 1000} kB; this is no key file")
            return Content(file.read(LARGEST), _state(status))
    except OSError as error:
        raise KeyFileError(path, f"cannot be read: {error.strerror}") from error


def _state(status: os.stat_result) -> State:
    return State(status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns)


def state_of(path: Path) -> State:
    """How a file is now.

    Raises:
        KeyFileError: there is none, or it cannot be reached.
    """
    try:
        return _state(path.stat())
    except OSError as error:
        raise KeyFileError(path, f"cannot be read: {error.strerror}") from error


@contextmanager
def alone(path: Path, patience: float) -> Generator[None]:
    """Let no other program change a file, or what lies beside it, inside the block.

    Args:
        path: of the file.
        patience: [s] to wait for other programs, which may be stopped while they hold the lock.

    Yields:
        Nothing.

    Raises:
        OSError: it cannot be opened.
        KeyFileError: the others take longer.
    """
    ends = time.monotonic() + patience
    while True:
        with os.fdopen(opened(path), "rb") as ours:
            if not _lock(ours.fileno(), ends):  # released when the file is closed, or we are killed
                problem = f"another program has held it for {patience:g} s; let that go on, or end it"
                raise KeyFileError(path, f"{problem} (fuser {path} names it)")
            if os.path.samestat(os.fstat(ours.fileno()), path.stat()):
                yield
                return
        # While we waited the file was replaced by another one, which others may have locked.


def _lock(descriptor: int, ends: float) -> bool:
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() > ends:
                return False
            time.sleep(_LOOK)  # flock waits for ever or not at all; the caller is in a thread
        else:
            return True


def replace(path: Path, text: str) -> None:
    """Replace a file at once and for good: who reads it, also after a power cut, finds one or the other.

    Raises:
        OSError: it cannot be written.
    """
    draft = path.with_name(f"{path.name}.new")
    draft.unlink(missing_ok=True)  # of a program that was killed
    try:
        write(draft, text)
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)
    with suppress(OSError):  # some file systems cannot; the new file is in its place all the same
        sync_folder(path.parent)


def write(path: Path, text: str) -> None:
    """Write a new file that nobody else can read, for good.

    Raises:
        OSError: it cannot be written, or there is something of this name.
    """
    descriptor = opened(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL)
    with os.fdopen(descriptor, "w", encoding="utf-8", errors="surrogateescape", newline="") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())


PERSIST_PERIOD = 10.0
"""[s] between two calls of `Keyring.persist`: as much may have been signed since the time in the file."""
REPLACE_WITHIN = 0.25
"""[s] in which other programs must unlock the file before a key can be replaced; they lock it for ms."""
PERSIST_WITHIN = 2.0
"""[s] in which they must unlock it before the time is persisted."""


class Keyring:
    """The keys of one file.

    Args:
        path: the file, readable and writable by nobody but us.
        patience: [s] in which other programs must unlock it before `persist` gives up.

    Raises:
        KeyFileError: others can read it, it holds no key, or a line makes no sense.
    """

    def __init__(self, path: Path, patience: float = PERSIST_WITHIN) -> None:
        self._path, self._patience = path, patience
        content = read(path)
        self._state = content.state
        self.keys = self._listed(content)
        """Patterns and keys, in the order of the file."""
        if not self.keys:
            raise KeyFileError(path, "holds no key; make another file with `robotree wire key FILE`")

    @property
    def _time_path(self) -> Path:
        """Beside the file itself, so that all links to one file find one time."""
        real = self._path.resolve()
        return real.with_name(f"{real.name}.time")

    def _listed(self, content: Content) -> list[tuple[str, Key]]:
        keys = [(line.pattern, line.key) for line in key_lines(self._path, content.text)]
        own = Counter(key.fingerprint for pattern, key in keys if "*" not in pattern)
        if own and max(own.values()) > 1:
            problem = "two controllers have the same key, so that a recording of one moves the other"
            raise KeyFileError(self._path, f"{problem}; give each line a key of its own")
        return keys

    def _found(self, controller: str) -> tuple[str, Key]:
        """The first line for a controller.

        Raises:
            LookupError: there is none.
        """
        for pattern, key in self.keys:
            if pattern == controller or fnmatchcase(controller, pattern):
                return pattern, key
        raise LookupError(controller)

    def key_for(self, controller: str) -> Key | None:
        """The key of a controller, by its name; None: no line matches."""
        try:
            pattern, key = self._found(controller)
        except LookupError:
            return None
        return key if pattern == controller else key.of_controller(controller)

    def told(self, controller: str) -> dict[str, str]:
        """The secrets that a program without this file needs for one controller; show them to its owner only.

        Returns:
            `key`: 64 hexadecimal digits. `passphrase`: MAVProxy and QGroundControl make the key of it; it is
            missing if the controller has a key of its own.

        Raises:
            UnmatchedLink: no line matches.
        """
        try:
            pattern, key = self._found(controller)
        except LookupError:
            patterns = [pattern for pattern, _ in self.keys]
            raise UnmatchedLink(self._path, controller, patterns) from None
        if pattern == controller:
            return {"key": key.reveal()}
        phrase = key.passphrase_for(controller)
        return {"passphrase": phrase, "key": secret_of(phrase).hex()}

    def require(self, address: str, *, listening: bool) -> None:
        """See that the controller at an address will have a key, before a link is opened.

        Args:
            address: to be handed to `connect` or `listen`.
            listening: whether it is for `listen`; then each name that it may get has to have one.

        Raises:
            UnmatchedLink: it will have none.
            KeyFileError: its two ends would derive different keys.
            BadUrl: the address means nothing.
        """
        found = names(address)
        known = [self.key_for(name) is not None for name in found]
        if known and not (all(known) if listening else any(known)):
            raise UnmatchedLink(self._path, address, [pattern for pattern, _ in self.keys])
        if found and found[0].startswith("serial:") and found[0] not in dict(self.keys):
            problem = (
                f"{address} has another name at the other end of the line, so that the keys would differ"
            )
            advice = "name the controller at both ends with ?controller=NAME, or give it a line of its own"
            raise KeyFileError(self._path, f"{problem}; {advice}")

    def refresh(self) -> None:
        """Read the file again, if it was changed.

        A pattern that is no longer there keeps its key, behind all others: an editor that has written half of
        the file must not switch signing off. Who means it starts the program again.

        Raises:
            KeyFileError: the file cannot be used as it is now; the keys stay as they were.
        """
        if state_of(self._path) == self._state:
            return
        content = read(self._path)
        keys = self._listed(content)
        present = {pattern for pattern, _ in keys}
        self.keys = keys + [each for each in self.keys if each[0] not in present]
        self._state = content.state

    def replace(self, controller: str, old: Key, secret: bytes, last: int) -> None:
        """Give a controller another key, here and in a line of its own in the file; all other lines stay.

        Args:
            controller: its name.
            old: the key that it must still have.
            secret: of the new key, 32 bytes.
            last: the signing time, which is kept, too.

        Raises:
            KeyFileError: the file cannot be written, or was changed meanwhile, or another controller has the
                new key; the key stays as it was.
        """
        real = self._path.resolve()  # a symbolic link stays one
        try:
            with alone(self._path, REPLACE_WITHIN):
                self.refresh()
                key = self.key_for(controller)
                if key is None or key.fingerprint != old.fingerprint:
                    raise KeyFileError(self._path, "another key was put in meanwhile; open the link anew")
                content = read(self._path)
                text = with_key(self._path, content.text, controller, secret)
                self._listed(content._replace(text=text))
                self._keep(last)
                replace(real, text)
        except OSError as error:
            raise KeyFileError(self._path, f"cannot be written: {error.strerror}") from error
        self.refresh()

    def persisted(self) -> int:
        """The latest signing time that any program of ours has persisted; 0: none has.

        Raises:
            KeyFileError: the file beside the keys is not ours, or holds no time.
        """
        if not self._time_path.exists():
            return 0
        try:
            return int(read(self._time_path).text)
        except ValueError as error:
            raise KeyFileError(self._time_path, "holds no time; remove it") from error

    def persist(self, last: int) -> None:
        """Remember the signing time; call it every `PERSIST_PERIOD` and at the end.

        A later time that another program persisted stays. Waits for other programs: not for an event loop.

        Raises:
            KeyFileError: it cannot be kept, or another program does not unlock the file.
        """
        try:
            with alone(self._path, self._patience):
                self._keep(last)
        except OSError as error:
            raise KeyFileError(self._time_path, f"cannot keep the signing time: {error.strerror}") from error

    def _keep(self, last: int) -> None:
        if last > self.persisted():
            replace(self._time_path, f"{last}\n")

    def __repr__(self) -> str:
        return f"<Keyring {self._path}: {', '.join(pattern for pattern, _ in self.keys)}>"


def create(path: Path, pattern: str = "*", passphrase: str | None = None) -> None:
    """Make a file with one key.

    Args:
        path: of the new file.
        pattern: of the links that it is for.
        passphrase: what MAVProxy and QGroundControl were told to make the key of; None: a key by chance.

    Raises:
        KeyFileError: there is such a file already, or it cannot be written, or the pattern has spaces.
    """
    if not pattern.isascii() or not pattern.split() == [pattern] or pattern.startswith("#"):
        raise KeyFileError(path, f"{pattern!r} is no pattern of addresses; write for example tcp:127.0.0.1:*")
    secret = secrets.token_bytes(KEY_BYTES) if passphrase is None else secret_of(passphrase)
    try:
        write(path, f"{pattern} {secret.hex()}\n")
    except FileExistsError as error:
        raise KeyFileError(path, "exists already; a key is never overwritten") from error
    except OSError as error:
        raise KeyFileError(path, f"cannot be written: {error.strerror}") from error
