"""Where signing keys lie: a file that only its owner can read, and beside it the time that was last signed.

The file has one line per key, `PATTERN KEY`: the first pattern (`*` and `?` as in a shell) that matches the
address of a link gives the key, 64 hexadecimal digits. Lines that begin with # are for people. A link that no
line matches is not signed::

    # the arm in the cell
    tcp:127.0.0.1:*   6f1b…

Several programs of one machine may use one file: the time beside it only ever grows.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import secrets
import stat
from fnmatch import fnmatchcase
from pathlib import Path

from robotree.protocol.errors import ProtocolError
from robotree.protocol.signing import KEY_BYTES, Key

PERSIST_PERIOD = 10.0
"""[s] between two calls of `Keyring.persist`: as much may have been signed since the time in the file."""


class KeyFileError(ProtocolError):
    """A key file cannot be used. Its content is never part of the message."""

    def __init__(self, path: Path, problem: str) -> None:
        self.path, self.problem = path, problem
        super().__init__(f"{path}: {problem}")


class Keyring:
    """The keys of one file.

    Args:
        path: the file, readable and writable by nobody but us.

    Raises:
        KeyFileError: others can read it, or a line makes no sense.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._time_path = path.with_name(f"{path.name}.time")
        self.keys = [_read_line(path, number, line) for number, line in _lines(path)]
        """Patterns and keys, in the order of the file."""

    def key_for(self, address: str) -> Key | None:
        """The key of a link; None: it is not signed."""
        return next((key for pattern, key in self.keys if fnmatchcase(address, pattern)), None)

    def persisted(self) -> int:
        """The latest signing time that any program of ours has persisted; 0: none has.

        Raises:
            KeyFileError: the file beside the keys is not ours, or holds no time.
        """
        if not self._time_path.exists():
            return 0
        try:
            return int(_read(self._time_path))
        except ValueError as error:
            raise KeyFileError(self._time_path, "holds no time; remove it") from error

    def persist(self, last: int) -> None:
        """Remember the signing time; call it every `PERSIST_PERIOD` and at the end.

        A later time that another program persisted stays.

        Raises:
            KeyFileError: it cannot be kept.
        """
        try:
            with self._path.open("rb") as ours:
                fcntl.flock(ours, fcntl.LOCK_EX)  # let go when the file is closed, or we are killed
                if last > self.persisted():
                    draft = self._time_path.with_name(f"{self._time_path.name}.new")
                    _write(draft, f"{last}\n", os.O_TRUNC)
                    draft.replace(self._time_path)
        except OSError as error:
            raise KeyFileError(self._time_path, f"cannot keep the signing time: {error.strerror}") from error

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
        _write(path, f"{pattern} {secret.hex()}\n", os.O_EXCL)
    except FileExistsError as error:
        raise KeyFileError(path, "exists already; a key is never overwritten") from error
    except OSError as error:
        raise KeyFileError(path, f"cannot be written: {error.strerror}") from error


def secret_of(passphrase: str) -> bytes:
    """The secret that MAVProxy and QGroundControl make of a passphrase: its SHA-256."""
    return hashlib.sha256(passphrase.encode()).digest()


def _lines(path: Path) -> list[tuple[int, str]]:
    stripped = [line.strip() for line in _read(path).splitlines()]
    return [(i, line) for i, line in enumerate(stripped, 1) if line and not line.startswith("#")]


def _read_line(path: Path, number: int, line: str) -> tuple[str, Key]:
    pattern, _, digits = line.partition(" ")
    try:
        return pattern, Key(bytes.fromhex(digits))
    except ValueError:  # its text would show the key
        raise KeyFileError(path, f"line {number} is no pattern and key of {2 * KEY_BYTES} digits") from None


def _read(path: Path) -> str:
    try:
        with path.open(encoding="ascii", errors="replace") as file:
            status = os.fstat(file.fileno())
            if stat.S_IMODE(status.st_mode) & 0o077:
                raise KeyFileError(path, "others can read it; run chmod 600 on it and change the keys")
            if status.st_uid != os.geteuid():
                raise KeyFileError(path, "it belongs to somebody else; make one of your own")
            return file.read()
    except OSError as error:
        raise KeyFileError(path, f"cannot be read: {error.strerror}") from error


def _write(path: Path, text: str, flag: int) -> None:
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | flag, 0o600)
    with os.fdopen(descriptor, "w", encoding="ascii") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
