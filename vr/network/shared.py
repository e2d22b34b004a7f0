"""A realm that several users of one machine share: its folder, and who may enter.

    /tmp/robotree-shared-1000/           0755: nobody but its owner can put or exchange anything here
        plant/                           3770: the sockets of a group; nobody removes those of others
        .plant.state/policy.yaml         2750: what the owner says about who may do what

The setgid bit gives each socket the group, the sticky bit leaves it to its user alone. Only members of the
group get to the sockets; at each of them the kernel says who is at the other end, with all groups
(SO_PEERCRED, SO_PEERGROUPS, unix(7)). Without a policy everybody obeys nobody but their own agents.
"""

from __future__ import annotations

import contextlib
import os
import socket
import stat
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from robotree.files import read, replace
from robotree.files.private import shared_folder
from robotree.vr.base.address import Address, user_of
from robotree.vr.base.errors import VrError
from robotree.vr.base.os_files import LONGEST_PATH
from robotree.vr.base.policy import BY_NAME, PolicyGate, PolicyTarget
from robotree.vr.base.principal import user_name
from robotree.vr.base.requests import Listed, decode_event
from robotree.vr.network.policy_file import KEYS, POLICY, PolicyFile, state_of
from robotree.vr.network.realms import owner_of, process_of, realm_folder, state_home

OPEN_TO_ALL: Final = 0o755
MEETING: Final = 0o3770
"""Mode of the folder of sockets: for the group, setgid and sticky."""
STATE: Final = 0o2750
FILE: Final = 0o640
ENTRY: Final = 0o660
"""Modes of what lies there: read by the group; a socket is connected to by who may write it."""

_PEER_GROUPS: Final = 59
"""SO_PEERGROUPS: asm-generic/socket.h."""
_MOST_GROUPS: Final = 256
_NUMBER: Final = struct.Struct("@I")
_CREDENTIALS: Final = struct.Struct("3i")
_LONGEST_TAG: Final = len("/.4194304-01234567") + 1


class SharedRealm:
    """One shared realm, as a process of one of its users sees it."""

    def __init__(self, directory: Path, owner: int) -> None:
        """Take the folder; nothing is made or checked yet.

        Args:
            directory: in which its processes meet.
            owner: number of the user to whom it belongs.
        """
        self.directory, self.owner = directory, owner
        self.state = state_of(directory.name, directory.parent)
        self._group = -1
        self._own: dict[str, bool] = {}
        """Entries that were looked at, and whether each is of the user whose process it names."""

    def prepare(self, group: int = -1) -> None:
        """See that the folders are there; their owner makes them.

        Args:
            group: number of the group, for who makes them; -1: the one that they have.

        Raises:
            OSError: they are not there, or not as they must be.
        """
        if len(os.fsencode(self.directory)) + _LONGEST_TAG > LONGEST_PATH:
            raise OSError(f"{self.directory} is too long a name for sockets; choose a shorter one")
        shared_folder(self.directory.parent, self.owner, OPEN_TO_ALL)
        if group < 0 and self.owner == os.geteuid():
            group = self._kept_group()
        self._group = shared_folder(self.directory, self.owner, MEETING, group)
        shared_folder(self.state, self.owner, STATE, self._group)
        if self.owner == os.geteuid():
            self._spread()

    def admits(self, line: Any) -> bool:
        """Whether who is at the far end of a connection belongs here, as the kernel says."""
        _, user, group = _CREDENTIALS.unpack(
            line.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
        )
        if self._group < 0:  # who only visits has made nothing
            self._group = self.directory.lstat().st_gid
        if user in {self.owner, os.geteuid()} or group == self._group:
            return True
        try:
            packed = line.getsockopt(socket.SOL_SOCKET, _PEER_GROUPS, _MOST_GROUPS * _NUMBER.size)
        except OSError:  # a kernel before 4.13, or more groups than anybody has: the folder decides alone
            return False
        return any(number == self._group for (number,) in _NUMBER.iter_unpack(packed))

    def may_announce(self, user: int, key: str) -> bool:
        """Whether a process of a user may announce a key, or publish under it: see `base/address.py`."""
        return user in (self.owner, user_of(key))

    def is_own_entry(self, tag: str, name: str) -> bool:
        """Whether an entry of the folder is of the user whose process it names; one that has ended may be."""
        known = self._own.get(tag)
        if known is None:
            known = self._look(tag, name)
            if len(self._own) > 1 << 12:
                self._own.clear()
            self._own[tag] = known
        return known

    def _look(self, tag: str, name: str) -> bool:
        try:
            found = (self.directory / name).lstat()
            status = Path(f"/proc/{process_of(tag)}/status").read_text(errors="replace")
        except OSError:
            return True  # it has just gone: who dials it will see
        user = next((line.split()[2] for line in status.splitlines() if line.startswith("Uid:")), "")
        return stat.S_ISSOCK(found.st_mode) and user == str(found.st_uid)

    # -- of the owner

    def _kept_group(self) -> int:
        """Return the group for which the owner made the realm; the folder is gone after a restart."""
        try:
            return int(read(state_home() / self.directory.name / GROUP, 20))
        except (OSError, ValueError):
            return -1

    def _spread(self) -> None:
        """Put the policy that the owner keeps where the others can read it."""
        kept = state_home() / self.directory.name
        for name in (f"{KEYS}/realm.json", POLICY):
            with contextlib.suppress(FileNotFoundError, NotADirectoryError):
                data = read(kept / name, 1 << 20)
                place = self.state / name
                if name != POLICY:
                    shared_folder(place.parent, self.owner, STATE, self._group)
                if not place.exists() or read(place, 1 << 20) != data:
                    replace(place, data, FILE)


