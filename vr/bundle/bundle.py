"""One file of an author's source on its way to a host: read here, named by its hash, loaded there."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Self

import msgspec

from robotree.vr.bundle.choice import choose
from robotree.vr.bundle.loader import LIMIT, load_module, make
from robotree.vr.errors import NoSuchFile
from robotree.vr.virtual_robot import VirtualRobot

LARGEST = 1_000_000
"""[bytes] More is no page of Python."""


class Bundle(msgspec.Struct, frozen=True):
    """The source of a virtual robot's class."""

    source: str
    path: str
    """Where its author keeps it; for messages, never opened by a host."""
    wanted: str = ""
    """Name of the class; empty: the only virtual robot in the source."""

    @classmethod
    def read(cls, path: str | Path, wanted: str = "") -> Self:
        """Read a bundle from a file.

        Args:
            path: of the file.
            wanted: name of the class; empty: the only one.

        Raises:
            NoSuchFile: it cannot be read, is too large, or is no text.
        """
        file = Path(path).expanduser()
        try:
            if file.stat().st_size > LARGEST:
                raise NoSuchFile(path=str(path), reason=f"it is larger than {LARGEST // 1000} kB")
            return cls(file.read_text(encoding="utf-8"), str(path), wanted)
        except UnicodeDecodeError:
            raise NoSuchFile(path=str(path), reason="it is not UTF-8 text") from None
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise NoSuchFile(path=str(path), reason=reason) from None

    @property
    def hash(self) -> str:
        """SHA-256 of the source, in hex: its version."""
        return hashlib.sha256(self.source.encode()).hexdigest()

    def load(self, *, limit: float = LIMIT) -> type[VirtualRobot]:
        """Load the class under a private module name. Blocks: not for an event loop.

        Args:
            limit: [s] for the source to run.

        Raises:
            BrokenSource: it does not compile, raises, does not end, or declares its robot wrongly.
            NoVirtualRobot: there is none, or none of the name wanted.
            SeveralVirtualRobots: there are several, and none was named.
        """
        module = load_module(self.source, self.path, self.hash, limit=limit)
        return choose(module, self.path, self.wanted)

    def create(self, name: str, *, limit: float = LIMIT) -> VirtualRobot:
        """Load the class and make a virtual robot of it. Blocks, as `load` does.

        Args:
            name: of the robot.
            limit: [s] for the source to run, and again for the constructor.

        Raises:
            BadName: that cannot be a name.
            BundleError: see `load`.
        """
        return make(self.load(limit=limit), name, self.path, limit=limit)
