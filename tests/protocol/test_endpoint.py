"""An endpoint numbers and signs what it says in the order in which it leaves, and hears what is said."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol import Endpoint, Frame, Parser, encode
from robotree.protocol.errors import InvalidMessage, LinkBroken, LinkError
from robotree.protocol.links import udp
from robotree.protocol.links.link import Unsent, encoded
from robotree.protocol.links.loopback import Loopback
from robotree.protocol.links.outbox import Outbox
from robotree.protocol.links.url import connect, listen
from robotree.protocol.messages import AnyMessage, GoalStatus, Gripper, Joints, NamedValueFloat, Timesync
from robotree.protocol.signing import Key, Signer, SigningTime, StreamTable, Verifier
from robotree.protocol.testing import RecordingHandler, until


class Paper:
    """A link that keeps what is written on it."""

    address = "paper:"
    congested = False

    def __init__(self) -> None:
        self.written: list[tuple[bytes, object]] = []

    def send(self, frame: bytes | Unsent, topic: object = None) -> None:
        self.written.append((encoded(frame), topic))


def _endpoint() -> tuple[Paper, Endpoint]:
    paper = Paper()
    return paper, Endpoint(paper, system=1, component=1, on_frame=lambda _: None)  # type: ignore[arg-type]  # enough of a link


def test_every_speaker_counts_its_own_frames() -> None:
    paper, endpoint = _endpoint()
    for _ in range(300):
        endpoint.send(Timesync(1, 2))
    endpoint.send(Timesync(1, 2), component=100)
    frames = Parser().feed(b"".join(frame for frame, _ in paper.written))
    assert [frame.sequence for frame in frames[:300]] == [i % 256 for i in range(300)]
    assert (frames[300].component, frames[300].sequence) == (100, 0)


def test_only_telemetry_of_the_same_speaker_message_and_instance_is_superseded() -> None:
    paper, endpoint = _endpoint()
    endpoint.send(Timesync(1, 2))
    endpoint.send(Gripper(0, 0.0, 0.0, 0.0, 0), telemetry=True)
    endpoint.send(Gripper(1, 0.0, 0.0, 0.0, 0), telemetry=True)
    endpoint.send(Gripper(1, 0.0, 0.0, 0.0, 0), telemetry=True, component=2)
    endpoint.send(NamedValueFloat(0, "force", 1.0), telemetry=True, instance="force")
    endpoint.send(NamedValueFloat(0, "angle", 1.0), telemetry=True, instance="angle")
    topics = [topic for _, topic in paper.written]
    assert topics[0] is None
    assert topics[1] == topics[2]
    assert len({*topics}) == 5


def test_frames_and_the_end_are_told() -> None:
    heard: list[Frame] = []
    reasons: list[LinkError] = []
    network = Loopback(
        lambda link: Endpoint(link, system=1, component=1, on_frame=heard.append, on_closed=reasons.append),
        RecordingHandler,
    )
    network.far.send(Frame.of(Timesync(1, 2)).raw + b"noise")
    network.cut("a mouse")
    network.advance()
    assert [type(reason) for reason in reasons] == [LinkBroken]
    network = Loopback(
        lambda link: Endpoint(link, system=1, component=1, on_frame=heard.append), RecordingHandler
    )
    network.far.send(Frame.of(Timesync(1, 2)).raw + b"noise")
    network.advance()
    assert [frame.message for frame in heard] == [Timesync(1, 2)]
    assert isinstance(network.near.handler, Endpoint)
    assert network.near.handler.statistics.skipped == 5
    network.near.close()
    network.advance()


KEY = Key(bytes(range(32)))
NOW = 1.7e9
STATUS = GoalStatus(7, 1, 0.0, 0, 0, 1, 1, 2, "there")


def joints(moment: int) -> Joints:
    return Joints(moment, (0.5,) * 8, 6)


class Shelf:
    """A link on which everything waits until it is asked for."""

    address, congested = "shelf:", True

    def __init__(self) -> None:
        self.box = Outbox()
        self.send = self.box.put

    def emptied(self) -> Iterator[bytes]:
        while (frame := self.box.pop()) is not None:
            yield frame


def speaker(link: object, signer: Signer | None = None) -> Endpoint:
    return Endpoint(link, system=1, component=1, on_frame=lambda _: None, signer=signer)  # type: ignore[arg-type]  # enough of a link


def parser(key: Key) -> Parser:
    return Parser(Verifier(key, SigningTime(lambda: NOW), StreamTable()))


async def test_an_answer_behind_telemetry_that_was_replaced_passes_the_signature_check() -> None:
    heard: list[Frame] = []
    ears: list[Endpoint] = []

    def accept(link: udp.UdpLink) -> Endpoint:
        verifier = Verifier(KEY, SigningTime(lambda: NOW), StreamTable())
        ears.append(Endpoint(link, system=9, component=1, on_frame=heard.append, verifier=verifier))
        return ears[0]

    listener = await listen("udp:0", accept)  # type: ignore[arg-type]  # of a listener over UDP
    link = await connect(listener.address, RecordingHandler)
    assert isinstance(link, udp.UdpLink)
    endpoint = speaker(link, Signer(KEY, SigningTime(lambda: NOW)))
    link._carrier.pause_writing()
    endpoint.send(joints(0), telemetry=True)
    endpoint.send(STATUS)
    endpoint.send(joints(1), telemetry=True)  # takes the place of the first, before the answer
    link._carrier.resume_writing()
    await until(lambda: ears and ears[0].statistics.received + ears[0].statistics.refused == 2)
    assert [frame.message for frame in heard] == [joints(1), STATUS]
    assert (ears[0].statistics.refused, ears[0].statistics.lost, ears[0].statistics.late) == (0, 0, 0)
    link.close()
    await listener.close()


said = st.lists(st.sampled_from(["joints", "gripper", "status"]), max_size=40)


@pytest.mark.parametrize("key", [None, KEY])
@given(said)
def test_what_was_replaced_leaves_no_gap_and_nothing_is_late_or_refused(
    key: Key | None, words: list[str]
) -> None:
    shelf = Shelf()
    endpoint = speaker(shelf, key and Signer(key, SigningTime(lambda: NOW)))
    ear = parser(key) if key else Parser()
    messages: dict[str, AnyMessage] = {
        "joints": joints(3),
        "gripper": Gripper(3, 0.1, 0.1, 0.0, 1),
        "status": STATUS,
    }
    for word in words:
        endpoint.send(messages[word], telemetry=word != "status")
    waiting = shelf.box.waiting
    left = b"".join(shelf.emptied())
    assert len(left) == waiting, "what waits is as long as what leaves"
    frames = ear.feed(left)
    assert [frame.sequence for frame in frames] == list(range(len(frames)))
    assert len(frames) == words.count("status") + len({*words} - {"status"})
    assert (ear.statistics.lost, ear.statistics.late, ear.statistics.refused) == (0, 0, 0)


@pytest.mark.parametrize("message", [joints(1), STATUS, Joints(0, (0.0,) * 8, 0)])
@pytest.mark.parametrize("signed", [False, True])
def test_a_frame_that_waited_is_the_frame_that_did_not(message: AnyMessage, signed: bool) -> None:  # noqa: FBT001
    shelf = Shelf()
    signers = [Signer(KEY, SigningTime(lambda: NOW)) if signed else None for _ in range(2)]
    speaker(shelf, signers[0]).send(message)
    (left,) = shelf.emptied()
    assert left == encode(message, sequence=0, system=1, component=1, signer=signers[1])


def test_what_was_said_before_the_key_changed_is_signed_with_the_old_one() -> None:
    shelf, new = Shelf(), Key(bytes(32))
    time = SigningTime(lambda: NOW)
    endpoint = speaker(shelf, Signer(KEY, time))
    endpoint.send(STATUS)
    endpoint.set_signer_pair(Signer(new, time), None)
    endpoint.send(STATUS)
    first, second = shelf.emptied()
    assert len(parser(KEY).feed(first)) == len(parser(new).feed(second)) == 1


def test_a_value_that_a_field_cannot_hold_is_told_at_once() -> None:
    shelf = Shelf()
    with pytest.raises(InvalidMessage):
        speaker(shelf).send(Joints(-1, (0.5,) * 8, 6))
    assert list(shelf.emptied()) == []


def test_bytes_leave_as_they_are() -> None:
    assert encoded(b"whole") == b"whole"