def sees_sample(gate: PolicyGate, clock: Callable[[], float], user: int, key: str, body: bytes) -> bool:
    """Whether a user of this machine may hear what is published here.

    Args:
        gate: the policy of the realm.
        clock: [s] on the monotonic clock.
        user: number of the user.
        key: of the sample.
        body: of the sample.
    """
    if (now := clock()) >= gate.due:
        gate.refresh(now)
    if user in (os.geteuid(), gate.owner):
        return True
    address, kinds = Address.parse("/".join(key.split("/", 3)[:3])), tuple[str, ...]()
    if address is not None and address.role == "lookup":
        with contextlib.suppress(VrError):
            if isinstance(news := decode_event(body, key=key), Listed):
                address, kinds = news.listing.address, tuple(news.listing.kinds)
    if address is None or address.role not in BY_NAME["see"].roles:
        return True
    if not kinds and (known := gate.kinds_of.get(address.name)) is not None:
        kinds = known()
    target = PolicyTarget(address.name, address.role, kinds, "", gate.site)
    return gate.may(gate.user(user_name(user)), "see", target).allowed


GROUP: Final = "group"
"""File in what the owner keeps of the realm: the number of the group."""


def group_name(group: int) -> str:
    """Return the name of a group of the machine; one without a name has its number."""
    import grp  # only people ask

    try:
        return grp.getgrgid(group).gr_name
    except KeyError:
        return str(group)


def shared_realm(directory: Path) -> SharedRealm | None:
    """Return the shared realm of a folder; None: it is private."""
    owner = owner_of(directory)
    return None if owner is None else SharedRealm(directory, owner)


def policy_of(realm: str, root: Path | None = None) -> PolicyFile:
    """Return the policy of a realm as this machine knows it, not yet read.

    Args:
        realm: its name.
        root: where realms lie; None: where this one lies.
    """
    shared = shared_realm(root / realm if root else realm_folder(realm))
    if shared is None:
        return PolicyFile(state_of(realm, root))
    return PolicyFile(shared.state, shared.owner, state_home() / realm)
