"""An endpoint numbers what it says and hears what is said."""

from __future__ import annotations

from robotree.protocol import Endpoint, Frame, Parser
from robotree.protocol.errors import LinkBroken, LinkError
from robotree.protocol.links.link import Unsent, encoded
from robotree.protocol.links.loopback import Loopback
from robotree.protocol.messages import Gripper, NamedValueFloat, Timesync
from robotree.protocol.testing import RecordingHandler


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
