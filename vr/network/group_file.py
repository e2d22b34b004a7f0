"""The groups of a realm, each in a file of its own beside what the realm keeps: `groups/NAME.json`.

Every process of the machine reads them when it needs them, so a new group is known at once, without a message
and without a server. Only its owner can write into the folder. Robots of other machines may be members; the
other machines do not know the group.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from pathlib import Path

import msgspec

from robotree.files import private_folder, read, replace
from robotree.vr.base.address import check_name
from robotree.vr.base.errors import BadGroup, NoSuchGroup, VrError
from robotree.vr.base.group import RobotGroup, checked
from robotree.vr.base.policy import PolicyGate
from robotree.vr.network.policy_file import PolicyFile

FOLDER = "groups"
LARGEST = 128 * 1024
"""[B] of one file."""


class GroupFiles:
    """The groups of one realm. May be used in any thread."""

    def __init__(self, folder: Path | None) -> None:
        """Take the folder in which the realm keeps its things; None: it keeps nothing, and has no groups."""
        self._folder = None if folder is None else folder / FOLDER

    def names(self) -> list[str]:
        """Return the names of all groups."""
        if self._folder is None:
            return []
        try:
            return sorted(path.stem for path in self._folder.iterdir() if path.suffix == ".json")
        except OSError:
            return []

    def all(self) -> Mapping[str, RobotGroup]:
        """Return all groups that can be read, by name."""
        found: dict[str, RobotGroup] = {}
        for name in self.names():
            with contextlib.suppress(VrError):
                found[name] = self.find(name)
        return found

    def find(self, name: str) -> RobotGroup:
        """Return one group.

        Raises:
            NoSuchGroup: there is none of this name.
            BadGroup: its file cannot be read.
        """
        path = self._path(name)
        if path is None:
            raise NoSuchGroup(group=name, known="none")
        try:
            group = msgspec.json.decode(read(path, LARGEST), type=RobotGroup)
        except FileNotFoundError:
            raise NoSuchGroup(group=name, known=", ".join(self.names()) or "none") from None
        except (OSError, msgspec.MsgspecError) as error:
            raise BadGroup(group=name, reason=f"{path} cannot be read: {error}") from None
        return checked(msgspec.structs.replace(group, name=name))

    def has(self, name: str) -> bool:
        """Whether there is a group of this name, also one that cannot be read."""
        return name in self.names()

    def write(self, group: RobotGroup) -> None:
        """Keep a group, instead of the one that had its name.

        Raises:
            BadGroup: it cannot be one, or cannot be kept.
        """
        checked(group)
        path = self._path(group.name)
        if path is None:
            raise BadGroup(group=group.name, reason="this realm keeps nothing")
        try:
            private_folder(path.parent)
            replace(path, msgspec.json.encode(group))
        except OSError as error:
            raise BadGroup(group=group.name, reason=f"{path}: {error.strerror}") from None

    def delete(self, name: str) -> None:
        """Forget a group; its members stay as they are.

        Raises:
            NoSuchGroup: there is none of this name.
        """
        path = self._path(name)
        if path is None:
            raise NoSuchGroup(group=name, known="none")
        try:
            path.unlink()
        except FileNotFoundError:
            raise NoSuchGroup(group=name, known=", ".join(self.names()) or "none") from None
        except OSError as error:
            raise BadGroup(group=name, reason=f"{path}: {error.strerror}") from None

    def _path(self, name: str) -> Path | None:
        return None if self._folder is None else self._folder / f"{check_name(name)}.json"


def groups_beside(gate: PolicyGate) -> GroupFiles:
    """Return the groups of the realm of a policy."""
    return GroupFiles(gate.kept if isinstance(gate, PolicyFile) else None)
