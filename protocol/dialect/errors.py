"""Errors when the dialect is written in another language.

::

    ProtocolError
      LanguageError
        UnknownLanguage   not offered
        UnknownBase       no dialect of this name comes with pymavlink
        NoFile            a language of one file was asked for, and a folder was named
        TargetTaken       something lies where it should be written
        NotWritten        the system did not take what was written
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from robotree.protocol.errors import ProtocolError

if TYPE_CHECKING:
    from collections.abc import Generator
    from pathlib import Path


class LanguageError(ProtocolError):
    """The dialect was not written."""


class UnknownLanguage(LanguageError):
    """A language that is not offered."""

    def __init__(self, name: str, offered: tuple[str, ...]) -> None:
        self.name, self.offered = name, offered
        super().__init__(f"the dialect is not to be had in {name!r}; there is {', '.join(offered)}")


class UnknownBase(LanguageError):
    """A base dialect that does not come with pymavlink."""

    def __init__(self, name: str, offered: tuple[str, ...]) -> None:
        self.name, self.offered = name, offered
        super().__init__(f"no base dialect is called {name!r}; there is {', '.join(offered)}")


class NoFile(LanguageError):
    """A folder was named for a language of one file."""

    def __init__(self, target: Path, name: str, suffix: str) -> None:
        self.target = target
        super().__init__(
            f"{target} is a folder, and {name} is one file; name a file such as {target}/robotree{suffix}"
        )


class TargetTaken(LanguageError):
    """Something lies where the dialect should be written."""

    def __init__(self, target: Path) -> None:
        self.target = target
        super().__init__(f"{target} exists already; name a new folder or file, or remove it")


class NotWritten(LanguageError):
    """Something could not be written, as on a full disk."""

    def __init__(self, target: Path, why: str) -> None:
        self.target = target
        super().__init__(f"{target} cannot be written: {why}")


@contextmanager
def writing(target: Path) -> Generator[None]:
    """Have an error of the system inside the block name what was to be written, not what it was copied from.

    Raises:
        NotWritten: there was one.
    """
    try:
        yield
    except OSError as error:
        raise NotWritten(target, error.strerror or str(error)) from error
