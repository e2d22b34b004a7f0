"""A python-can interface named `robotree`: a CAN bus between processes of one machine.

For machines whose kernel has no CAN, as containers and most continuous integration. Members meet on a row
of ports of 127.0.0.1; nothing is multicast and nothing leaves the machine. Each member is connected to each
other one directly, so there is no hub to be lost or to be waited for. As on a real bus, every
program on the machine can listen and send: what must not be forged has to be signed.

    >>> import can
    >>> with can.Bus(interface="robotree", channel="doctest") as one, can.Bus(
    ...     interface="robotree", channel="doctest"
    ... ) as other:
    ...     one.send(can.Message(arbitration_id=0x123, is_extended_id=False, data=b"hello"))
    ...     print(bytes(other.recv(timeout=5).data))
    b'hello'

Watch a bus from another terminal: `python -m can.logger -i robotree -c CHANNEL`.
"""

from robotree.protocol.canbus.bus import BusStatistics, LoopbackBus
from robotree.protocol.canbus.membership import SEATS, channel_id, first_port

__all__ = ["SEATS", "BusStatistics", "LoopbackBus", "channel_id", "first_port"]
