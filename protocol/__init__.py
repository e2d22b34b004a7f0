"""The wire: real MAVLink 2, so that other people's tools see the robots too.

Typed messages become frames and frames messages; a parser survives anything; services are state machines
without I/O; links carry the bytes.

    >>> from robotree.protocol import Parser, encode
    >>> from robotree.protocol.messages import Gripper
    >>> sent = Gripper(time_boot_ms=1, width=0.04, commanded=0.04, force=0.0, state=0)
    >>> [frame] = Parser().feed(encode(sent, sequence=7, system=1, component=1))
    >>> frame.sequence, frame.message.commanded == frame.message.width
    (7, True)
"""

from robotree.protocol.endpoint import Endpoint
from robotree.protocol.frame import Frame, Signer, encode
from robotree.protocol.parser import Parser, ParserStatistics, Verifier

__all__ = ["Endpoint", "Frame", "Parser", "ParserStatistics", "Signer", "Verifier", "encode"]
