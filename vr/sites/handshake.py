"""How two gateways prove to each other that they belong to the realm, and agree on keys. Pure.

Three messages, as in SIGMA (Krawczyk, 2003): each side sends a new X25519 half (RFC 7748) with its
certificate, and signs both halves, both certificates and both roles with its member key. Keys follow by HKDF
(RFC 5869) from the shared secret, salted with the hash of all that was said. So a router between them can
drop, and nothing else.

    1 initiator → responder   half, certificate, the session that it still has
    2 responder → initiator   half, certificate, signature
    3 initiator → responder   signature

Who has a session and only lost the way keeps it: the initiator names it, and a responder that has it, too,
does not answer. So the cut of a link loses nothing, and only the restart of a gateway makes new keys.

Memory is bounded: nothing is kept of a message whose certificate is not good, and of one that is at most
`MOST_BEGUN` halves in all.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import NamedTuple

import msgspec
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey, X25519PublicKey
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

from robotree.vr.base.errors import NotAMember
from robotree.vr.sites.certificates import Certificate, Trust, proves
from robotree.vr.sites.sealing import ID_SIZE, Sealing

MOST_BEGUN = 64
"""Handshakes that a responder has begun and not ended; of more, the oldest are forgotten."""

OF_ONE = 4
"""Of these: of one member, so that nobody who shows a stranger's certificate pushes all others out."""

PATIENCE = 5.0
"""[s] after which a handshake that has not ended is void."""

LONGEST = 4096
"""[bytes] of a message."""

KnowsSession = Callable[[str, bytes], bool]
"""Whether a session with a member is there, by its name and id."""

Chance = Callable[[int], bytes]
"""Draws so many bytes that nobody can guess."""


class Greeting(msgspec.Struct, frozen=True, array_like=True, tag=1):
    """The first message."""

    half: bytes
    certificate: bytes
    session: bytes
    """The session that the initiator still has with the responder; empty: none."""


class GreetingAnswer(msgspec.Struct, frozen=True, array_like=True, tag=2):
    """The second one."""

    to: bytes
    """Half of the initiator."""
    half: bytes
    certificate: bytes
    signature: bytes


class Proof(msgspec.Struct, frozen=True, array_like=True, tag=3):
    """The third one."""

    to: bytes
    """Half of the responder."""
    signature: bytes


_Message = Greeting | GreetingAnswer | Proof
_encode = msgspec.msgpack.Encoder().encode
_decoder: msgspec.msgpack.Decoder[_Message] = msgspec.msgpack.Decoder(_Message)


class Established(NamedTuple):
    """A session with a member that has proved who it is."""

    member: Certificate
    sealing: Sealing


class HandshakeStep(NamedTuple):
    """What follows from a message."""

    answer: bytes = b""
    """To be sent to the other side; empty: nothing."""
    to: str = ""
    """Name of the member that it is for."""
    established: Established | None = None
    """Both sides have proved who they are; it can be used now."""


class Own(NamedTuple):
    """What a member proves itself with."""

    certificate: bytes
    key: Ed25519PrivateKey


class _Begun(NamedTuple):
    secret: X25519PrivateKey
    since: float
    """[s] on this machine's monotonic clock."""
    peer: str
    """Name of the member that it is with; by the initiator: that is meant."""
    transcript: bytes = b""
    established: Established | None = None
    """By the responder: what it will be when the other side has proved who it is."""


