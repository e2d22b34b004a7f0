"""Who has the key may speak, nothing is said twice, and the three attacks on other tools fail here."""

from __future__ import annotations

import copy
import hashlib
import json
import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.wire.codec import encoder
from robotree.protocol import Endpoint, Frame, Parser, encode
from robotree.protocol.links.link import encoded
from robotree.protocol.links.loopback import Loopback
from robotree.protocol.links.rejection import rejection
from robotree.protocol.messages import Gripper, Heartbeat, SetupSigning
from robotree.protocol.signing import (
    EPOCH,
    MAX_STREAMS,
    UNITS,
    Key,
    Signer,
    SigningTime,
    StreamTable,
    Verifier,
    hkdf,
)
from robotree.protocol.testing import RecordingHandler, check_codec

if TYPE_CHECKING:
    from types import ModuleType

    from robotree.protocol.messages import AnyMessage

SECRET = bytes(range(32))
KEY, FALSE_KEY = Key(SECRET), Key(bytes(32))
NOW = 1_800_000_000.0
BEAT = Heartbeat(0, 0, 0, 0, 4)


class WallClock:
    """Unix time, moved by the test."""

    def __init__(self, now: float = NOW) -> None:
        self.now = now

    def __call__(self) -> float:
        return self.now


def _signed(
    key: Key = KEY, *, at: float = NOW, link: int = 0, message: AnyMessage = BEAT, component: int = 1
) -> bytes:
    signer = Signer(key, SigningTime(lambda: at), link)
    return encode(message, sequence=0, system=1, component=component, signer=signer)


def _verifier(clock: WallClock, streams: StreamTable | None = None, persisted: int = 0) -> Verifier:
    return Verifier(KEY, SigningTime(clock, persisted), streams or StreamTable())


def test_every_signed_message_has_the_bytes_of_the_reference(oracle: ModuleType) -> None:
    speaker = oracle.MAVLink(None)
    speaker.signing.secret_key, speaker.signing.sign_outgoing = SECRET, True
    speaker.signing.link_id, speaker.signing.timestamp = 3, int((NOW - EPOCH) * UNITS)
    first = SigningTime(lambda: NOW - 3600, persisted=speaker.signing.timestamp - 1)
    assert check_codec(encoder(oracle, speaker), signer=Signer(KEY, first, 3), rounds=2) > 400


def test_a_signed_frame_passes_once() -> None:
    verifier = _verifier(WallClock())
    parser = Parser(verifier)
    (frame,) = parser.feed(_signed())
    assert frame.signed
    assert frame.message == BEAT
    assert frame.raw == _signed()
    assert parser.feed(_signed()) == []
    assert parser.statistics.refused == 1
    assert verifier.statistics.replayed == 1


def test_attack_1_a_forged_frame_from_the_far_future_locks_nobody_out() -> None:
    parser = Parser(_verifier(WallClock()))
    assert parser.feed(_signed(FALSE_KEY, at=NOW + 10 * 365 * 86400)) == []
    assert len(parser.feed(_signed(at=NOW))) == 1


def test_attack_2_an_old_recording_is_refused_by_a_fresh_receiver() -> None:
    """However young it is: the receiver before it may have heard it, and have been killed."""
    for age in (0.001, 5, 61):
        verifier = _verifier(WallClock())
        assert Parser(verifier).feed(_signed(at=NOW - age)) == []
        assert (verifier.statistics.late, verifier.statistics.behind) == (1, pytest.approx(age, abs=1e-4))


def test_attack_2_also_where_the_wall_clock_was_set_back() -> None:
    recording = _signed(at=NOW - 61)
    lost = WallClock(now=float(EPOCH))
    assert len(Parser(_verifier(lost)).feed(recording)) == 1, "without a persisted time there is no defence"
    persisted = int((NOW - EPOCH) * UNITS)
    assert Parser(_verifier(lost, persisted=persisted)).feed(recording) == []


def test_attack_3_a_recording_of_one_link_cannot_be_played_on_another() -> None:
    streams, clock = StreamTable(), WallClock()
    one, other = (Parser(_verifier(clock, streams)) for _ in range(2))
    recording = _signed()
    assert len(one.feed(recording)) == 1
    assert other.feed(recording) == []


