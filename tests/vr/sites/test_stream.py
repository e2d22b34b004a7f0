"""Two gateways prove who they are, and speak over a stream that stays whole, whatever a router does to it."""

from __future__ import annotations

import random
import time
import tracemalloc
from collections import deque

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.vr.base.errors import NotAMember
from robotree.vr.sites.certificates import Revocations
from robotree.vr.sites.frames import SiteStopped, StopSite, encode_frame
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
from robotree.vr.sites.sealing import OVERHEAD, Lane, Sealing, Verdict
from robotree.vr.sites.stream import BEAT, LEAST_WINDOW, MOST_WAITING, PIECE, Full, SiteStream
from tests.vr.sites.site import WALL, Realm, chance

# -- the handshake: who is between them learns nothing and changes nothing -------------------------


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


# -- the sealed stream: a router may lose, repeat, reorder and forge what it carries ---------------


A, B = b"a" * 32, b"b" * 32


def pair() -> tuple[Sealing, Sealing]:
    return Sealing(b"session!", A, B), Sealing(b"session!", B, A)


class Line:
    """Two streams, and a line between them in virtual time."""

    def __init__(self, *, delay: float = 0.0, loss: float = 0.0, rate: float = 0.0, seed: int = 1) -> None:
        self.now, self.delay, self.loss, self.rate = 0.0, delay, loss, rate
        self.chance = random.Random(seed)
        self.ends = [SiteStream(sealing, 0.0) for sealing in pair()]
        self.came: list[list[tuple[float, bytes]]] = [[], []]
        self.way: list[deque[tuple[float, bytes]]] = [deque(), deque()]
        self.free = [0.0, 0.0]
        self.cut = False

    def run(self, seconds: float, step: float = 0.01) -> None:
        for _ in range(round(seconds / step)):
            self.now += step
            for end, stream in enumerate(self.ends):
                for packet in stream.take(self.now):
                    if self.cut or self.chance.random() < self.loss:
                        continue
                    self.free[end] = max(self.free[end], self.now)
                    if self.rate:
                        self.free[end] += len(packet) * 8 / self.rate
                    self.way[end].append((self.free[end] + self.delay, packet))
            for end, way in enumerate(self.way):
                while way and way[0][0] <= self.now:
                    message = self.ends[1 - end].receive(way.popleft()[1], self.now)
                    if message is not None:
                        self.came[1 - end].append((self.now, message))

    def bodies(self, end: int = 1) -> list[bytes]:
        return [body for _, body in self.came[end]]


def test_a_packet_is_opened_once_and_in_order_and_a_changed_one_never() -> None:
    mine, theirs = pair()
    first, second = mine.seal(Lane.NORMAL, b"1"), mine.seal(Lane.NORMAL, b"2")
    assert theirs.open(second).verdict is Verdict.EARLY
    assert theirs.open(first).verdict is Verdict.GOOD
    assert theirs.open(first).verdict is Verdict.REPLAYED
    for at in range(len(second)):
        changed = bytearray(second)
        changed[at] ^= 1
        assert theirs.open(bytes(changed)).verdict is not Verdict.GOOD
    assert theirs.open(second).body == b"2"
    assert mine.open(mine.seal(Lane.URGENT, b"to myself")).verdict is Verdict.FORGED


def test_a_packet_cannot_be_moved_to_another_lane() -> None:
    mine, theirs = pair()
    packet = bytearray(mine.seal(Lane.SAMPLES, b"sample"))
    packet[8] = Lane.URGENT
    assert theirs.open(bytes(packet)).verdict is Verdict.FORGED


@given(st.binary(max_size=200))
def test_garbage_opens_as_nothing(packet: bytes) -> None:
    assert pair()[1].open(packet).verdict is not Verdict.GOOD
    assert pair()[1].open(b"session!" + packet).verdict is not Verdict.GOOD


