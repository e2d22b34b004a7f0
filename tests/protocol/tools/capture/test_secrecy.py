"""A key in the clear is kept nowhere, and what commands does not pass where nobody shall be commanded."""

from __future__ import annotations

import io
import json
from typing import Any

import msgspec
import pytest

from robotree.protocol import Parser, encode
from robotree.protocol.dialect.table import by_name
from robotree.protocol.errors import InvalidMessage
from robotree.protocol.links.loopback import Faults
from robotree.protocol.messages import (
    CommandAck,
    CommandLong,
    Goal,
    GoalCancel,
    GoalStatus,
    Heartbeat,
    Message,
    ParamRequestList,
    ParamSet,
    Ping,
    SetMode,
    SetupSigning,
    Untyped,
)
from robotree.protocol.signing import Key, Signer, SigningTime
from robotree.protocol.tools.capture import tlog
from robotree.protocol.tools.capture.decode import Decoder, detect
from robotree.protocol.tools.capture.gauges import LinkGauge
from robotree.protocol.tools.capture.recorder import WRITERS, Recorder
from robotree.protocol.tools.capture.records import HIDDEN, Captured
from robotree.protocol.tools.capture.replay import RecordFilter, commands
from robotree.protocol.tools.relay import FaultyCable, Traffic

SECRET = bytes(range(65, 97))
SHOWN = (SECRET.hex(), SECRET.decode(), str([*SECRET])[1:-1], str([*SECRET])[1:-1].replace(" ", ""))
SIGNER = Signer(Key(b"1" * 32), SigningTime(lambda: 1.8e9))
BEAT, HANDED = Heartbeat(6, 8, 0, 0, 4), SetupSigning(1, 1, SECRET, 7)


def said(*messages: Message, signer: Signer | None = None) -> bytes:
    frames = [
        encode(each, sequence=i, system=255, component=190, signer=signer) for i, each in enumerate(messages)
    ]
    return b"".join(frames)


def kept(data: bytes) -> bool:
    return SECRET in data or any(text.encode() in data for text in SHOWN)


class Heap:
    """A link that remembers."""

    def __init__(self) -> None:
        self.data = b""

    def send(self, frame: bytes, _topic: Any = None) -> None:
        self.data += frame


@pytest.mark.parametrize("suffix", WRITERS)
@pytest.mark.parametrize("signer", [None, SIGNER])
def test_a_recording_has_everything_but_keys_which_are_counted(suffix: str, signer: Signer | None) -> None:
    stream = io.BytesIO()
    recorder = Recorder(WRITERS[suffix](stream))
    data = said(BEAT, HANDED, BEAT, signer=signer)
    for i in range(len(data)):  # however the stream is cut
        recorder.take(data[i : i + 1], 1.7e9)
    recorder.close()
    assert (recorder.frames, recorder.withheld, recorder.skipped) == (2, 1, 0)
    assert not kept(stream.getvalue())
    decoder = Decoder(detect(stream.getvalue()))
    found = decoder.feed(stream.getvalue()) + decoder.flush()
    assert [one.frame.message for one in found] == [BEAT, BEAT]


def test_a_relay_passes_on_everything_but_keys_which_are_counted() -> None:
    cable, far = FaultyCable(Faults(), 0.0), Heap()
    cable.open("far", far)  # type: ignore[arg-type]  # all that is needed of a link
    cable.take("near", said(BEAT, HANDED, BEAT), 0.0)
    cable.advance(1.0)
    assert not kept(far.data)
    assert len(far.data) == 2 * len(said(BEAT))
    assert cable.traffic["near"] == Traffic(taken=3, passed=2, withheld=1)


