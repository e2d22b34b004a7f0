"""The policy of a realm in a file, as each process of the machine reads it: `policy.yaml`.

The file lies beside what the realm keeps, in a folder into which only its owner can write. Every process
looks at it once in `LOOK` seconds, when it is asked something, so a new policy is in force everywhere within
that time, without a message and without a server. A process that knows a policy never takes an older one, nor
none at all, nor one that cannot be used: it says so once, and keeps what it knows. One that begins with a
file that cannot be used obeys nobody but its own agents, and stops.

In a realm with keys the last line of the file is a signature of its authority; who cannot verify it does not
believe the file.
"""

from __future__ import annotations

import logging
import os
import stat
from functools import cached_property
from pathlib import Path
from typing import Final, Literal

import msgspec

from robotree.files.opening import read, replace
from robotree.vr.base.errors import PolicyUnusable, VrError
from robotree.vr.base.permit import PermittedCall
from robotree.vr.base.policy import LONGEST, Person, Policy, PolicyGate
from robotree.vr.base.principal import user_name
from robotree.vr.network.permit_file import PermitFiles
from robotree.vr.network.realms import state_home

POLICY: Final = "policy.yaml"
POLICY_HOME: Final = "ROBOTREE_POLICY_HOME"
"""In the environment: the folder of all policies, for processes that keep their own things elsewhere, as
those of a demo do: who asks and who is asked go by one policy."""

KEYS: Final = "keys"
"""Folder of a realm's keys, beside the policy."""

LOOK: Final = 1.0
"""[s] between two looks at the file."""

SIGNED: Final = "# signed: "
"""Begin of the last line of a signed policy; 128 hexadecimal digits follow."""

_log = logging.getLogger(__name__)


class OwnMember(msgspec.Struct, frozen=True):
    """What a process needs to know of the keys of this machine (`keys/realm.json`)."""

    realm: str
    authority: str
    """Public key, Ed25519, in hexadecimal."""
    name: str
    kind: Literal["person", "site"]


def state_of(realm: str, root: Path | None = None) -> Path:
    """Return the folder in which a realm keeps its policy.

    Args:
        realm: its name.
        root: where realms lie; None: where they usually do.
    """
    if root is not None:
        return root / f".{realm}.state"
    return Path(os.environ.get(POLICY_HOME) or state_home()) / realm