class Handshakes:
    """All handshakes of one gateway, in both roles. Not for several threads at once."""

    def __init__(self, own: Own, trust: Trust, *, chance: Chance) -> None:
        """Begin with none.

        Args:
            own: certificate and key of this member.
            trust: whom it believes.
            chance: source of secrets.
        """
        self.own, self._trust, self._chance = own, trust, chance
        self._opened: dict[bytes, _Begun] = {}
        """Begun by this side, by its half; one for each member."""
        self._begun: dict[bytes, _Begun] = {}
        """Answered by this side, by its half, the oldest first."""

    def __len__(self) -> int:
        return len(self._opened) + len(self._begun)

    def greet(self, peer: str, now: float, session: bytes = b"") -> bytes:
        """Return the first message to a member.

        Args:
            peer: name of the member that is meant.
            now: [s] on this machine's monotonic clock.
            session: id of the session with it that this side still has.
        """
        self._opened = {half: begun for half, begun in self._opened.items() if begun.peer != peer}
        secret = X25519PrivateKey.from_private_bytes(self._chance(32))
        half = secret.public_key().public_bytes_raw()
        self._opened[half] = _Begun(secret, now, peer)
        return _encode(Greeting(half, self.own.certificate, session))

    def take(
        self,
        packed: bytes,
        *,
        now: float,
        wall: float,
        knows: KnowsSession,
    ) -> HandshakeStep:
        """Take a message.

        Args:
            packed: as it came.
            now: [s] on this machine's monotonic clock.
            wall: [s since 1970], for certificates.
            knows: whether this side has a session with a member, by name and id.

        Returns:
            What follows; nothing from a message that was meant for another time.

        Raises:
            NotAMember: who sent it does not belong to the realm, or is not who it says.
        """
        try:
            message = _decoder.decode(packed[: LONGEST + 1])
        except (ValueError, msgspec.MsgspecError):
            raise NotAMember(who="somebody", reason="it does not greet as a gateway does") from None
        match message:
            case Greeting():
                return self._take_greeting(message, now, wall, knows)
            case GreetingAnswer():
                return self._take_answer(message, now, wall)
            case Proof():
                return self._take_proof(message, now, wall)

    # -- inside -----------------------------------------------------------------------------------

    def _take_greeting(
        self, greeting: Greeting, now: float, wall: float, knows: KnowsSession
    ) -> HandshakeStep:
        member = self._trust.certificate(greeting.certificate, wall)
        if greeting.session and knows(member.name, greeting.session):
            return HandshakeStep()  # nothing but the way was lost
        secret = X25519PrivateKey.from_private_bytes(self._chance(32))
        half = secret.public_key().public_bytes_raw()
        transcript = _transcript(self._trust.realm, greeting, half, self.own.certificate)
        established = Established(member, _sealing(secret, greeting.half, transcript, initiator=False))
        self._keep(half, _Begun(secret, now, member.name, transcript, established))
        signature = self.own.key.sign(b"responder" + transcript)
        answer = GreetingAnswer(greeting.half, half, self.own.certificate, signature)
        return HandshakeStep(_encode(answer), member.name)

    def _take_answer(self, answer: GreetingAnswer, now: float, wall: float) -> HandshakeStep:
        begun = self._opened.get(answer.to)
        if begun is None or now - begun.since > PATIENCE:
            return HandshakeStep()
        member = self._trust.certificate(answer.certificate, wall)
        if member.name != begun.peer:
            reason = f"it answers for {begun.peer} and has the key of {member.name}"
            raise NotAMember(who=f"{member.kind} {member.name}", reason=reason)
        greeting = Greeting(answer.to, self.own.certificate, b"")
        transcript = _transcript(self._trust.realm, greeting, answer.half, answer.certificate)
        _expect(member, answer.signature, b"responder" + transcript)
        del self._opened[answer.to]
        sealing = _sealing(begun.secret, answer.half, transcript, initiator=True)
        proof = _encode(Proof(answer.half, self.own.key.sign(b"initiator" + transcript)))
        return HandshakeStep(proof, member.name, Established(member, sealing))

    def _take_proof(self, proof: Proof, now: float, wall: float) -> HandshakeStep:
        begun = self._begun.get(proof.to)
        if begun is None or begun.established is None or now - begun.since > PATIENCE:
            return HandshakeStep()
        self._trust.check(begun.established.member, wall)
        _expect(begun.established.member, proof.signature, b"initiator" + begun.transcript)
        del self._begun[proof.to]
        return HandshakeStep(b"", begun.peer, begun.established)

    def _keep(self, half: bytes, begun: _Begun) -> None:
        self._begun = {
            other: before for other, before in self._begun.items() if begun.since - before.since <= PATIENCE
        }
        of_one = [other for other, before in self._begun.items() if before.peer == begun.peer]
        for other in of_one[: len(of_one) - OF_ONE + 1]:
            del self._begun[other]
        while len(self._begun) >= MOST_BEGUN:
            del self._begun[next(iter(self._begun))]
        self._begun[half] = begun


def _transcript(realm: str, greeting: Greeting, half: bytes, certificate: bytes) -> bytes:
    """Return the hash of all that was said: what it is, the realm, both halves and both certificates."""
    said = ("robotree gateway 1", realm, greeting.half, greeting.certificate, half, certificate)
    return hashlib.sha256(_encode(said)).digest()


def _sealing(secret: X25519PrivateKey, other: bytes, transcript: bytes, *, initiator: bool) -> Sealing:
    """Return the session that follows.

    Raises:
        NotAMember: the other half is none.
    """
    try:
        shared = secret.exchange(X25519PublicKey.from_public_bytes(other))
    except ValueError:  # not 32 bytes, or a point of small order
        raise NotAMember(who="somebody", reason="it sent no key") from None
    keys = HKDF(SHA256(), 64, transcript, b"robotree gateway keys 1").derive(shared)
    mine, theirs = (keys[:32], keys[32:]) if initiator else (keys[32:], keys[:32])
    return Sealing(transcript[:ID_SIZE], mine, theirs)


def _expect(member: Certificate, signature: bytes, text: bytes) -> None:
    if not proves(member.key, signature, text):
        reason = "it shows a certificate and has not the key that belongs to it"
        raise NotAMember(who=f"{member.kind} {member.name}", reason=reason)
