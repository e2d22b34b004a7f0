"""Sentences survive being cut, reordered and torn inside a letter."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol import Frame
from robotree.protocol.messages import MavSeverity, Statustext, Timesync
from robotree.protocol.services.statustext import (
    CHUNK,
    CHUNKS_WITHIN,
    LONGEST,
    MAX_PEERS,
    StatustextReceiver,
    StatustextSender,
)

if TYPE_CHECKING:
    from robotree.protocol.messages import AnyMessage

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
    assert len(listener._unfinished) == MAX_PEERS
    assert listener.receive(Frame.of(Timesync(1, 1)), "link", 0.0) == []