class PolicyFile(PolicyGate):
    """The policy of one realm, read again when it has changed. May be used in any thread."""

    def __init__(self, folder: Path, owner: int | None = None, kept: Path | None = None) -> None:
        """Take the folder in which the file lies; nothing is read yet.

        Args:
            folder: of the file.
            owner: number of the user who shares the realm with others of this machine: the policy is theirs,
                and without one nobody obeys anybody else; None: nobody does.
            kept: folder in which this user keeps what belongs to the realm; None: the same one.
        """
        self.path, self._keys = folder / POLICY, folder / KEYS
        self.owner, self.kept = owner, kept or folder
        self._seen: tuple[int, int, int, int] | None = None
        self.due = 0.0
        self._said = ""

    def refresh(self, now: float) -> None:
        """Read the policy anew if it has changed [now in s]."""
        self.due = now + LOOK
        try:
            found = self.path.stat(follow_symlinks=False)
        except FileNotFoundError:
            self._seen = None
            if self.policy is not None:
                self._say("it was removed; the last one stays in force")
            elif self.owner is not None:
                self._trouble(f"{user_name(self.owner)}, who shares the realm, has set none")
            return
        except OSError as error:
            self._trouble(f"it cannot be read: {error.strerror}")
            return
        seen = found.st_ino, found.st_mtime_ns, found.st_size, found.st_ctime_ns
        if seen == self._seen:
            return
        self._seen = seen
        try:
            self._take(found)
        except (VrError, OSError) as error:
            self._trouble(str(error))

    def _take(self, found: os.stat_result) -> None:
        """Believe what is in the file.

        Raises:
            VrError: it cannot be used.
            OSError: it cannot be read.
        """
        member = member_of(self._keys)
        owner = os.geteuid() if self.owner is None else self.owner
        if found.st_uid != owner or not stat.S_ISREG(found.st_mode):
            raise PolicyUnusable(path=str(self.path), reason=f"it belongs to user {found.st_uid}")
        data = read(self.path, LONGEST)
        policy = checked(data, str(self.path), member)
        if member is not None:
            self.site, self.person = member.name, member.kind == "person"
            self.roles = own_roles(self._keys)
        before = self.policy
        if before is not None and policy.version <= before.version and policy.text != before.text:
            reason = f"its version {policy.version} is not newer than {before.version}, which is in force"
            raise PolicyUnusable(path=str(self.path), reason=reason)
        self.policy, self.data, self.trouble = policy, data, ""

    @cached_property
    def permits(self) -> PermitFiles:
        """The permits of the realm."""
        return PermitFiles(self.path.parent)

    def expect_permit(self, asker: Person, call: PermittedCall) -> None:
        self.permits.expect(asker.assistant, call)

    def offer(self, data: bytes) -> bool:
        policy = checked(data, "the policy of another site", member_of(self._keys))
        if self.policy is not None and policy.version <= self.policy.version:
            return False
        replace(self.kept / POLICY, data, 0o600)
        if self.kept != self.path.parent:
            replace(self.path, data, 0o640)
        self.refresh(self.due)
        return True

    def _trouble(self, reason: str) -> None:
        self._say(reason)
        if self.policy is None:
            self.trouble = f"the policy of the realm cannot be used ({reason}), and only a stop is obeyed"

    def _say(self, reason: str) -> None:
        if reason != self._said:
            self._said = reason
            _log.warning("%s: %s", self.path, reason)


def member_of(keys: Path) -> OwnMember | None:
    """Return who this machine is in a realm with keys; None: it has none.

    Raises:
        PolicyUnusable: what is there cannot be read.
    """
    try:
        return msgspec.json.decode(read(keys / "realm.json", LONGEST), type=OwnMember)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, msgspec.MsgspecError) as error:
        raise PolicyUnusable(
            path=str(keys), reason=f"the keys of the realm cannot be read: {error}"
        ) from None


def own_roles(keys: Path) -> tuple[str, ...]:
    """Return the roles in the own certificate; nobody but this user could write another one there."""
    try:
        body, _ = msgspec.msgpack.decode(read(keys / "certificate", LONGEST), type=tuple[bytes, bytes])
        return tuple(str(role) for role in msgspec.msgpack.decode(body)[7])
    except (OSError, msgspec.MsgspecError, IndexError, TypeError, ValueError):
        return ()


def checked(data: bytes, path: str, member: OwnMember | None) -> Policy:
    """Return the policy in a file.

    Args:
        data: content of the file.
        path: where it lies, for messages.
        member: who this machine is; None: the realm has no keys, and the file needs no signature.

    Raises:
        PolicyUnusable: it is not signed by the authority of the realm, or of another realm.
        BrokenScript: it cannot be understood.
    """
    from robotree.vr.base.policy_reading import read_policy  # most realms have none
    from robotree.vr.network.signed import is_signed

    try:
        text = data.decode()
    except UnicodeDecodeError:
        raise PolicyUnusable(path=path, reason="it is no UTF-8 text") from None
    if member is None:
        return read_policy(text, path)
    body, found, signature = text.rpartition(SIGNED)
    if not found or not is_signed(bytes.fromhex(member.authority), signature.strip(), body.encode()):
        reason = f"the authority of realm {member.realm} has not signed it, or it was changed since then"
        raise PolicyUnusable(path=path, reason=reason)
    policy = read_policy(text, path)
    if policy.realm != member.realm:
        raise PolicyUnusable(path=path, reason=f"it is that of realm {policy.realm}")
    return policy
