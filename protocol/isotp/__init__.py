"""ISO 15765-2 (ISO-TP): payloads of up to 4095 bytes over CAN frames of 8 bytes, or of 64 with CAN FD.

No I/O and no clock: `now` is an argument, data fields go in and out. `frames` is the codec, `Sender` and
`Receiver` are the two halves, `Channel` is both for one partner.
"""

from robotree.protocol.errors import PayloadSize, TransferUnderWay
from robotree.protocol.isotp.channel import (
    Channel,
    ChannelStatistics,
    Failure,
    Heard,
    Receiver,
    ReceiverStatistics,
    Sender,
    SenderStatistics,
)
from robotree.protocol.isotp.frames import CLASSIC, FD, LARGEST, FlowControl, FlowStatus

__all__ = [
    "CLASSIC",
    "FD",
    "LARGEST",
    "Channel",
    "ChannelStatistics",
    "Failure",
    "FlowControl",
    "FlowStatus",
    "Heard",
    "PayloadSize",
    "Receiver",
    "ReceiverStatistics",
    "Sender",
    "SenderStatistics",
    "TransferUnderWay",
]
