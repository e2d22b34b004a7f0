"""What a robot tells about itself, and how often: a stream for each kind of message.

Times are controller time, so a stream keeps its rate per simulated second. Pure.
"""

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from robotree.protocol.messages import Message

HOT: Final = 20
"""[ms] between two poses: 50 Hz."""
WARM: Final = 100
"""[ms] between two readings of what changes slowly: 10 Hz."""
_WORD: Final = 0xFFFFFFFF


def boot_ms(now: int) -> int:
    """Controller time [ms] as messages hold it: it begins anew every 49.7 days, as MAVLink's does."""
    return now & _WORD


class Stream(NamedTuple):
    """Messages of one kind.

    Attributes:
        kind: of message.
        period: [ms] between two, unless a client asks for another; None: only when asked for.
        read: the messages of one reading, at controller time [ms] as messages hold it, and told whether
            something moves.
    """

    kind: type[Message]
    period: int | None
    read: Callable[[int, bool], Sequence[Message]]

    @property
    def msgid(self) -> int:
        """Of its kind, on the wire."""
        return self.kind.codec.definition.id
