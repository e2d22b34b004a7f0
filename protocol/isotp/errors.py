"""Our own mistakes when sending through ISO-TP. What arrives never raises: it is counted.

::

LocalProtocolError
  PayloadSize         no such payload can be sent
  TransferUnderWay    the one before has not ended
"""

from __future__ import annotations

from robotree.protocol.errors import LocalProtocolError
from robotree.protocol.isotp.frames import LARGEST


class PayloadSize(LocalProtocolError):
    """A payload of this size cannot be sent."""

    def __init__(self, size: int) -> None:
        self.size = size
        super().__init__(f"a payload of {size} bytes cannot be sent; ISO-TP carries 1 to {LARGEST}")


class TransferUnderWay(LocalProtocolError):
    """The transfer before has not ended."""

    def __init__(self, size: int, position: int) -> None:
        self.size, self.position = size, position
        sentence = f"{position} of {size} bytes are sent; wait until `busy` is false, or abandon it"
        super().__init__(sentence)