@pytest.mark.parametrize("seed", range(20))
def test_what_must_arrive_arrives_once_and_in_order_whatever_is_lost(seed: int) -> None:
    line = Line(delay=0.03, loss=0.2, seed=seed)
    lanes = {Lane.URGENT: b"u", Lane.NORMAL: b"n", Lane.BULK: b"b"}
    for number in range(60):
        for lane, mark in lanes.items():
            line.ends[0].put(lane, mark + b"%d" % number)
        line.run(0.05)
    line.loss = 0.0
    line.run(5)
    for mark in lanes.values():
        assert [body for body in line.bodies() if body[:1] == mark] == [mark + b"%d" % n for n in range(60)]
    assert line.ends[0].repeated > 0


def test_a_cut_loses_nothing_and_what_was_under_way_arrives_after_it() -> None:
    line = Line(delay=0.01)
    line.run(1)
    line.cut = True
    for number in range(50):
        line.ends[0].put(Lane.NORMAL, b"%d" % number)
        line.run(0.05)
    assert line.ends[1].silence(line.now) > 2
    assert line.bodies() == []
    line.cut = False
    line.run(3)
    assert line.bodies() == [b"%d" % number for number in range(50)]


def test_a_large_message_comes_whole_and_others_of_its_lane_behind_it() -> None:
    line = Line(delay=0.01, loss=0.1)
    picture = random.Random(2).randbytes(27_000)
    line.ends[0].put(Lane.BULK, picture)
    line.ends[0].put(Lane.BULK, b"end")
    line.ends[0].put(Lane.URGENT, b"stop")
    line.run(20)
    assert line.bodies() == [b"stop", picture, b"end"]


def test_what_has_waited_too_long_does_not_leave() -> None:
    line = Line()
    for number in range(100):
        line.ends[0].put(Lane.BULK, b"x" * PIECE)
        line.ends[0].put(Lane.NORMAL, b"late %d" % number, until=0.001 if number > 80 else 9.0)
    line.cut = True
    line.run(0.1)
    line.cut = False
    line.run(10)
    assert b"late 80" in line.bodies()
    assert not {b"late %d" % number for number in range(81, 100)} & set(line.bodies())


def test_of_samples_that_wait_the_newest_of_each_key_goes() -> None:
    line = Line()
    for number in range(100):
        line.ends[0].publish("robot/a/1", b"a%d" % number)
        line.ends[0].publish("robot/b/1", b"b%d" % number)
    line.run(1)
    assert line.bodies() == [b"a99", b"b99"]


def test_a_stop_passes_a_flood_of_pictures_on_a_slow_line() -> None:
    line = Line(delay=0.02, rate=64_000)
    took: list[float] = []
    for number in range(400):
        line.ends[0].publish(f"view/{number % 5}/1", b"p" * 9000)
        line.run(0.1)
        if number > 150 and number % 20 == 0:
            asked = line.now
            line.ends[0].put(Lane.URGENT, b"stop %d" % number)
            line.run(2)
            took += [at - asked for at, body in line.came[1] if body == b"stop %d" % number]
    assert len(took) == 12
    assert sorted(took)[6] < 0.4, "one queue of about 100 ms, and not the buffers of the line"
    assert max(took) < 0.8
    shown = sum(len(body) for at, body in line.came[1] if at > 20) * 8 / (line.now - 20)
    assert shown > 20_000, "pictures go at the rate that the line bears"


