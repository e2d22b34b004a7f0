"""What can go wrong when the dialect is written in another language.

::

    ProtocolError
      LanguageError
        UnknownLanguage   not offered
        TargetTaken       something lies where it should be written
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotree.protocol.errors import ProtocolError

if TYPE_CHECKING:
    from pathlib import Path


class LanguageError(ProtocolError):
    """The dialect was not written."""


class UnknownLanguage(LanguageError):
    """A language that is not offered."""

    def __init__(self, name: str, offered: tuple[str, ...]) -> None:
        self.name, self.offered = name, offered
        super().__init__(f"the dialect is not to be had in {name!r}; there is {', '.join(offered)}")


class TargetTaken(LanguageError):
    """Something lies where the dialect should be written."""

    def __init__(self, target: Path) -> None:
        self.target = target
        super().__init__(f"{target} exists already; name a new folder or file, or remove it")
