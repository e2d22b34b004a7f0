"""Who belongs to a realm: certificates that its authority signs, and the list of those that it revoked. Pure.

The authority of a realm is an Ed25519 key (RFC 8032) on the machine where the realm was made. A member is a
person or a site. It makes its own key, which never leaves its machine; the authority signs the public half,
with a name, a kind and an end. What was revoked before its end stands in a list with a number that only
grows, so that an older list cannot take the place of a newer one.

Moments are seconds since 1970 (UTC): certificates outlive a start of the machine.
"""

from __future__ import annotations

import hashlib
from typing import Literal

import msgspec
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from robotree.vr.base.address import check_name
from robotree.vr.base.errors import BadName, NotAMember
from robotree.vr.base.policy import ABOUT

MemberKind = Literal["person", "site"]

DAY = 86_400.0
"""[s]"""

SKEW = 300.0
"""[s] by which the clocks of two machines may differ: a certificate may begin so much later."""

KEY_SIZE = 32
"""[bytes] of a public or private key of Ed25519."""

LONGEST = 1024
"""[bytes] of a certificate."""

MOST_REVOKED = 1 << 14
"""Entries of a list of revoked certificates."""

PublicKey = bytes


class Certificate(msgspec.Struct, frozen=True, array_like=True):
    """What the authority says of a member."""

    realm: str
    name: str
    """Unique among the members of the realm that are not revoked."""
    kind: MemberKind
    key: PublicKey
    """Of the member, Ed25519, 32 bytes."""
    serial: int
    """Unique in the realm for ever."""
    begins: float
    ends: float
    """[s since 1970] in between it is good."""
    may: tuple[str, ...] = ()
    """Roles that the policy knows."""


class Revocations(msgspec.Struct, frozen=True, array_like=True):
    """The certificates that ended before their time."""

    realm: str
    number: int = 0
    """Of two lists the one with the greater number is newer."""
    serials: tuple[int, ...] = ()


class Signed(msgspec.Struct, frozen=True, array_like=True):
    """Something that the authority has signed."""

    body: bytes
    signature: bytes


_encode = msgspec.msgpack.Encoder().encode
_signed = msgspec.msgpack.Decoder(Signed)
_certificate = msgspec.msgpack.Decoder(Certificate)
_revocations = msgspec.msgpack.Decoder(Revocations)
_CERTIFICATE, _REVOCATIONS = b"robotree certificate 1\0", b"robotree revocations 1\0"
"""What is signed begins with what it is, so that no signature counts for something else."""


class Authority:
    """Signs for a realm; lives on the machine where the realm was made."""

    def __init__(self, realm: str, key: Ed25519PrivateKey) -> None:
        """Take the realm's name and the authority's key."""
        self.realm, self._key = realm, key

    @property
    def public(self) -> PublicKey:
        """The half of the key that everybody knows."""
        return self._key.public_key().public_bytes_raw()

    def admit(
        self,
        name: str,
        kind: MemberKind,
        key: PublicKey,
        *,
        serial: int,
        now: float,
        days: float,
        may: tuple[str, ...] = (),
    ) -> bytes:
        """Sign a certificate.

        Args:
            name: of the member.
            kind: person or site.
            key: public half of the member's key.
            serial: that no other certificate of the realm has had.
            now: [s since 1970].
            days: for which it is good.
            may: roles.

        Raises:
            BadName: nobody can have this name.
        """
        certificate = Certificate(self.realm, check_name(name), kind, key, serial, now, now + days * DAY, may)
        return self._sign(_CERTIFICATE, _encode(certificate))

    def revoke(self, before: Revocations, serials: tuple[int, ...]) -> bytes:
        """Sign the list that follows another one.

        Args:
            before: the last list.
            serials: that are revoked from now on, too.
        """
        together = tuple(sorted({*before.serials, *serials}))
        return self._sign(_REVOCATIONS, _encode(Revocations(self.realm, before.number + 1, together)))

    def sign_policy(self, text: bytes) -> bytes:
        """Return the signature of a policy [64 bytes]; `network/policy_file.py` verifies it."""
        return self._key.sign(ABOUT + text)

    def _sign(self, about: bytes, body: bytes) -> bytes:
        return _encode(Signed(body, self._key.sign(about + body)))


