"""Two gateways prove who they are; whoever is between them learns nothing and changes nothing."""

from __future__ import annotations

import tracemalloc

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.vr.base.errors import NotAMember
from robotree.vr.sites.certificates import Revocations
from robotree.vr.sites.handshake import (
    MOST_BEGUN,
    OF_ONE,
    PATIENCE,
    Established,
    Greeting,
    GreetingAnswer,
    Handshakes,
    HandshakeStep,
    Own,
    Proof,
)
from robotree.vr.sites.sealing import Lane, Verdict
from tests.vr.sites.realm import WALL, Realm, chance

pack = msgspec.msgpack.encode


def take(
    side: Handshakes, packed: bytes, now: float = 0.0, wall: float = WALL
) -> tuple[bytes, Established | None]:
    step = side.take(packed, now=now, wall=wall, knows=lambda _name, _session: False)
    return step.answer, step.established


def refused(side: Handshakes, packed: bytes, wall: float = WALL) -> str:
    with pytest.raises(NotAMember) as caught:
        take(side, packed, wall=wall)
    return str(caught.value)


def meet(a: Handshakes, b: Handshakes, name: str = "plant") -> tuple[Established, Established]:
    answer, _ = take(b, a.greet(name, 0.0))
    proof, mine = take(a, answer)
    _, theirs = take(b, proof)
    assert mine is not None
    assert theirs is not None
    return mine, theirs


def test_both_know_who_the_other_is_and_share_keys() -> None:
    realm = Realm()
    mine, theirs = meet(realm.gateway("lab"), realm.gateway("plant"))
    assert (mine.member.name, theirs.member.name) == ("plant", "lab")
    assert mine.sealing.session == theirs.sealing.session
    opened = theirs.sealing.open(mine.sealing.seal(Lane.URGENT, b"stop"))
    assert (opened.verdict, opened.lane, opened.body) == (Verdict.GOOD, Lane.URGENT, b"stop")
    assert mine.sealing.open(theirs.sealing.seal(Lane.NORMAL, b"done")).body == b"done"


def test_each_handshake_makes_other_keys() -> None:
    realm = Realm()
    lab, plant = realm.gateway("lab"), realm.gateway("plant")
    first, second = meet(lab, plant)[0], meet(lab, plant)[1]
    assert first.sealing.session != second.sealing.session
    assert second.sealing.open(first.sealing.seal(Lane.URGENT, b"stop")).verdict is Verdict.FOREIGN


def test_a_member_of_another_realm_is_not_answered() -> None:
    realm, foreign = Realm("cell", 1), Realm("cell", 2)
    plant = realm.gateway("plant")
    assert "has not signed" in refused(plant, foreign.gateway("lab").greet("plant", 0.0))
    assert len(plant) == 0


def test_an_expired_member_is_not_answered_and_one_that_is_revoked_meanwhile_does_not_end_its_handshake() -> (
    None
):
    realm = Realm()
    old = Handshakes(realm.own("old", days=1), realm.trust(), chance=realm.draw)
    plant_trust = realm.trust()
    plant = Handshakes(realm.own("plant"), plant_trust, chance=realm.draw)
    assert "ended" in refused(plant, old.greet("plant", 0.0), wall=WALL + 86_401)
    lab = realm.gateway("lab")
    answer, _ = take(plant, lab.greet("plant", 0.0))
    proof, _ = take(lab, answer)
    plant_trust.take_revocations(realm.authority.revoke(Revocations("cell"), (3,)))
    assert "was revoked" in refused(plant, proof)


def test_a_thief_of_a_certificate_has_not_its_key() -> None:
    realm = Realm()
    lab, plant = realm.own("lab"), realm.gateway("plant")
    thief = Handshakes(Own(lab.certificate, realm.key()), realm.trust(), chance=chance(5))
    answer, _ = take(plant, thief.greet("plant", 0.0))
    proof, _ = take(thief, answer)
    assert "has not the key" in refused(plant, proof)
    posing = Handshakes(Own(realm.own("plant").certificate, realm.key()), realm.trust(), chance=chance(6))
    victim = realm.gateway("anna")
    answer, _ = take(posing, victim.greet("plant", 0.0))
    assert "has not the key" in refused(victim, answer)


def test_right_certificate_and_wrong_member() -> None:
    realm = Realm()
    lab, other = realm.gateway("lab"), realm.gateway("other")
    answer, _ = take(other, lab.greet("plant", 0.0))
    assert "answers for plant and has the key of other" in refused(lab, answer)


