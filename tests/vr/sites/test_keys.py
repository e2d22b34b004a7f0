"""Who is admitted to a realm: certificates, tokens that open it once, and keys on the disk."""

from __future__ import annotations

import hmac
import os
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol.links import keyring
from robotree.vr.base.errors import BadName, InvitationRefused, NotAMember
from robotree.vr.sites import keys
from robotree.vr.sites.certificates import DAY, SKEW, PublicKey, Revocations, Signed, Trust
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
from tests.vr.sites.site import WALL, Realm


def refused(trust: Trust, packed: bytes, now: float = WALL) -> str:
    with pytest.raises(NotAMember) as caught:
        trust.certificate(packed, now)
    return str(caught.value)


def test_a_certificate_is_good_from_its_begin_to_its_end() -> None:
    realm = Realm()
    packed, trust = realm.own("lab", days=2).certificate, realm.trust()
    assert trust.certificate(packed, WALL).name == "lab"
    assert trust.certificate(packed, WALL + 2 * DAY - 1).kind == "site"
    assert trust.certificate(packed, WALL - SKEW).serial == 1
    assert "ended 1.0 days ago" in refused(trust, packed, WALL + 3 * DAY)
    assert "clock" in refused(trust, packed, WALL - SKEW - 1)


def test_another_realms_certificate_is_refused_even_under_the_same_name() -> None:
    ours, theirs = Realm("cell", 1), Realm("cell", 2)
    assert "has not signed" in refused(ours.trust(), theirs.own("lab").certificate)
    other = Realm("plant", 1)
    same_key = Trust("cell", other.authority.public)
    assert "is for realm plant" in refused(same_key, other.own("lab").certificate)


def test_a_revoked_certificate_is_refused_and_an_older_list_changes_nothing() -> None:
    realm = Realm()
    lab, trust = realm.own("lab"), realm.trust()
    first = realm.authority.revoke(Revocations("cell"), ())
    second = realm.authority.revoke(Revocations("cell", 1), (1,))
    assert trust.take_revocations(second)
    assert "was revoked" in refused(trust, lab.certificate)
    assert not trust.take_revocations(first)
    assert not trust.take_revocations(second)
    assert "was revoked" in refused(trust, lab.certificate)


def test_nobody_else_can_revoke() -> None:
    realm, stranger = Realm(), Realm("cell", 7)
    trust = realm.trust()
    with pytest.raises(NotAMember):
        trust.take_revocations(stranger.authority.revoke(Revocations("cell"), (1,)))
    assert trust.certificate(realm.own("lab").certificate, WALL).name == "lab"


def test_a_signed_list_is_no_certificate_and_a_certificate_is_no_list() -> None:
    realm = Realm()
    trust = realm.trust()
    assert "has not signed" in refused(trust, realm.authority.revoke(Revocations("cell"), ()))
    with pytest.raises(NotAMember):
        trust.take_revocations(realm.own("lab").certificate)


@given(st.integers(0, 400), st.integers(1, 255))
def test_a_certificate_that_was_changed_anywhere_is_refused(at: int, change: int) -> None:
    realm = Realm()
    packed = bytearray(realm.own("lab").certificate)
    packed[at % len(packed)] ^= change
    assert "not admitted" in refused(realm.trust(), bytes(packed))


@given(st.binary(max_size=2000))
def test_garbage_is_refused_in_words(packed: bytes) -> None:
    realm = Realm()
    assert "not admitted" in refused(realm.trust(), packed)
    with pytest.raises(NotAMember):
        realm.trust().take_revocations(packed)


def test_a_certificate_with_a_name_that_nobody_can_have_is_never_signed() -> None:
    realm = Realm()
    with pytest.raises(BadName):
        realm.own("lab:arm")


def test_the_signature_covers_what_kind_of_thing_is_signed() -> None:
    realm = Realm()
    signed = msgspec.msgpack.decode(realm.own("lab").certificate, type=Signed)
    bare = msgspec.msgpack.encode(Signed(b"robotree certificate 1\0" + signed.body, signed.signature))
    assert "not admitted" in refused(realm.trust(), bare)


# -- a token opens a realm once, for a short time, to who has it -----------------------------------


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


# -- keys are on the disk when they have been made: their files, and the names of these ------------


@pytest.mark.parametrize("how", ["site", "link"])
def test_a_key_file_is_synced_before_its_name_and_then_its_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    synced: list[Path] = []
    names: list[set[str]] = []
    fsync = os.fsync

    def note(handle: int) -> None:
        synced.append(Path(f"/proc/self/fd/{handle}").resolve())
        names.append({each.name for each in tmp_path.iterdir()})
        fsync(handle)

    monkeypatch.setattr(os, "fsync", note)
    path = tmp_path / "own.key"
    if how == "site":
        keys.write(path, b"0" * 32)
    else:
        keyring.replace(path, "0" * 64)
    assert [each.parent if each.is_file() or not each.exists() else each for each in synced] == [tmp_path] * 2
    assert synced[-1] == tmp_path, "the folder last"
    assert "own.key" not in names[0], "its content is on the disk before it has its name"
    assert names[1] == {"own.key"}