class Trust:
    """What a member believes: one authority, and its newest list of revoked certificates."""

    def __init__(self, realm: str, authority: PublicKey) -> None:
        """Believe the authority of a realm; nothing is revoked yet."""
        self.realm, self.authority = realm, authority
        self.revocations = Revocations(realm)
        self.packed = b""
        """The newest list as it was signed, to be handed on; empty: none has come."""

    def certificate(self, packed: bytes, now: float) -> Certificate:
        """Return a certificate that is good now.

        Args:
            packed: as it came.
            now: [s since 1970].

        Raises:
            NotAMember: it is not one of this realm, or not now; says which.
        """
        try:
            certificate = _certificate.decode(self._checked(_CERTIFICATE, packed))
            check_name(certificate.name)
        except (msgspec.MsgspecError, BadName):
            raise NotAMember(who="somebody", reason="its certificate cannot be read") from None
        self.check(certificate, now)
        return certificate

    def check(self, certificate: Certificate, now: float) -> None:
        """Check that a certificate of the authority is good now.

        Raises:
            NotAMember: it is not; says why.
        """
        reason = ""
        if certificate.realm != self.realm:
            reason = f"its certificate is for realm {certificate.realm}"
        elif certificate.serial in self.revocations.serials:
            reason = "its certificate was revoked; the authority can invite it again"
        elif now >= certificate.ends:
            late = (now - certificate.ends) / DAY
            reason = f"its certificate ended {late:.1f} days ago; `robotree realm renew` asks for another one"
        elif now < certificate.begins - SKEW:
            early = certificate.begins - now
            reason = f"its certificate begins in {early:.0f} s; the clock of one of the two machines is wrong"
        elif len(certificate.key) != KEY_SIZE:
            reason = "its key is none"
        if reason:
            raise NotAMember(who=f"{certificate.kind} {certificate.name}", reason=reason)

    def take_revocations(self, packed: bytes) -> bool:
        """Believe a list of revoked certificates, if it is newer; returns whether it is.

        Raises:
            NotAMember: the authority has not signed it.
        """
        try:
            found = _revocations.decode(self._checked(_REVOCATIONS, packed, MOST_REVOKED * 9 + LONGEST))
        except msgspec.MsgspecError:
            raise NotAMember(who="somebody", reason="its list of revocations cannot be read") from None
        if found.realm != self.realm or found.number <= self.revocations.number:
            return False
        self.revocations, self.packed = found, packed
        return True

    def _checked(self, about: bytes, packed: bytes, longest: int = LONGEST) -> bytes:
        """Return what the authority has signed.

        Raises:
            NotAMember: it has not.
            msgspec.MsgspecError: it cannot be read.
        """
        if len(packed) > longest:
            raise NotAMember(who="somebody", reason=f"what it shows has more than {longest} bytes")
        signed = _signed.decode(packed)
        try:
            Ed25519PublicKey.from_public_bytes(self.authority).verify(signed.signature, about + signed.body)
        except (InvalidSignature, ValueError):
            reason = f"the authority of realm {self.realm} has not signed what it shows"
            raise NotAMember(who="somebody", reason=reason) from None
        return signed.body


def claimed(packed: bytes) -> Certificate | None:
    """Return what a certificate says, without believing it; None: it cannot be read."""
    try:
        return _certificate.decode(_signed.decode(packed[: LONGEST + 1]).body)
    except msgspec.MsgspecError:
        return None


def proves(key: PublicKey, signature: bytes, text: bytes) -> bool:
    """Whether a signature of a text was made with a member's key. What comes from a network never raises."""
    try:
        Ed25519PublicKey.from_public_bytes(key).verify(signature, text)
    except (InvalidSignature, ValueError):
        return False
    return True


def fingerprint(key: PublicKey) -> str:
    """Return 16 hexadecimal digits of a key's SHA-256, for people to compare."""
    return hashlib.sha256(key).hexdigest()[:16]