@pytest.mark.parametrize("seed", range(3))
def test_a_stop_of_a_hundred_robots_is_confirmed_in_a_flood_on_a_slow_line_with_losses(seed: int) -> None:
    """The way of the order and of the confirmations, without the stop of the robots there."""
    line = Line(delay=0.02, rate=64_000, loss=0.03, seed=seed)
    names = [f"robot-{number:03}" for number in range(100)]
    took: list[float] = []
    for number in range(300):
        for end in line.ends:
            end.publish(f"view/{number % 5}/1", b"p" * 9000)
        line.run(0.1)
        if number <= 100 or number % 20:
            continue
        asked, order = line.now, encode_frame(StopSite(number, f"order-{number}", ""))
        line.ends[0].put(Lane.URGENT, order)
        while order not in line.bodies(1) and line.now < asked + 5:
            line.run(0.01)
        confirmation = encode_frame(SiteStopped(number, names, [], []))
        line.ends[1].put(Lane.URGENT, confirmation)
        while confirmation not in line.bodies(0) and line.now < asked + 5:
            line.run(0.01)
        took.append(line.now - asked)
    assert len(took) == 9
    assert max(took) < 1.0, took


def test_a_fast_line_is_used() -> None:
    line = Line(delay=0.01)
    for _ in range(10):
        line.ends[0].put(Lane.BULK, b"x" * 1_000_000)
    line.run(60)
    assert len(line.bodies()) == 10
    assert line.came[1][-1][0] < 30


def put_without_end(line: Line, lane: Lane) -> None:
    for _ in range(100):
        line.ends[0].put(lane, b"x" * 1_000_000)
        if lane is Lane.URGENT:
            line.run(0.01)


def test_the_window_never_closes_and_what_waits_is_bounded() -> None:
    line = Line(delay=1.0, rate=8_000)
    with pytest.raises(Full):
        put_without_end(line, Lane.BULK)
    assert line.ends[0]._waits <= MOST_WAITING
    line.run(60, step=0.05)
    assert line.ends[0]._window >= LEAST_WINDOW
    assert line.ends[0]._window < 8 * LEAST_WINDOW


def test_urgent_messages_that_nobody_confirms_are_bounded_too() -> None:
    line = Line()
    line.cut = True
    with pytest.raises(Full):
        put_without_end(line, Lane.URGENT)
    assert line.ends[0]._waits <= MOST_WAITING


def test_the_delay_of_a_message_is_known_without_comparing_clocks() -> None:
    line = Line(delay=0.1)
    line.run(3)
    assert line.ends[1].round_trip == pytest.approx(0.2, abs=0.03)
    offset = 5000.0  # the clocks differ: only differences on each of them count
    mine, theirs = pair()
    sender, receiver = SiteStream(mine, 0.0), SiteStream(theirs, offset)
    for beat in range(10):
        for packet in sender.take(beat * BEAT):
            receiver.receive(packet, offset + beat * BEAT + 0.1)
    assert receiver.delay(10.0, offset + 10.1) == pytest.approx(0.0, abs=0.01)
    assert receiver.delay(10.0, offset + 14.1) == pytest.approx(4.0, abs=0.01)


def test_a_sender_that_slept_counts_as_late_at_first_and_not_for_ever() -> None:
    mine, theirs = pair()
    sender, receiver = SiteStream(mine, 0.0), SiteStream(theirs, 0.0)

    def beat(at: float, slept: float) -> None:
        for packet in sender.take(at - slept):
            receiver.receive(packet, at)

    for number in range(20):
        beat(number * 0.6, 0.0)
    for number in range(20, 60):
        beat(number * 0.6 + 5, 5.0)
        if number == 21:
            assert receiver.delay(number * 0.6, number * 0.6 + 5) > 4
    assert receiver.delay(60 * 0.6, 60 * 0.6 + 5) < 1


@pytest.mark.speed
def test_sealing_and_opening_take_ten_microseconds_together() -> None:
    mine, theirs = pair()
    body, best = b"x" * 200, 1.0
    assert len(mine.seal(Lane.URGENT, body)) == 200 + OVERHEAD
    theirs.open(Sealing(b"session!", A, B).seal(Lane.URGENT, body))
    for _ in range(20):
        begin = time.perf_counter()
        for _ in range(500):
            theirs.open(mine.seal(Lane.URGENT, body))
        best = min(best, (time.perf_counter() - begin) / 500)
    assert best < 10e-6
