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

import secrets
from collections import Counter
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

from robotree.protocol.errors import KeyFileError, UnmatchedLink
from robotree.protocol.links.keyfile import alone, key_lines, read, replace, state_of, with_key, write
from robotree.protocol.links.names import names
from robotree.protocol.signing import KEY_BYTES, secret_of

if TYPE_CHECKING:
    from pathlib import Path

    from robotree.protocol.links.keyfile import Content
    from robotree.protocol.signing import Key

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
