"""The groups of a realm, each in a file of its own beside what the realm keeps: `groups/NAME.json`.

Every process of the machine reads them when it needs them, so a new group is known at once, without a message
and without a server. Only its owner can write into the folder. Robots of other machines may be members; the
other machines do not know the group.
"""

from __future__ import annotations

from pathlib import Path

from robotree.files.named import NamedFiles
from robotree.vr.base.errors import BadGroup, NoSuchGroup, VrError
from robotree.vr.base.group import RobotGroup, checked
from robotree.vr.base.policy import PolicyGate
from robotree.vr.network.policy_file import PolicyFile

FOLDER = "groups"
LARGEST = 128 * 1024
"""[B] of one file."""


class GroupFiles(NamedFiles[RobotGroup]):
    """The groups of one realm. `NoSuchGroup`: none has a name; `BadGroup`: it cannot be read or kept."""

    def __init__(self, folder: Path | None) -> None:
        """Take the folder in which the realm keeps its things; None: it keeps nothing, and has no groups."""
        super().__init__(
            folder,
            FOLDER,
            RobotGroup,
            LARGEST,
            check=checked,
            unknown=lambda name, known: NoSuchGroup(group=name, known=", ".join(known) or "none"),
            unusable=lambda name, reason: BadGroup(group=name, reason=reason),
            refusal=VrError,
        )


def groups_beside(gate: PolicyGate) -> GroupFiles:
    """Return the groups of the realm of a policy."""
    return GroupFiles(gate.kept if isinstance(gate, PolicyFile) else None)
