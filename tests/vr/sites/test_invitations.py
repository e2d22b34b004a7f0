"""A token opens a realm once, for a short time, to who has it."""

from __future__ import annotations

import hmac

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.vr.base.errors import InvitationRefused
from robotree.vr.sites.certificates import PublicKey
from robotree.vr.sites.invitations import (
    Hub,
    Invitation,
    JoinRequest,
    OpenInvitation,
    admitted,
    key_of,
    read_token,
    request_to_join,
    token_of,
)
from tests.vr.sites.realm import WALL, Realm

HOUR = 3600.0


class Inviting:
    """An authority with one invitation."""

    def __init__(self) -> None:
        self.realm = Realm()
        secret = self.realm.draw(16)
        hubs = (Hub("tls:hub.example:7447", "ab" * 32),)
        self.invitation = Invitation(
            "cell", self.realm.authority.public, secret, "lab", "site", WALL + HOUR, hubs
        )
        self.open = {
            self.invitation.number: OpenInvitation("lab", "site", WALL + HOUR, 30, (), key_of(secret).hex())
        }
        self.taken: dict[str, PublicKey] = {}

    def take(self, packed: bytes, now: float = WALL) -> bytes:
        number, certificate = admitted(packed, self.realm.authority, self.open, self.taken, serial=9, now=now)
        del self.open[number]
        return certificate

    def refused(self, packed: bytes, now: float = WALL) -> str:
        with pytest.raises(InvitationRefused) as caught:
            self.take(packed, now)
        return str(caught.value)


def test_who_has_the_token_gets_a_certificate_for_its_own_key_once() -> None:
    inviting = Inviting()
    invitation = read_token(token_of(inviting.invitation), WALL)
    assert invitation == inviting.invitation
    key = inviting.realm.key()
    request = request_to_join(invitation, key)
    certificate = inviting.realm.trust().certificate(inviting.take(request), WALL)
    assert (certificate.name, certificate.kind, certificate.serial) == ("lab", "site", 9)
    assert certificate.key == key.public_key().public_bytes_raw()
    assert "used already" in inviting.refused(request)
    assert invitation.secret not in request, "the secret does not travel"


def test_a_token_ends() -> None:
    inviting = Inviting()
    token = token_of(inviting.invitation)
    with pytest.raises(InvitationRefused, match="ended 1 minutes ago"):
        read_token(token, WALL + HOUR + 60)
    request = request_to_join(inviting.invitation, inviting.realm.key())
    assert "ended" in inviting.refused(request, WALL + HOUR)


def test_a_name_is_given_once() -> None:
    inviting = Inviting()
    inviting.taken["lab"] = b"x"
    request = request_to_join(inviting.invitation, inviting.realm.key())
    assert "there is a member lab already" in inviting.refused(request)


def test_a_request_that_was_changed_on_its_way_is_refused() -> None:
    inviting = Inviting()
    request = msgspec.msgpack.decode(
        request_to_join(inviting.invitation, inviting.realm.key()), type=JoinRequest
    )
    thief = inviting.realm.key()
    other = msgspec.structs.replace(request, key=thief.public_key().public_bytes_raw())
    assert "does not prove that it has the token" in inviting.refused(msgspec.msgpack.encode(other))
    guessed = msgspec.structs.replace(request, proof=b"p" * 32)
    assert "does not prove that it has the token" in inviting.refused(msgspec.msgpack.encode(guessed))


def test_nobody_gets_a_certificate_for_a_key_of_somebody_else() -> None:
    inviting = Inviting()
    victim = inviting.realm.key().public_key().public_bytes_raw()
    text = msgspec.msgpack.encode(("robotree join 1", "cell", "lab", victim))
    proof = hmac.digest(key_of(inviting.invitation.secret), text, "sha256")
    own = inviting.realm.key().sign(text)
    request = JoinRequest(inviting.invitation.number, victim, proof, own)
    assert "does not prove that it has its key" in inviting.refused(msgspec.msgpack.encode(request))


@given(st.text(max_size=300))
def test_what_is_no_token_is_refused_in_words(text: str) -> None:
    with pytest.raises(InvitationRefused, match="cannot be used"):
        read_token(text, WALL)
    with pytest.raises(InvitationRefused, match="cannot be used"):
        read_token("robotree-" + text, WALL)


def test_a_token_that_a_terminal_broke_into_lines_is_read_and_one_that_was_cut_is_not() -> None:
    inviting = Inviting()
    token = token_of(inviting.invitation)
    assert read_token(f"  {token[:40]}\n {token[40:]} ", WALL) == inviting.invitation
    for length in range(len(token)):
        with pytest.raises(InvitationRefused, match="copy all"):
            read_token(token[:length], WALL)


@given(st.binary(max_size=3000))
def test_garbage_instead_of_a_request_is_refused(packed: bytes) -> None:
    assert "cannot be read" in Inviting().refused(packed)
