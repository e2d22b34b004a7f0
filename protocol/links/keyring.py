"""Where signing keys lie: a file that only its owner can read, and beside it the time that was last signed.

The file has one line per key, `PATTERN KEY`: the first pattern (`*` and `?` as in a shell) that matches the
address of a link gives the key, 64 hexadecimal digits. Lines that begin with # are for people::

    # the arm in the cell
    tcp:127.0.0.1:*   6f1b…

Several programs of one machine may use one file: the time beside it only ever grows. When a key in it is
replaced, by one of them or by an editor, all find the new one at the next link that they open.
"""

from __future__ import annotations

import hashlib
import secrets
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

from robotree.protocol.errors import KeyFileError, UnmatchedLink
from robotree.protocol.links.keyfile import alone, key_lines, read, replace, state_of, write
from robotree.protocol.links.names import names
from robotree.protocol.signing import KEY_BYTES

if TYPE_CHECKING:
    from pathlib import Path

    from robotree.protocol.signing import Key

PERSIST_PERIOD = 10.0
"""[s] between two calls of `Keyring.persist`: as much may have been signed since the time in the file."""
LOCK_PATIENCE = 0.25
"""[s] in which other programs must unlock the file before a key can be replaced; they lock it for ms."""
PERSIST_PATIENCE = 2.0
"""[s] in which they must unlock it before the time is persisted."""


class Keyring:
    """The keys of one file.

    Args:
        path: the file, readable and writable by nobody but us.
        patience: [s] in which other programs must unlock it before `persist` gives up.

    Raises:
        KeyFileError: others can read it, it holds no key, or a line makes no sense.
    """

    def __init__(self, path: Path, patience: float = PERSIST_PATIENCE) -> None:
        self._path, self._patience = path, patience
        content = read(path)
        self._state = content.state
        self.keys = [(line.pattern, line.key) for line in key_lines(path, content.text)]
        """Patterns and keys, in the order of the file."""
        if not self.keys:
            raise KeyFileError(path, "holds no key; make another file with `robotree wire key FILE`")

    @property
    def _time_path(self) -> Path:
        """Beside the file itself, so that all links to one file find one time."""
        real = self._path.resolve()
        return real.with_name(f"{real.name}.time")

    def key_for(self, address: str) -> Key | None:
        """The key of a link; None: no line matches."""
        return next((key for pattern, key in self.keys if fnmatchcase(address, pattern)), None)

    def pattern_for(self, address: str) -> str:
        """The pattern that gives a link its key; empty: no line matches."""
        return next((pattern for pattern, _ in self.keys if fnmatchcase(address, pattern)), "")

    def require(self, address: str, *, listening: bool) -> None:
        """See that the links of an address will have a key, before one is opened.

        Args:
            address: to be handed to `connect` or `listen`.
            listening: whether it is for `listen`; then all links that may come have to have one.

        Raises:
            UnmatchedLink: they will have none.
            BadUrl: the address means nothing.
        """
        found = [self.key_for(name) is not None for name in names(address, listening=listening)]
        if found and not (all(found) if listening else any(found)):
            raise UnmatchedLink(self._path, address, [pattern for pattern, _ in self.keys])

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
        keys = [(line.pattern, line.key) for line in key_lines(self._path, content.text)]
        present = {pattern for pattern, _ in keys}
        self.keys = keys + [each for each in self.keys if each[0] not in present]
        self._state = content.state

    def replace(self, address: str, old: Key, secret: bytes, last: int) -> str:
        """Give the pattern that matches a link another key, here and in the file; all other lines stay.

        Args:
            address: of the link.
            old: the key that its line must still have.
            secret: of the new key, 32 bytes.
            last: the signing time, which is kept, too.

        Returns:
            The pattern.

        Raises:
            KeyFileError: the file cannot be written, or was changed meanwhile; the key stays as it was.
        """
        real = self._path.resolve()  # a symbolic link stays one
        try:
            with alone(self._path, LOCK_PATIENCE):
                content = read(self._path)
                listed = key_lines(self._path, content.text)
                line = next((each for each in listed if fnmatchcase(address, each.pattern)), None)
                if line is None or line.key.fingerprint != old.fingerprint:
                    raise KeyFileError(self._path, "another key was put in meanwhile; open the link anew")
                self._keep(last)
                replace(real, line.with_secret(content.text, secret))
        except OSError as error:
            raise KeyFileError(self._path, f"cannot be written: {error.strerror}") from error
        self.refresh()
        return line.pattern

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


def secret_of(passphrase: str) -> bytes:
    """The secret that MAVProxy and QGroundControl make of a passphrase: its SHA-256."""
    return hashlib.sha256(passphrase.encode()).digest()
