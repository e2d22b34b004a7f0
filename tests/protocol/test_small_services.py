"""Small services: what we are, heartbeats, two clocks, sentences, rates and pictures."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotree.protocol import Frame
from robotree.protocol.errors import InvalidMessage
from robotree.protocol.messages import (
    CommandAck,
    CommandLong,
    DataTransmissionHandshake,
    EncapsulatedData,
    Heartbeat,
    MavCmd,
    MavProtocolCapability,
    MavResult,
    MavSeverity,
    MavState,
    Message,
    MessageInterval,
    Ping,
    Statustext,
    Timesync,
)
from robotree.protocol.services import heartbeat, ping, statustext
from robotree.protocol.services.command import CommandServer
from robotree.protocol.services.heartbeat import HeartbeatSender
from robotree.protocol.services.interval import FASTEST, Intervals, handlers
from robotree.protocol.services.peer import Peer, Send
from robotree.protocol.services.picture import LARGEST, MAX_PEERS, PACKET, Picture, PictureReceiver, split
from robotree.protocol.services.statustext import (
    CHUNK,
    CHUNKS_WITHIN,
    LONGEST,
    StatustextReceiver,
    StatustextSender,
)
from robotree.protocol.services.timesync import DRIFT, KEPT, PERIOD, Synchroniser, answer
from robotree.protocol.services.version import autopilot_version, packed, protocol_version

if TYPE_CHECKING:
    from robotree.protocol.messages import AnyMessage

ARM, ROVER, US = Peer("link", 1, 1), Peer("link", 2, 1), Peer("link", 255, 190)


def test_everyone_who_hears_a_ping_answers_it_and_every_answer_is_measured() -> None:
    pinger = ping.Pinger(255, 190)
    question = pinger.ask(5.0)
    (answer,) = ping.answer(question, US)
    assert ping.answer(answer, ARM) == []
    assert pinger.receive(answer, ARM, 5.25) == ping.PingAnswer(1, 0.25, 1, 1)
    assert pinger.receive(answer, ROVER, 5.5) == ping.PingAnswer(1, 0.5, 2, 1)
    assert pinger.tick(20.0) == []
    assert pinger.receive(answer, ARM, 20.0) is None


def test_questions_without_an_answer_are_counted_and_forgotten() -> None:
    pinger = ping.Pinger(255, 190)
    for i in range(3):
        pinger.ask(float(i))
    assert pinger.tick(ping.LOST_AFTER + 1.0) == [1, 2]
    assert pinger.lost == 2
    assert pinger.receive(Ping(0, 3, 254, 190), ARM, 2.5) is None, "an answer to somebody else"
    assert pinger.receive(Ping(0, 9, 255, 190), ARM, 2.5) is None, "an answer to nothing"


@pytest.mark.parametrize(
    ("version", "wire"),
    [
        ("1.2.3", 0x010203FF),
        ("0.1.0", 0x000100FF),
        ("2.0rc1", 0x020000C0),
        ("2.0.1b3", 0x02000180),
        ("300.1", 0xFF0100FF),
        ("1.0.0.dev5", 0x01000000),
        ("unknown", 0),
    ],
)
def test_a_version_is_packed_into_four_bytes(version: str, wire: int) -> None:
    assert packed(version) == wire


def test_we_offer_real_numbers_as_parameters_and_speak_version_2() -> None:
    told = Frame.of(autopilot_version("1.2.3", uid=7)).message
    assert told == autopilot_version("1.2.3", uid=7)
    capabilities = autopilot_version("1.2.3", uid=7).capabilities
    assert capabilities & MavProtocolCapability.MAVLINK2
    assert capabilities & MavProtocolCapability.PARAM_ENCODE_C_CAST
    assert Frame.of(protocol_version()).message == protocol_version()
    assert protocol_version().version == 200


BEAT = Heartbeat(0, 0, 0, 0, MavState.ACTIVE)


def test_the_first_heartbeat_goes_at_once_and_then_one_per_period() -> None:
    sender = HeartbeatSender()
    beats = [len(sender.tick(BEAT, i / 100)) for i in range(1001)]
    assert beats[0] == 1
    assert sum(beats) == 11


def test_a_late_tick_does_not_shift_the_beat_and_a_long_sleep_is_not_made_up_for() -> None:
    sender = HeartbeatSender()
    sender.tick(BEAT, 0.0)
    assert sender.tick(BEAT, 1.25) == [BEAT]
    assert sender.tick(BEAT, 1.9) == []
    assert sender.tick(BEAT, 2.0) == [BEAT]
    assert sender.tick(BEAT, 50.0) == [BEAT]
    assert sender.tick(BEAT, 50.0 + heartbeat.PERIOD / 4) == []


def test_a_change_of_state_does_not_wait_for_the_beat() -> None:
    sender = HeartbeatSender()
    sender.tick(BEAT, 0.0)
    sender.hurry()
    assert sender.tick(BEAT, 0.1) == [BEAT]
    assert sender.tick(BEAT, 0.2) == []


@pytest.mark.parametrize("patience", [0.6, 2.0, 3.0])
def test_who_must_hear_us_does_so_though_three_heartbeats_in_a_row_are_lost(patience: float) -> None:
    sender = HeartbeatSender()
    sender.tick(BEAT, 0.0)
    sender.keep(patience)
    beats = [0.0, *(i / 100 for i in range(1, 1001) if sender.tick(BEAT, i / 100))]
    assert max(later - earlier for earlier, later in zip(beats, beats[4:], strict=False)) < 0.9 * patience
    sender.keep(math.inf)
    assert len([i for i in range(1001, 2001) if sender.tick(BEAT, i / 100)]) in {10, 11}


delays = st.lists(st.tuples(st.floats(0, 0.3), st.floats(0, 0.3)), min_size=1, max_size=2 * KEPT)


def expect_right(ours: Synchroniser, now: float, there: float, back: float, offset: float) -> None:
    """Ask the time over a way of two delays [s], and compare the estimate with the offset [s]."""
    (question,) = ours.tick(now)
    (reply,) = answer(question, now + there + offset)
    estimate = ours.receive(reply, now + there + back)
    assert estimate is not None
    assert abs(estimate.offset - offset) <= estimate.delay + 1e-6


@given(offset=st.floats(-1e6, 1e6), ways=delays)
def test_the_offset_is_right_to_within_the_best_delay(offset: float, ways: list[tuple[float, float]]) -> None:
    ours, now = Synchroniser(), max(0.0, -offset) + 1.0
    for there, back in ways:
        now += PERIOD
        expect_right(ours, now, there, back, offset)
    shortest = min(sum(way) for way in ways[-KEPT:])
    assert ours.estimate is not None
    assert abs(ours.estimate.delay - shortest / 2) < 1e-6


def test_only_questions_are_answered_and_only_ours_are_believed() -> None:
    ours = Synchroniser()
    assert ours.estimate is None
    (question,) = ours.tick(5.0)
    assert ours.tick(5.5) == []
    assert answer(Timesync(tc1=3, ts1=4), 1.0) == []
    assert ours.receive(question, 5.1) is None
    assert ours.receive(Timesync(tc1=1, ts1=4), 5.1) is None
    (reply,) = answer(question, 0.0)
    assert reply.tc1, "an answer is never a question, not even at the beginning of time"
    assert ours.receive(reply, 5.1) is not None
    assert ours.receive(reply, 5.1) is None, "once"


def test_an_answer_from_long_ago_is_not_believed() -> None:
    ours = Synchroniser()
    (question,) = ours.tick(0.0)
    (reply,) = answer(question, 1.0)
    assert ours.receive(reply, 11.0) is None


@given(
    before=st.floats(-1e6, 1e6),
    step=st.floats(1.0, 1e6),
    sign=st.sampled_from([-1, 1]),
    ways=delays,
    new_ways=delays,
)
def test_a_far_clock_that_was_set_anew_is_believed_at_once(
    before: float,
    step: float,
    sign: int,
    ways: list[tuple[float, float]],
    new_ways: list[tuple[float, float]],
) -> None:
    ours, after = Synchroniser(), before + sign * (step + 1.0)  # no delay here explains more than 0.6 s
    now = max(0.0, -before, -after) + 1.0
    for offset, each in ((before, ways), (after, new_ways)):
        for there, back in each:
            now += PERIOD
            expect_right(ours, now, there, back, offset)


def test_clocks_that_drift_are_no_reason_to_begin_anew() -> None:
    ours, drift = Synchroniser(), DRIFT * 0.9
    for i in range(1, 3 * KEPT):
        (question,) = ours.tick(now := i * PERIOD)
        delay = 1e-6 if i == 2 * KEPT else 1e-5
        (reply,) = answer(question, (now + delay) * (1 + drift) + 100.0)
        ours.receive(reply, now + 2 * delay)
    assert ours.estimate is not None
    assert ours.estimate.delay < 2e-6, "the best of the last few counts"


sentences = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=200)


def _frames(messages: list[AnyMessage]) -> list[Frame]:
    return [Frame.of(message) for message in messages]


@given(text=sentences, order=st.randoms(use_true_random=False))
def test_a_sentence_arrives_in_whatever_order_its_chunks_do(text: str, order: st.random.Random) -> None:  # type: ignore[name-defined]  # Hypothesis' own
    frames, listener = _frames(StatustextSender().say(MavSeverity.WARNING, text)), StatustextReceiver()
    order.shuffle(frames)
    heard = [each for frame in frames for each in listener.receive(frame, "link", 0.0)]
    assert [(each.severity, each.text) for each in heard] == [(MavSeverity.WARNING, text)]
    assert listener.tick(100.0) == []


def test_a_short_sentence_is_one_message_without_a_number() -> None:
    (message,) = StatustextSender().say(MavSeverity.INFO, "x" * CHUNK)
    frame = Frame.of(message)
    assert frame.message == Statustext(MavSeverity.INFO, "x" * CHUNK, 0, 0)


def test_a_sentence_that_fills_its_last_chunk_ends_with_an_empty_one() -> None:
    messages = _frames(StatustextSender().say(MavSeverity.INFO, "x" * 2 * CHUNK))
    assert [frame.message for frame in messages] == [
        Statustext(MavSeverity.INFO, "x" * CHUNK, 1, 0),
        Statustext(MavSeverity.INFO, "x" * CHUNK, 1, 1),
        Statustext(MavSeverity.INFO, "", 1, 2),
    ]


def test_sentences_are_numbered_from_1_to_65535_and_cut_at_the_longest() -> None:
    speaker = StatustextSender()
    numbers = [Frame.of(speaker.say(MavSeverity.INFO, "x" * 60)[0]).message for _ in range(3)]
    assert [message.id for message in numbers if isinstance(message, Statustext)] == [1, 2, 3]
    speaker._id = 65535
    (first, *_) = speaker.say(MavSeverity.INFO, "x" * 2 * LONGEST)
    assert Frame.of(first).message == Statustext(MavSeverity.INFO, "x" * CHUNK, 1, 0)
    frames = _frames(speaker.say(MavSeverity.INFO, "x" * 2 * LONGEST))
    listener = StatustextReceiver()
    (heard,) = [each for frame in frames for each in listener.receive(frame, "link", 0.0)]
    assert heard.text == "x" * LONGEST


def test_a_missing_chunk_is_marked_when_patience_ends() -> None:
    frames, listener = (
        _frames(StatustextSender().say(MavSeverity.ERROR, "a" * 50 + "b" * 50 + "c")),
        StatustextReceiver(),
    )
    for frame in (frames[0], frames[2]):
        assert listener.receive(frame, "link", 0.0) == []
    assert listener.tick(CHUNKS_WITHIN * 0.9) == []
    (heard,) = listener.tick(CHUNKS_WITHIN)
    assert heard.text == "a" * 50 + "[...]" + "c"


def test_a_missing_end_is_marked_too() -> None:
    frames, listener = _frames(StatustextSender().say(MavSeverity.ERROR, "a" * 60)), StatustextReceiver()
    listener.receive(frames[0], "link", 0.0)
    (heard,) = listener.tick(CHUNKS_WITHIN)
    assert heard.text == "a" * 50 + "[...]"


def test_sentences_of_two_speakers_are_kept_apart_and_forged_ones_do_not_pile_up() -> None:
    listener = StatustextReceiver()
    one, two = (_frames(StatustextSender().say(MavSeverity.INFO, letter * 60)) for letter in "ab")
    heard = [
        each
        for pair in zip(one, two, strict=True)
        for link, frame in zip(("link 1", "link 2"), pair, strict=True)
        for each in listener.receive(frame, link, 0.0)
    ]
    assert [(each.peer.via, each.text[0]) for each in heard] == [("link 1", "a"), ("link 2", "b")]
    for number in range(1, 500):
        listener.receive(Frame.of(Statustext(1, "x" * 50, number, 0)), "link", 0.0)
    assert len(listener._unfinished) == statustext.MAX_PEERS
    assert listener.receive(Frame.of(Timesync(1, 1)), "link", 0.0) == []


JOINTS, TOOL, MODE = 57600, 57601, 57606


@pytest.fixture
def rates() -> Intervals:
    return Intervals({JOINTS: 0.1, TOOL: 0.05, MODE: None})


def _count(rates: Intervals, seconds: float, step: float = 0.001) -> dict[int, int]:
    counts = {JOINTS: 0, TOOL: 0, MODE: 0}
    for i in range(round(seconds / step)):
        for msgid in rates.due(i * step):
            counts[msgid] += 1
    return counts


def test_every_message_has_its_own_rate(rates: Intervals) -> None:
    assert _count(rates, 10.0) == {JOINTS: 100, TOOL: 200, MODE: 0}


@pytest.mark.parametrize("step", [0.003, 0.007, 0.03])
def test_a_coarse_clock_does_not_lower_a_rate(step: float) -> None:
    counts = _count(Intervals({JOINTS: 0.1, TOOL: 0.05, MODE: None}), 30.0, step)
    assert counts[JOINTS] == pytest.approx(300, abs=2)
    assert counts[TOOL] == pytest.approx(600, abs=2)


def test_a_long_sleep_is_not_made_up_for(rates: Intervals) -> None:
    rates.due(0.0)
    assert sorted(rates.due(100.0)) == [JOINTS, TOOL]
    assert rates.due(100.001) == []


@pytest.mark.parametrize(
    ("wish", "interval_us"),
    [
        (20_000, 20_000),
        (-1, -1),
        (0, 100_000),
        (1, round(FASTEST * 1e6)),
        (2e9, 2_000_000_000),
        (1e12, 2**31 - 1),
    ],
)
def test_a_rate_is_set_as_wished_and_told_as_it_is(rates: Intervals, wish: float, interval_us: int) -> None:
    assert rates.set(JOINTS, wish, 0.0)
    assert rates.get(JOINTS) == MessageInterval(JOINTS, interval_us)


@pytest.mark.parametrize(("msgid", "wish"), [(1, 1000.0), (JOINTS, -2.0), (JOINTS, math.inf), (-1, 0.0)])
def test_what_makes_no_sense_changes_nothing(rates: Intervals, msgid: int, wish: float) -> None:
    assert not rates.set(msgid, wish, 0.0)
    assert rates.get(JOINTS) == MessageInterval(JOINTS, 100_000)


def test_the_commands_speak_of_the_link_that_asks() -> None:
    links = {name: Intervals({JOINTS: 0.1}) for name in ("link 1", "link 2")}
    server = CommandServer(
        {},
        handlers(lambda via: links[str(via)], lambda msgid, _: [Timesync(1, 2)] * (msgid == 111)),
    )

    def ask(command: int, *params: float) -> list[Message]:
        padded = (*params, *[math.nan] * (7 - len(params)))
        effects = server.receive(CommandLong(1, 1, command, 0, *padded), Peer("link 1", 255, 190), 0.0)
        assert all(isinstance(each, Send) and each.via == "link 1" for each in effects)
        messages = [each.message for each in effects if isinstance(each, Send)]
        return [each for each in messages if isinstance(each, Message)]

    def result(messages: list[Message]) -> int:
        assert isinstance(messages[0], CommandAck)
        return messages[0].result

    assert result(ask(MavCmd.SET_MESSAGE_INTERVAL, JOINTS, 20_000)) == MavResult.ACCEPTED
    assert result(ask(MavCmd.SET_MESSAGE_INTERVAL, 1, 20_000)) == MavResult.DENIED
    assert ask(MavCmd.GET_MESSAGE_INTERVAL, JOINTS)[1:] == [MessageInterval(JOINTS, 20_000)]
    assert result(ask(MavCmd.GET_MESSAGE_INTERVAL, 1)) == MavResult.DENIED
    assert links["link 2"].get(JOINTS) == MessageInterval(JOINTS, 100_000)
    assert ask(MavCmd.REQUEST_MESSAGE, 111)[1:] == [Timesync(1, 2)]
    assert result(ask(MavCmd.REQUEST_MESSAGE, 7)) == MavResult.DENIED
    assert result(ask(MavCmd.REQUEST_MESSAGE)) == MavResult.DENIED


def test_what_is_sent_at_one_rate_only_is_told_and_never_changed() -> None:
    rates = Intervals({JOINTS: 0.1}, fixed={MODE: 0.5})
    assert rates.get(MODE) == MessageInterval(MODE, 500_000)
    assert not rates.set(MODE, 20_000, 0.0)
    assert rates.due(0.0) == [JOINTS]
    assert rates.due(0.05) == []
    assert rates.due(0.1) == [JOINTS]


CAMERA = Peer("link", 1, 100)


def _receive(receiver: PictureReceiver, messages: list[Message], component: int = 100) -> list[Picture]:
    frames = [Frame.of(message, component=component) for message in messages]
    return [picture for frame in frames for picture in receiver.receive(frame, "link")]


@settings(deadline=None)
@given(data=st.binary(min_size=1, max_size=5 * PACKET))
def test_a_picture_arrives_as_it_was_zeros_at_its_end_included(data: bytes) -> None:
    receiver = PictureReceiver()
    messages = split(data, width=320, height=240, quality=80)
    assert _receive(receiver, messages) == [Picture(CAMERA, data, 320, 240, 80)]
    assert receiver.statistics.received == 1
    assert receiver.statistics.dropped == 0


@given(missing=st.integers(0, 5))
def test_a_picture_with_a_hole_is_dropped_and_the_next_one_arrives(missing: int) -> None:
    receiver, data = PictureReceiver(), bytes(range(256)) * 4
    messages = split(data, width=1, height=1, quality=1)
    assert len(messages) == 6
    assert _receive(receiver, [*messages[:missing], *messages[missing + 1 :]]) == []
    (picture,) = _receive(receiver, messages)
    assert picture.data == data
    assert receiver.statistics.received == 1
    assert receiver.statistics.dropped == (missing > 0)


def test_pictures_of_two_cameras_may_be_mixed() -> None:
    receiver = PictureReceiver()
    cell = split(b"c" * 600, width=1, height=1, quality=1)
    wrist = split(b"w" * 600, width=1, height=1, quality=1)
    arrived = [
        picture
        for pair in zip(cell, wrist, strict=True)
        for component, message in zip((100, 101), pair, strict=True)
        for picture in _receive(receiver, [message], component)
    ]
    assert [(each.peer.component, each.data[:1]) for each in arrived] == [(100, b"c"), (101, b"w")]


@pytest.mark.parametrize(
    ("size", "packets", "payload"), [(0, 0, 253), (10**9, 4, 253), (500, 3, 253), (5, 1, 0)]
)
def test_an_announcement_that_makes_no_sense_is_counted(size: int, packets: int, payload: int) -> None:
    receiver = PictureReceiver()
    nonsense = DataTransmissionHandshake(0, size, 1, 1, packets, payload, 1)
    assert _receive(receiver, [nonsense, EncapsulatedData(0, b"x")]) == []
    assert receiver.statistics.dropped == 1


def test_announcements_without_pictures_do_not_pile_up() -> None:
    receiver = PictureReceiver()
    for component in range(100):
        _receive(receiver, split(b"x" * 600, width=1, height=1, quality=1)[:1], component)
    assert len(receiver._unfinished) == MAX_PEERS
    receiver.link_closed("link")
    assert receiver.statistics.dropped == 100


@pytest.mark.parametrize("data", [b"", bytes(LARGEST + 1)])
def test_what_is_no_picture_is_not_sent(data: bytes) -> None:
    with pytest.raises(InvalidMessage, match="carries pictures of 1 to"):
        split(data, width=1, height=1, quality=1)
