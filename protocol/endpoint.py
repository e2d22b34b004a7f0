"""One MAVLink component on one link: sends messages under its ids and sequence numbers, and receives frames.

A frame gets its sequence number and its signature when it is sent, not when it is queued. Telemetry that
waits is replaced by newer telemetry, which takes its place in the queue. If frames were numbered and signed
when they are queued, the numbers of the replaced ones would be missing, and an answer behind the newer
telemetry would be sent with an older timestamp than its predecessor: a receiver that checks signatures would
refuse it as a replay.

Pure: the link is passed in. An endpoint is the `Handler` of its link.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotree.protocol.frame import SIGNATURE_BYTES, close, pack
from robotree.protocol.parser import Parser, ParserStatistics, Verifier

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable

    from robotree.protocol.codec import Codec
    from robotree.protocol.errors import LinkError
    from robotree.protocol.frame import Frame, Signer
    from robotree.protocol.links.link import Link
    from robotree.protocol.messages import AnyMessage

_NUMBERS = [bytes((number,)) for number in range(256)]


class UnsentFrame:
    """One frame without its sequence number, checksum and signature.

    Args:
        message: its content.
        system: of the sender, 1 to 255.
        component: of the sender.
        sequences: the next number of each component; the frame takes one when it is sent.
        signer: signs the frame; None: it is sent unsigned.

    Raises:
        InvalidMessage: a field cannot hold its value.
        UnknownMessage: the dialect has no such message.
    """

    __slots__ = ("_body", "_codec", "_sequences", "_signer")

    def __init__(
        self,
        message: AnyMessage,
        system: int,
        component: int,
        sequences: dict[int, int],
        signer: Signer | None,
    ) -> None:
        self._codec: Codec = message.codec
        self._body = pack(message, 0, system, component, signer)
        self._sequences, self._signer = sequences, signer

    def __len__(self) -> int:
        """[bytes] that the frame will have."""
        return len(self._body) + (2 if self._signer is None else 2 + SIGNATURE_BYTES)

    def encode(self) -> bytes:
        """The whole frame; call it once, when it is sent."""
        body, component = self._body, self._body[6]
        sequence = self._sequences.get(component, 0)
        self._sequences[component] = sequence + 1 & 0xFF
        return close(body[:4] + _NUMBERS[sequence] + body[5:], self._codec, self._signer)


class Endpoint:
    """Sends and receives as one system over one link.

    Args:
        link: the open link.
        system: our system id, 1 to 255.
        component: our component id, unless `send` names another.
        on_frame: called with every frame that arrives.
        on_heard: called after the frames of the bytes that came together.
        on_closed: called once when the link has ended.
        signer: signs what we send.
        verifier: decides which frames are accepted.
    """

    def __init__(
        self,
        link: Link,
        *,
        system: int,
        component: int,
        on_frame: Callable[[Frame], None],
        on_heard: Callable[[], None] = lambda: None,
        on_closed: Callable[[LinkError], None] | None = None,
        signer: Signer | None = None,
        verifier: Verifier | None = None,
    ) -> None:
        self.link = link
        self.system, self.component = system, component
        self._on_frame, self._on_heard, self._on_closed = on_frame, on_heard, on_closed
        self._signer = signer
        self._parser = Parser(verifier)
        self._sequences: dict[int, int] = {}

    @property
    def statistics(self) -> ParserStatistics:
        """Statistics of received frames; those of sent ones are in `link.statistics`."""
        return self._parser.statistics

    def send(
        self,
        message: AnyMessage,
        *,
        telemetry: bool = False,
        component: int | None = None,
        instance: Hashable = None,
    ) -> None:
        """Send a message.

        Args:
            message: to send.
            telemetry: a newer one may replace it while the far end does not read.
            component: our component id; None: the endpoint's.
            instance: distinguishes telemetry of the same message, such as the name of a value.

        Raises:
            InvalidMessage: a field cannot hold its value.
        """
        speaker = self.component if component is None else component
        frame = UnsentFrame(message, self.system, speaker, self._sequences, self._signer)
        self.link.send(frame, (speaker, message.codec.definition.id, instance) if telemetry else None)

    def set_signer_pair(self, signer: Signer | None, verifier: Verifier | None) -> None:
        """Use another signer and verifier from now on.

        Frames that came with the same bytes as the present one are already checked; frames that wait to be
        sent keep their signer.
        """
        self._signer, self._parser.verifier = signer, verifier

    def received(self, data: bytes) -> None:
        """Bytes came over the link."""
        for frame in self._parser.feed(data):
            self._on_frame(frame)
        self._on_heard()

    def closed(self, reason: LinkError) -> None:
        """The link has ended."""
        if self._on_closed is not None:
            self._on_closed(reason)