@pytest.mark.parametrize("place", range(len(_signed())))
def test_no_byte_of_a_signed_frame_can_be_changed(place: int) -> None:
    changed = bytearray(_signed())
    changed[place] ^= 0x10
    assert Parser(_verifier(WallClock())).feed(bytes(changed)) == []


def test_unsigned_frames_and_version_1_are_refused_while_there_is_a_key(oracle: ModuleType) -> None:
    verifier = _verifier(WallClock())
    parser = Parser(verifier)
    assert parser.feed(Frame.of(BEAT).raw) == []
    version_1 = oracle.MAVLink_heartbeat_message(0, 0, 0, 0, 4, 3).pack(
        oracle.MAVLink(None), force_mavlink1=True
    )
    assert parser.feed(bytes(version_1)) == []
    assert verifier.statistics.unsigned == parser.statistics.refused == 2


def test_streams_are_told_apart_by_key_link_system_and_component() -> None:
    streams, clock = StreamTable(), WallClock()
    parsers = [Parser(Verifier(key, SigningTime(clock), streams)) for key in (KEY, FALSE_KEY)]
    for key, parser in zip((KEY, FALSE_KEY), parsers, strict=True):
        for link, component in [(0, 1), (1, 1), (0, 2)]:
            assert len(parser.feed(_signed(key, link=link, component=component))) == 1
            assert parser.feed(_signed(key, link=link, component=component)) == []


@pytest.mark.parametrize(
    ("behind", "passes"),
    [(-3600, False), (-60.1, False), (-60, True), (0, True), (60, True), (60.1, False), (3600, False)],
)
def test_a_new_stream_may_lie_a_minute_before_or_behind_us(behind: float, passes: bool) -> None:  # noqa: FBT001  a case
    clock = WallClock(NOW - 86400)
    verifier = _verifier(clock)
    clock.now = NOW
    assert len(Parser(verifier).feed(_signed(at=NOW - behind))) == passes


def test_a_clock_that_was_never_set_judges_nobody_who_is_ahead_of_it() -> None:
    verifier = _verifier(WallClock(EPOCH + 100.0))
    assert len(Parser(verifier).feed(_signed(at=NOW))) == 1


def test_a_stream_does_not_jump_ahead_of_our_clock_either() -> None:
    clock = WallClock()
    verifier = _verifier(clock)
    said = [_signed(at=NOW + ahead) for ahead in (0, 59, 118, 180)]
    assert [len(Parser(verifier).feed(each)) for each in said] == [1, 1, 1, 0]
    assert verifier.statistics.early == 1
    assert "their clock is 180 s ahead, and 60 s are allowed" in rejection(verifier)


VECTORS = json.loads((Path(__file__).parent / "golden" / "controller_keys.json").read_text())


def test_keys_are_derived_as_the_standard_derives_them() -> None:
    """RFC 5869, test case 3: without salt and info, of which the first block."""
    assert hkdf(b"\x0b" * 22, b"").hex() == "8da4e775a563c18f715f802a063c5a31b8a11f5c5ee1879ec3454e5f3c738d2d"


@pytest.mark.parametrize("vector", VECTORS, ids=lambda each: each["controller"][:20])
def test_the_key_of_a_controller_is_made_as_in_other_languages(vector: dict[str, str]) -> None:
    """The vectors are for controllers in other languages, too."""
    master, name = Key(bytes.fromhex(vector["master"])), vector["controller"]
    assert master.passphrase_for(name) == vector["passphrase"]
    assert hashlib.sha256(vector["passphrase"].encode()).hexdigest() == vector["key"]
    assert master.of_controller(name).reveal() == vector["key"]
    assert vector["key"] not in repr(master.of_controller(name))


