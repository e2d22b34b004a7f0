"""Who is admitted to a realm, and why others are not."""

from __future__ import annotations

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.vr.base.errors import BadName, NotAMember
from robotree.vr.sites.certificates import DAY, SKEW, Revocations, Signed, Trust
from tests.vr.sites.realm import WALL, Realm


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
