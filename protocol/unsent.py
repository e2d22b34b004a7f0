"""A frame that gets its sequence number and its signature when it is sent, not when it is queued.

Telemetry that waits is replaced by newer telemetry, which takes its place in the queue. If frames were
numbered and signed when they are queued, the numbers of the replaced ones would be missing, and an answer
behind the newer telemetry would be sent with an older timestamp than its predecessor: a receiver that checks
signatures would refuse it as a replay.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotree.protocol.frame import SIGNATURE_BYTES, close, pack

if TYPE_CHECKING:
    from robotree.protocol.codec import Codec
    from robotree.protocol.frame import Signer
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
