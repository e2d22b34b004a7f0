"""Values that people name, each in a file of its own: `FOLDER/NAME.json`."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Generic, TypeVar

import msgspec

from robotree.files.opening import read, replace
from robotree.files.private import private_folder

_V = TypeVar("_V", bound=msgspec.Struct)


class NamedFiles(Generic[_V]):
    """The values of one kind. Every process reads them when it needs them. May be used in any thread.

    A value is a Struct with a `name`, which is that of its file: `check` refuses a name that cannot be one.
    """

    def __init__(
        self,
        home: Path | None,
        folder: str,
        kind: type[_V],
        largest: int,
        *,
        check: Callable[[_V], _V],
        unknown: Callable[[str, list[str]], Exception],
        unusable: Callable[[str, str], Exception],
        refusal: type[Exception],
    ) -> None:
        """Read nothing yet.

        Args:
            home: what the realm keeps is in it; None: it keeps nothing, so there are no values.
            folder: of the files, in it.
            kind: of the values.
            largest: [B] of one file.
            check: returns a value that can be one, and raises an error for another.
            unknown: makes the error for a name that no value has, of it and of all names.
            unusable: makes the error for a file that cannot be read or written, of its name and the reason.
            refusal: the class of all these errors: `all` passes over what raises one.
        """
        self._folder = None if home is None else home / folder
        self._called, self._kind, self._largest = folder, kind, largest
        self._check, self._unknown, self._unusable, self._refusal = check, unknown, unusable, refusal

    def names(self) -> list[str]:
        """Return the names of all values, also of those that cannot be read."""
        if self._folder is None:
            return []
        try:
            return sorted(path.stem for path in self._folder.iterdir() if path.suffix == ".json")
        except OSError:
            return []

    def all(self) -> Mapping[str, _V]:
        """Return all values that can be read, by name."""
        found: dict[str, _V] = {}
        for name in self.names():
            with contextlib.suppress(self._refusal):
                found[name] = self.find(name)
        return found

    def find(self, name: str) -> _V:
        """Return one value.

        Raises:
            Exception: what `unknown`, `unusable` or `check` makes.
        """
        path = self._path(name)
        try:
            value = msgspec.json.decode(read(path, self._largest), type=self._kind)
        except FileNotFoundError:
            raise self._unknown(name, self.names()) from None
        except (OSError, msgspec.MsgspecError) as error:
            raise self._unusable(name, f"{path} cannot be read: {error}") from None
        return self._check(msgspec.structs.replace(value, name=name))

    def write(self, value: _V) -> None:
        """Keep a value, instead of the one that had its name.

        Raises:
            Exception: what `unusable` or `check` makes.
        """
        name = str(getattr(self._check(value), "name"))  # noqa: B009 # each kind has one
        if self._folder is None:
            raise self._unusable(name, f"this realm keeps nothing, so it has no {self._called}")
        try:
            private_folder(self._folder)
            replace(self._folder / f"{name}.json", msgspec.json.encode(value))
        except OSError as error:
            raise self._unusable(name, f"{error.filename or self._folder}: {error.strerror}") from None

    def delete(self, name: str) -> None:
        """Forget a value.

        Raises:
            Exception: what `unknown` or `unusable` makes.
        """
        path = self._path(name)
        try:
            path.unlink()
        except FileNotFoundError:
            raise self._unknown(name, self.names()) from None
        except OSError as error:
            raise self._unusable(name, f"{path}: {error.strerror}") from None

    def _path(self, name: str) -> Path:
        names = self.names()
        if self._folder is None or name not in names:
            raise self._unknown(name, names)
        return self._folder / f"{name}.json"