def test_a_foreign_recording_is_replayed_without_its_keys() -> None:
    """Who replays with a key signs anew: an old key would be put in for a second time."""
    whole = [Captured(said(HANDED), 1), Captured(said(BEAT), 2), Captured(said(BEAT, HANDED, BEAT), 3)]
    filter_ = RecordFilter()
    passed = list(filter_.filter(whole))
    assert [(one.time, len(one.data) // len(said(BEAT))) for one in passed] == [(2, 1), (3, 2)]
    assert not any(kept(one.data) for one in passed)
    assert filter_.withheld == 2


def test_a_sieve_lets_every_other_byte_pass() -> None:
    """Also what is no frame at all, and what only looks as if it were a key."""
    odd = [b"", b"\x00\x01\x00", b"\xfd" * 40 + b"\x00\x01\x00", said(BEAT)[:-1], said(HANDED)[1:]]
    filter_ = RecordFilter()
    assert [one.data for one in filter_.filter(Captured(data) for data in odd)] == odd
    assert filter_.withheld == 0


def test_who_decodes_or_watches_is_told_that_there_was_a_key_and_not_which() -> None:
    recording = tlog.encode(1_700_000_000_000_000, said(HANDED))
    decoder = Decoder("tlog")
    (one,) = decoder.feed(recording) + decoder.flush()
    assert one.plain()["fields"]["secret_key"] == HIDDEN
    assert one.plain()["fields"]["initial_timestamp"] == 7
    gauge = LinkGauge("tcp:127.0.0.1:1")
    gauge.receive(said(HANDED), 0.5)
    watched = msgspec.json.encode(gauge.reading(1.0))
    assert b"<hidden>" in watched
    shown = [repr(one), repr(one.frame), json.dumps(one.plain()), watched.decode()]
    assert not any(text in line for text in SHOWN for line in shown)


def test_no_way_to_print_a_message_prints_its_key() -> None:
    untyped = Untyped(SetupSigning.codec.definition.id, (1, 1, SECRET, 7))
    for message in (HANDED, untyped):
        told = [repr(message), str(message), f"{message!r}", str(message.__rich_repr__())]
        assert not any(text in line for text in SHOWN for line in told)
    assert repr(Untyped(4, (5,))) == "Untyped(msgid=4, values=(5,))"


def test_the_refusal_of_a_message_that_cannot_be_sent_shows_no_key() -> None:
    broken: list[tuple[int, Any]] = [(1, SECRET + b"x"), (1, [*SECRET]), (1, tuple(SECRET)), (300, SECRET)]
    for system, secret in broken:
        with pytest.raises(InvalidMessage) as refused:
            encode(SetupSigning(system, 1, secret, 7), sequence=0, system=1, component=1)
        assert not any(text in str(refused.value) for text in SHOWN)


def test_a_passive_sieve_lets_pass_what_tells_and_asks_but_nothing_that_commands() -> None:
    tells = [
        Heartbeat(6, 8, 0, 0, 4),
        GoalStatus(7, 9, 0.5, 1, 0, 255, 190, 2),
        Ping(1, 1),
        CommandAck(57601, 0),
        ParamRequestList(1, 1),
    ]
    orders = [
        Goal(7, 9, 0, (0.0,) * 7, 1, 1, 1),
        GoalCancel(7, 9, 1, 1),
        SetMode(9, 1, 1, 1),
        CommandLong(1, 1, 57601, 0, *(0.0,) * 7),
        ParamSet(1, 1, "TOOL_SPEED", 0.1, 9),
    ]
    mixed = [each for both in zip(tells, orders, strict=True) for each in both]
    whole = b"".join(encode(each, sequence=i, system=255, component=190) for i, each in enumerate(mixed))
    filter_ = RecordFilter(passive=True)
    (passed,) = filter_.filter([Captured(whole, 1)])
    assert [one.message for one in Parser().feed(passed.data)] == tells
    assert (filter_.commands.total(), filter_.withheld) == (len(orders), 0)
    assert [one.data for one in RecordFilter().filter([Captured(whole, 1)])] == [whole]


@pytest.mark.parametrize("name", ["MANUAL_CONTROL", "MISSION_ITEM_INT", "SET_POSITION_TARGET_LOCAL_NED"])
def test_what_commands_in_other_peoples_words_is_held_back_in_either_version_of_the_wire(name: str) -> None:
    number = by_name()[name].id
    assert commands(b"\xfd\0\0\0\0\1\1" + number.to_bytes(3, "little") + b"..")
    assert commands(bytes((0xFE, 0, 0, 1, 1, number)) + b"..")
