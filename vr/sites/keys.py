"""The folder with what a machine knows of a realm: its keys, its members, its hubs and its sites.

    realm.json      name of the realm, key of its authority, hubs, and who this machine is
    member.key      private key of this member; it was made here and is read nowhere else
    certificate     of this member, as the authority signed it
    revocations     newest list of revoked certificates, signed
    sites.json      the sites that belong to the realm, also those that are silent: a stop names them
    authority.key   only where the realm was made: what signs
    members.json    only there: all members, and the invitations that are out

Only this user can enter it. Each file is replaced whole, so that a crash leaves the old one or the new one.
What the authority changes, one process changes at a time.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

import msgspec
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from robotree.files.opening import alone, read, replace, sync_folder
from robotree.files.private import private_folder
from robotree.vr.base.address import check_name
from robotree.vr.base.errors import (
    InvitationRefused,
    KeysExist,
    NoAuthority,
    NoKeys,
    NoSuchMember,
    NotAMember,
)
from robotree.vr.sites.certificates import DAY, KEY_SIZE, Authority, Certificate, MemberKind, Trust
from robotree.vr.sites.handshake import Own
from robotree.vr.sites.invitations import (
    MOST_OPEN,
    SECRET_SIZE,
    Hub,
    Invitation,
    OpenInvitation,
    admitted,
    key_of,
    number_of,
)
from robotree.vr.sites.known import FILE, KnownSite, read_sites

DAYS = 90.0
"""For which a certificate is good, if nobody says otherwise."""

OPEN_FOR = 3600.0
"""[s] for which an invitation is open."""

LONGEST = 1 << 22
"""[bytes] of a file in the folder."""

MOST_SITES = 1024
"""Sites that are remembered."""

_REALM, _KEY, _CERTIFICATE, _REVOKED = "realm.json", "member.key", "certificate", "revocations"
_AUTHORITY, _MEMBERS = "authority.key", "members.json"

T = TypeVar("T")


class _About(msgspec.Struct, frozen=True):
    """Content of realm.json."""

    realm: str
    authority: str
    """Public key, in hexadecimal."""
    name: str
    kind: MemberKind
    hubs: tuple[Hub, ...] = ()


class Member(msgspec.Struct, frozen=True):
    """What the authority knows of a member."""

    name: str
    kind: MemberKind
    key: str
    """Public key, in hexadecimal."""
    serial: int
    ends: float
    """[s since 1970]"""
    may: tuple[str, ...] = ()
    revoked: bool = False
    certificate: str = ""
    """As it was signed, in hexadecimal; empty: an earlier version has not kept it."""


class _Members(msgspec.Struct, frozen=True):
    """Content of members.json."""

    members: tuple[Member, ...] = ()
    invitations: dict[str, OpenInvitation] = {}


class RealmKeys:
    """The folder of one realm. May be used in any thread."""

    def __init__(self, folder: Path) -> None:
        """Read it.

        Raises:
            NoKeys: this machine has no key of the realm.
            NotAMember: what is there cannot be read.
        """
        self.folder = folder
        about = _read(folder / _REALM, _About)
        if about is None:
            raise NoKeys(realm=folder.parent.name)
        self.realm, self.name, self.kind, self.hubs = about.realm, about.name, about.kind, about.hubs
        self.trust = Trust(about.realm, bytes.fromhex(about.authority))
        self.take_revocations()

    @property
    def own(self) -> Own:
        """What this member proves itself with; the newest certificate."""
        key = Ed25519PrivateKey.from_private_bytes(read(self.folder / _KEY, KEY_SIZE))
        return Own(read(self.folder / _CERTIFICATE, LONGEST), key)

    def certificate(self, now: float) -> Certificate:
        """Return the own certificate.

        Raises:
            NotAMember: it is not good any more; says why.
        """
        return self.trust.certificate(self.own.certificate, now)

    def take_revocations(self, packed: bytes = b"") -> bool:
        """Believe and keep a list of revoked certificates; without one, read the list that was kept.

        Returns:
            Whether it is newer than what was known.

        Raises:
            NotAMember: the authority has not signed it.
        """
        if packed:
            if newer := self._believe(packed):
                self._forget_revoked()
            return newer
        with suppress(OSError, NotAMember):
            return self.trust.take_revocations(read(self.folder / _REVOKED, LONGEST))
        return False

    # -- the sites --------------------------------------------------------------------------------

    def sites(self) -> Sequence[KnownSite]:
        """Return the other members that have been here and are not revoked, by name."""
        found = read_sites(self.folder)
        revoked = self.trust.revocations.serials
        return [site for site in found if site.serial not in revoked and site.name != self.name]

    def remember(self, member: Certificate) -> None:
        """Note that a member was here."""
        site = KnownSite(member.name, member.kind, member.serial, member.ends)
        with alone(self.folder / ".lock"):
            known = self.sites()
            others = [one for one in known if one.name != site.name]
            older = any(one.name == site.name and one.serial > site.serial for one in known)
            if site not in known and not older and len(others) < MOST_SITES:
                write(self.folder / FILE, _json(sorted([*others, site], key=lambda one: one.name)))

    def forget(self, name: str) -> bool:
        """Remember a site no longer; returns whether it was known."""
        with alone(self.folder / ".lock"):
            before = read_sites(self.folder)
            others = [one for one in before if one.name != name]
            known = len(others) < len(before)
            if known:
                write(self.folder / FILE, _json(others))
        return known

    # -- the authority ----------------------------------------------------------------------------

    @property
    def is_authority(self) -> bool:
        """Whether the realm was made on this machine."""
        return (self.folder / _AUTHORITY).exists()

    def members(self) -> Sequence[Member]:
        """Return all members, the revoked ones too.

        Raises:
            NoAuthority: only the authority knows them.
        """
        self._authority()
        return (_read(self.folder / _MEMBERS, _Members) or _Members()).members

    def invite(
        self,
        name: str,
        kind: MemberKind,
        *,
        now: float,
        days: float = DAYS,
        may: tuple[str, ...] = (),
    ) -> Invitation:
        """Open an invitation.

        Args:
            name: of the new member.
            kind: of it.
            now: [s since 1970].
            days: for which its certificate will be good.
            may: roles.

        Raises:
            BadName: nobody can have this name.
            NoAuthority: only the authority invites.
            InvitationRefused: the name is taken, or too many invitations are open.
        """
        authority, secret, ends = self._authority(), os.urandom(SECRET_SIZE), now + OPEN_FOR
        invitation = Invitation(self.realm, authority.public, secret, check_name(name), kind, ends, self.hubs)

        def change(known: _Members) -> tuple[_Members, None]:
            if any(member.name == name and not member.revoked for member in known.members):
                reason = f"there is a member {name} already; `robotree realm revoke {name}` ends it"
                raise InvitationRefused(reason=reason)
            invitations = {number: one for number, one in known.invitations.items() if now < one.ends}
            if len(invitations) >= MOST_OPEN:
                raise InvitationRefused(reason=f"{MOST_OPEN} are open already; wait until some have ended")
            invitations[number_of(secret)] = OpenInvitation(name, kind, ends, days, may, key_of(secret).hex())
            return _Members(known.members, invitations), None

        self._change(change)
        return invitation

    def admit(self, packed: bytes, now: float) -> bytes:
        """Answer a request to join: its invitation is used then; returns the certificate.

        Raises:
            NoAuthority: only the authority admits.
            InvitationRefused: the request is not good.
        """
        authority = self._authority()

        def change(known: _Members) -> tuple[_Members, bytes]:
            taken = {one.name: bytes.fromhex(one.key) for one in known.members if not one.revoked}
            serial = 1 + max((one.serial for one in known.members), default=0)
            used, signed = admitted(packed, authority, known.invitations, taken, serial=serial, now=now)
            rest = {number: one for number, one in known.invitations.items() if number != used}
            return _Members((*known.members, self._member(signed, now)), rest), signed

        certificate = self._change(change)
        admitted_one = self.trust.certificate(certificate, now)
        if admitted_one.kind == "site":  # it counts from now on, heard or not
            self.remember(admitted_one)
        return certificate

    def admitted(self) -> Sequence[bytes]:
        """Return the newest certificate of each site that was admitted and is not revoked.

        Raises:
            NoAuthority: only the authority knows them.
        """
        newest = {one.name: one for one in self.members() if one.kind == "site" and not one.revoked}
        return [bytes.fromhex(one.certificate) for one in newest.values() if one.certificate]

    def revoke(self, name: str) -> Sequence[Member]:
        """End a member's certificates now; returns those that it had.

        Raises:
            NoAuthority: only the authority revokes.
            NoSuchMember: nobody has this name.
        """
        authority = self._authority()

        def change(known: _Members) -> tuple[_Members, list[Member]]:
            meant = [member for member in known.members if member.name == name and not member.revoked]
            rest = {number: one for number, one in known.invitations.items() if one.name != name}
            if not meant and len(rest) == len(known.invitations):
                raise NoSuchMember(realm=self.realm, name=name)
            if meant:
                serials = tuple(one.serial for one in meant)
                self._believe(authority.revoke(self.trust.revocations, serials))
            members = tuple(
                msgspec.structs.replace(member, revoked=True) if member in meant else member
                for member in known.members
            )
            return _Members(members, rest), meant

        ended = self._change(change)
        self._forget_revoked()
        return ended

    def renew(self, packed: bytes, now: float, days: float = DAYS) -> bytes:
        """Return a new certificate of a member, in place of one that is still good, for the same key.

        Raises:
            NoAuthority: only the authority renews.
            NotAMember: the old one is not good any more.
        """
        authority, old = self._authority(), self.trust.certificate(packed, now)

        def change(known: _Members) -> tuple[_Members, bytes]:
            serial = 1 + max((one.serial for one in known.members), default=0)
            signed = authority.admit(
                old.name, old.kind, old.key, serial=serial, now=now, days=days, may=old.may
            )
            return _Members((*known.members, self._member(signed, now)), known.invitations), signed

        return self._change(change)

    def replace_certificate(self, packed: bytes, now: float) -> Certificate:
        """Take a new certificate of this member.

        Raises:
            NotAMember: it is not good, or of somebody else.
        """
        certificate = self.trust.certificate(packed, now)
        if certificate.key != self.own.key.public_key().public_bytes_raw():
            raise NotAMember(who=certificate.name, reason="the new certificate is of another key")
        write(self.folder / _CERTIFICATE, packed)
        return certificate

    def sign_policy(self, text: bytes) -> bytes:
        """Return the signature of a policy.

        Raises:
            NoAuthority: only the authority signs one.
        """
        return self._authority().sign_policy(text)

    # -- inside -----------------------------------------------------------------------------------

    def _member(self, packed: bytes, now: float) -> Member:
        """Return what the authority knows of a member by a certificate that it has just signed."""
        one = self.trust.certificate(packed, now)
        return Member(
            one.name, one.kind, one.key.hex(), one.serial, one.ends, one.may, certificate=packed.hex()
        )

    def _believe(self, packed: bytes) -> bool:
        """Believe and keep a list of revoked certificates; returns whether it is newer."""
        if newer := self.trust.take_revocations(packed):
            write(self.folder / _REVOKED, packed)
        return newer

    def _forget_revoked(self) -> None:
        for site in read_sites(self.folder):
            if site.serial in self.trust.revocations.serials:
                self.forget(site.name)

    def _authority(self) -> Authority:
        try:
            key = read(self.folder / _AUTHORITY, KEY_SIZE)
        except OSError:
            raise NoAuthority(realm=self.realm) from None
        return Authority(self.realm, Ed25519PrivateKey.from_private_bytes(key))

    def _change(self, change: Callable[[_Members], tuple[_Members, T]]) -> T:
        with alone(self.folder / ".lock"):
            known, found = change(_read(self.folder / _MEMBERS, _Members) or _Members())
            write(self.folder / _MEMBERS, _json(known))
        return found


def create(folder: Path, realm: str, name: str, hubs: tuple[Hub, ...], *, now: float) -> RealmKeys:
    """Make a realm: its authority, and this machine as its first site.

    Args:
        folder: of its keys; it must not have any.
        realm: its name.
        name: of this site.
        hubs: that sites dial, the first one first.
        now: [s since 1970].

    Raises:
        BadName: no realm, or no site, can have this name.
        KeysExist: there are keys already.
        OSError: the folder cannot be made, or others can enter it.
    """
    check_name(realm)
    check_name(name)
    key, own = Ed25519PrivateKey.generate(), Ed25519PrivateKey.generate()
    authority, public = Authority(realm, key), own.public_key().public_bytes_raw()
    certificate = authority.admit(name, "site", public, serial=1, now=now, days=DAYS)
    member = Member(name, "site", public.hex(), 1, now + DAYS * DAY, certificate=certificate.hex())
    _settle(folder, _About(realm, authority.public.hex(), name, "site", hubs), own, certificate)
    write(folder / _AUTHORITY, key.private_bytes_raw())
    write(folder / _MEMBERS, _json(_Members((member,))))
    return RealmKeys(folder)


def join(
    folder: Path, invitation: Invitation, key: Ed25519PrivateKey, certificate: bytes, *, now: float
) -> RealmKeys:
    """Keep what an invitation has brought.

    Args:
        folder: for the keys of the realm; it must not have any.
        invitation: that was used.
        key: of the new member.
        certificate: that the authority has signed.
        now: [s since 1970].

    Raises:
        KeysExist: there are keys already.
        NotAMember: the certificate is not what was asked for.
        OSError: the folder cannot be made, or others can enter it.
    """
    found = Trust(invitation.realm, invitation.authority).certificate(certificate, now)
    if found.key != key.public_key().public_bytes_raw() or found.name != invitation.name:
        raise NotAMember(who=found.name, reason="the certificate that came is not what was asked for")
    about = _About(
        invitation.realm, invitation.authority.hex(), invitation.name, invitation.kind, invitation.hubs
    )
    _settle(folder, about, key, certificate)
    return RealmKeys(folder)


def expect_room(folder: Path, realm: str) -> None:
    """Check that a realm's keys can be put into a folder.

    Raises:
        KeysExist: there are some already.
    """
    if (folder / _REALM).exists():
        raise KeysExist(realm=realm, folder=str(folder))


def write(path: Path, data: bytes) -> None:
    """Replace a file whole; it is on the disk when this returns.

    Raises:
        OSError: it cannot be written.
    """
    replace(path, data, 0o600)
    with suppress(OSError):  # some file systems cannot; the new file is in its place all the same
        sync_folder(path.parent)


def _settle(folder: Path, about: _About, key: Ed25519PrivateKey, certificate: bytes) -> None:
    private_folder(folder.parent)
    private_folder(folder, strict=True)
    expect_room(folder, about.realm)
    write(folder / _KEY, key.private_bytes_raw())
    write(folder / _CERTIFICATE, certificate)
    write(folder / _REALM, _json(about))  # last: with it the folder counts


def _read(path: Path, kind: type[T]) -> T | None:
    """Return the content of a file; None: there is none.

    Raises:
        NotAMember: it cannot be read.
    """
    try:
        return msgspec.json.decode(read(path, LONGEST), type=kind)
    except FileNotFoundError:
        return None
    except (OSError, msgspec.MsgspecError) as error:
        raise NotAMember(who="this machine", reason=f"{path} cannot be read: {error}") from None


def _json(content: object) -> bytes:
    return msgspec.json.format(msgspec.json.encode(content), indent=2) + b"\n"
