"""How a member joins a realm: one short-lived token, used once. Pure.

The token carries a secret, the authority's public key and the hubs. Who joins makes a key, and asks for a
certificate with the secret as proof (HMAC-SHA-256, RFC 2104); the secret itself does not travel again.
"""

from __future__ import annotations

import base64
import hashlib
import hmac
from collections.abc import Mapping

import msgspec
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from robotree.vr.base.address import check_name
from robotree.vr.base.errors import BadName, InvitationRefused
from robotree.vr.sites.certificates import KEY_SIZE, Authority, MemberKind, PublicKey, proves

BEGIN = "robotree-"
"""Begin of each token."""

SECRET_SIZE = 16
"""[bytes]"""

MOST_OPEN = 256
"""Invitations of a realm that may be open at once."""

LONGEST = 2048
"""[bytes] of a request to join."""


class Hub(msgspec.Struct, frozen=True, array_like=True):
    """A router that sites dial."""

    address: str
    """As `tls:HOST:PORT`; `tcp:HOST:PORT` on loopback, for tests."""
    fingerprint: str = ""
    """SHA-256 of its certificate in hexadecimal; empty: of one without."""


class Invitation(msgspec.Struct, frozen=True, array_like=True):
    """What a token carries."""

    realm: str
    authority: PublicKey
    secret: bytes
    name: str
    """Of the member."""
    kind: MemberKind
    ends: float
    """[s since 1970]"""
    hubs: tuple[Hub, ...] = ()

    @property
    def number(self) -> str:
        """What the authority keeps of the secret."""
        return number_of(self.secret)


class OpenInvitation(msgspec.Struct, frozen=True):
    """What the authority keeps of an invitation."""

    name: str
    kind: MemberKind
    ends: float
    """[s since 1970]"""
    days: float
    """For which the certificate will be good."""
    may: tuple[str, ...] = ()
    proof_key: str = ""
    """Key of the HMAC, in hexadecimal; see `key_of`."""


class JoinRequest(msgspec.Struct, frozen=True, array_like=True):
    """A request for a certificate."""

    number: str
    """Of the invitation."""
    key: PublicKey
    proof: bytes
    """HMAC of name and key with the key that follows from the secret."""
    own: bytes
    """Signature of the same with the member's key: it has it."""


_CUT = "this is no token, or a part of one; copy all that `robotree realm invite` has printed"
_encode = msgspec.msgpack.Encoder().encode
_invitation = msgspec.msgpack.Decoder(Invitation)
_request = msgspec.msgpack.Decoder(JoinRequest)


def number_of(secret: bytes) -> str:
    """Return the number of an invitation: nobody finds the secret by it."""
    return hashlib.sha256(b"robotree invitation\0" + secret).hexdigest()[:16]


def key_of(secret: bytes) -> bytes:
    """Return the key of the HMAC that follows from a secret."""
    return hashlib.sha256(b"robotree join\0" + secret).digest()


def token_of(invitation: Invitation) -> str:
    """Return a token that can be pasted into a terminal."""
    body = _encode(invitation)
    check = hashlib.sha256(body).digest()[:4]
    return BEGIN + base64.urlsafe_b64encode(body + check).decode().rstrip("=")


def read_token(token: str, now: float) -> Invitation:
    """Read a token.

    Args:
        token: as it was printed; spaces and line ends that a terminal puts into it do not matter.
        now: [s since 1970].

    Raises:
        InvitationRefused: it is none, was cut, or its time is over.
    """
    text = "".join(token.split())
    try:
        raw = text.removeprefix(BEGIN).encode("ascii")
        packed = base64.urlsafe_b64decode(raw + b"=" * (-len(raw) % 4))
        body, check = packed[:-4], packed[-4:]
        invitation = _invitation.decode(body)
        check_name(invitation.realm)
        check_name(invitation.name)
    except (ValueError, UnicodeError, msgspec.MsgspecError, BadName):
        raise InvitationRefused(reason=_CUT) from None
    if not text.startswith(BEGIN) or hashlib.sha256(body).digest()[:4] != check:
        raise InvitationRefused(reason=_CUT)
    if now >= invitation.ends:
        raise InvitationRefused(reason=_over(now - invitation.ends))
    return invitation


def request_to_join(invitation: Invitation, key: Ed25519PrivateKey) -> bytes:
    """Return the request of who has a token and a new key."""
    public = key.public_key().public_bytes_raw()
    text = _text(invitation.realm, invitation.name, public)
    proof = hmac.digest(key_of(invitation.secret), text, "sha256")
    return _encode(JoinRequest(invitation.number, public, proof, key.sign(text)))


def admitted(
    packed: bytes,
    authority: Authority,
    open_invitations: Mapping[str, OpenInvitation],
    taken: Mapping[str, PublicKey],
    *,
    serial: int,
    now: float,
) -> tuple[str, bytes]:
    """Examine a request to join; return the number of its invitation, which is used now, and a certificate.

    Args:
        packed: the request, as it came.
        authority: of the realm.
        open_invitations: by number.
        taken: the keys of the members by name, of those that are not revoked.
        serial: of the new certificate.
        now: [s since 1970].

    Raises:
        InvitationRefused: it is not good; says why.
    """
    try:
        request = _request.decode(packed[: LONGEST + 1])
    except (ValueError, msgspec.MsgspecError):
        raise InvitationRefused(reason="the request cannot be read") from None
    found = open_invitations.get(request.number)
    if found is None:
        reason = "it was used already, or withdrawn, or is of another realm; ask for a new one"
        raise InvitationRefused(reason=reason)
    if now >= found.ends:
        raise InvitationRefused(reason=_over(now - found.ends))
    text = _text(authority.realm, found.name, request.key)
    proof = hmac.digest(bytes.fromhex(found.proof_key), text, "sha256")
    if not hmac.compare_digest(proof, request.proof):
        raise InvitationRefused(reason="the request does not prove that it has the token")
    if len(request.key) != KEY_SIZE or not proves(request.key, request.own, text):
        raise InvitationRefused(reason="the request does not prove that it has its key")
    if found.name in taken:
        raise InvitationRefused(reason=f"there is a member {found.name} already; ask for another name")
    return request.number, authority.admit(
        found.name, found.kind, request.key, serial=serial, now=now, days=found.days, may=found.may
    )


def _text(realm: str, name: str, key: PublicKey) -> bytes:
    return _encode(("robotree join 1", realm, name, key))


def _over(seconds: float) -> str:
    return f"its time ended {seconds / 60:.0f} minutes ago; ask for a new one"
