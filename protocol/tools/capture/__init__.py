"""Recordings of a wire that other tools read and write: decoded, measured and replayed.

Formats: raw bytes, the .tlog of MAVLink tools, the log of candump. All of it is pure but `files`.

    >>> from robotree.protocol.tools.capture import Decoder, tlog
    >>> from robotree.protocol import encode
    >>> from robotree.protocol.messages import GoalCancel
    >>> frame = encode(GoalCancel(1, 1, key=7), sequence=0, system=255, component=190)
    >>> decoder = Decoder("tlog")
    >>> [decoded] = decoder.feed(tlog.encode(1_700_000_000_000_000, frame))
    >>> decoded.frame.name, decoded.time
    ('ROBOTREE_GOAL_CANCEL', 1700000000000000)
"""

from robotree.protocol.tools.capture.decode import Decoded, Decoder, DecoderStatistics, detect
from robotree.protocol.tools.capture.files import Recording
from robotree.protocol.tools.capture.records import BadRecording, Captured, NoFrame

__all__ = [
    "BadRecording",
    "Captured",
    "Decoded",
    "Decoder",
    "DecoderStatistics",
    "NoFrame",
    "Recording",
    "detect",
]