def test_who_is_between_them_cannot_exchange_a_half() -> None:
    realm = Realm()
    lab, plant = realm.gateway("lab"), realm.gateway("plant")
    spy = Realm("spy", 9).gateway("spy")
    half = msgspec.msgpack.decode(spy.greet("plant", 0.0), type=Greeting).half
    greeting = msgspec.msgpack.decode(lab.greet("plant", 0.0), type=Greeting)
    answer, _ = take(plant, pack(msgspec.structs.replace(greeting, half=half)))
    heard = msgspec.msgpack.decode(answer, type=GreetingAnswer)
    assert "has not the key" in refused(lab, pack(msgspec.structs.replace(heard, to=greeting.half)))
    fresh, _ = take(plant, lab.greet("plant", 0.0))
    heard = msgspec.msgpack.decode(fresh, type=GreetingAnswer)
    assert "has not the key" in refused(lab, pack(msgspec.structs.replace(heard, half=half)))


def test_messages_that_are_repeated_or_come_in_another_order_establish_nothing() -> None:
    realm = Realm()
    lab, plant = realm.gateway("lab"), realm.gateway("plant")
    greeting = lab.greet("plant", 0.0)
    answer, _ = take(plant, greeting)
    proof, _ = take(lab, answer)
    assert take(lab, answer) == (b"", None), "an answer counts once"
    assert take(plant, proof)[1] is not None
    assert take(plant, proof) == (b"", None), "a proof counts once"
    assert take(plant, greeting)[1] is None
    assert refused_or_nothing(plant, proof), "a proof counts for one answer"
    assert take(lab, pack(Proof(b"x" * 32, b"y" * 64))) == (b"", None)


def refused_or_nothing(side: Handshakes, packed: bytes) -> bool:
    try:
        return take(side, packed) == (b"", None)
    except NotAMember:
        return True


def test_a_signature_of_one_role_does_not_count_for_the_other() -> None:
    realm = Realm()
    lab, plant = realm.gateway("lab"), realm.gateway("plant")
    answer, _ = take(plant, lab.greet("plant", 0.0))
    heard = msgspec.msgpack.decode(answer, type=GreetingAnswer)
    assert "has not the key" in refused(plant, pack(Proof(heard.half, heard.signature)))


def test_a_handshake_that_takes_too_long_is_void() -> None:
    realm = Realm()
    lab, plant = realm.gateway("lab"), realm.gateway("plant")
    answer, _ = take(plant, lab.greet("plant", 0.0))
    assert take(lab, answer, now=PATIENCE + 0.1) == (b"", None)


def test_who_still_has_the_session_is_not_answered() -> None:
    realm = Realm()
    lab, plant = realm.gateway("lab"), realm.gateway("plant")
    session = meet(lab, plant)[0].sealing.session
    greeting = lab.greet("plant", 0.0, session)
    known = plant.take(greeting, now=0.0, wall=WALL, knows=lambda name, id_: (name, id_) == ("lab", session))
    assert known == HandshakeStep()
    assert take(plant, greeting)[0], "who has forgotten it makes a new one"


@given(st.binary(max_size=5000))
def test_garbage_is_refused_and_leaves_nothing(packed: bytes) -> None:
    plant = Realm().gateway("plant")
    assert refused_or_nothing(plant, packed)
    assert len(plant) == 0


def test_a_flood_of_bad_handshakes_takes_no_memory() -> None:
    realm, foreign = Realm("cell", 1), Realm("cell", 2)
    plant, lab, stranger = realm.gateway("plant"), realm.own("lab"), foreign.gateway("lab")
    begun = [realm.own(f"site-{number}").certificate for number in range(100)]
    tracemalloc.start()
    before, refusals = 0, 0
    for number in range(1_500):
        half = number.to_bytes(32, "big")
        bad = [
            pack(Greeting(half, stranger.own.certificate, b"")),
            pack(GreetingAnswer(half, half, lab.certificate, b"s" * 64)),
            pack(Proof(half, b"s" * 64)),
            half * 10,
            pack(Greeting(b"\1" + half[1:], lab.certificate, b"")),
            pack(Greeting(b"\1" + half[1:], begun[number % 100], b"")),
        ]
        try:
            assert take(plant, bad[number % 6])[1] is None
        except NotAMember:
            refusals += 1
        if number == 500:
            before = tracemalloc.get_traced_memory()[0]
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert refusals > 450
    assert len(plant) <= MOST_BEGUN
    assert grown < 10_000
    assert sum(one.peer == "lab" for one in plant._begun.values()) <= OF_ONE
    assert meet(realm.gateway("anna"), plant)[1].member.name == "anna", "and others are still admitted"