@pytest.mark.parametrize(
    ("said", "words"),
    [
        (
            [_signed(FALSE_KEY)] * 2,
            r"our key \(2 refused\): they have the signature of another key; give",
        ),
        ([Frame.of(BEAT).raw], r"our key \(1 refused\): they have no signature; sign them"),
        (
            [_signed(at=NOW - 120)],
            r"\(1 refused\): their clock is 120 s behind, and 60 s are allowed; set",
        ),
        ([_signed(at=NOW - 5)], r"\(1 refused\): their clock is 5\.0 s behind, so .* wait 5 s, or set both"),
        ([_signed(at=NOW + 1), _signed()], r"\(1 refused\): their time is not later than .* a recording"),
        ([_signed()] * 20, r"not new \(19 refused\): several have the same time; let it grow by 10 us"),
    ],
)
def test_what_is_refused_is_explained_which_it_is_by_how_much_and_what_to_do(
    said: list[bytes], words: str
) -> None:
    """The last is what gomavlib 3.1 sends within 10 us."""
    verifier = _verifier(WallClock())
    Parser(verifier).feed(b"".join(said))
    assert re.search(words, rejection(verifier))


def test_where_nothing_is_refused_there_is_nothing_to_say() -> None:
    verifier = _verifier(WallClock())
    Parser(verifier).feed(_signed())
    assert rejection(verifier) == rejection(None) == ""


def test_forged_streams_do_not_fill_the_table() -> None:
    streams = StreamTable()
    streams.of(KEY).update({i.to_bytes(3, "big"): 1 for i in range(MAX_STREAMS)})
    assert Parser(_verifier(WallClock(), streams)).feed(_signed()) == []


def test_our_time_never_stands_and_never_goes_back() -> None:
    clock = WallClock()
    time = SigningTime(clock)
    stamps = [time.next() for _ in range(3)]
    clock.now -= 3600
    stamps += [time.next() for _ in range(3)]
    clock.now += 7200
    stamps.append(time.next())
    assert stamps == sorted({*stamps})
    assert stamps[-1] == int((clock.now - EPOCH) * UNITS), "refreshed from the wall clock at every frame"
    assert SigningTime(WallClock(0.0), persisted=stamps[-1]).next() == stamps[-1] + 1


@given(
    st.lists(st.one_of(st.floats(0.0, 2e9), st.floats(NOW - 1e-3, NOW + 1e-3)), max_size=40),
    st.integers(0, 2**47),
)
def test_every_timestamp_is_the_wall_clock_s_or_the_one_after_the_last(
    times: list[float], persisted: int
) -> None:
    clock = WallClock()
    ours, last = SigningTime(clock, persisted), persisted
    for clock.now in times:
        for _ in range(3):
            last = max(int((clock.now - EPOCH) * UNITS), last + 1)
            assert ours.next() == last == ours.last


def test_two_ends_with_the_same_key_talk_and_a_third_hears_nothing() -> None:
    clock, heard = WallClock(), list[Frame]()

    def end(key: Key) -> Endpoint:
        time = SigningTime(clock)
        network = Loopback(
            lambda link: Endpoint(
                link,
                system=1,
                component=1,
                on_frame=heard.append,
                signer=Signer(key, time),
                verifier=Verifier(key, time, StreamTable()),
            ),
            RecordingHandler,
        )
        assert isinstance(network.near.handler, Endpoint)
        return network.near.handler

    one, two, stranger = end(KEY), end(KEY), end(FALSE_KEY)
    sent: list[bytes] = []
    for speaker in (one, stranger):
        speaker.link.send = lambda frame, _=None: sent.append(encoded(frame))  # type: ignore[method-assign,misc]  # tap the wire
        speaker.send(Gripper(1, 0.0, 0.0, 0.0, 0))
    two.received(b"".join(sent))
    assert len(sent) == 2
    assert [frame.message for frame in heard] == [Gripper(1, 0.0, 0.0, 0.0, 0)]


def test_a_key_shows_itself_to_nobody() -> None:
    shown = repr(KEY) + repr(SetupSigning(1, 1, SECRET, 0)) + repr(Frame.of(SetupSigning(1, 1, SECRET, 0)))
    assert SECRET.hex() not in shown
    assert repr(SECRET)[2:-1] not in shown
    assert KEY.fingerprint != FALSE_KEY.fingerprint
    with pytest.raises(TypeError, match="never stored"):
        copy.copy(KEY)
    with pytest.raises(ValueError, match="has 32 bytes, not 5; make a new one"):
        Key(b"short")
