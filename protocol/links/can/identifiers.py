"""The 29-bit identifiers on the bus. Pure.

The layout is that of ISO 15765-2 "normal fixed addressing", which is also that of SAE J1939, so that loggers,
dissectors and ISO-TP stacks that know nothing of us take our frames apart:

======  ==========  ====================================================================================
bits    field       why
======  ==========  ====================================================================================
28-26   priority    the lowest identifier wins the bus, see `Priority`
25-24   0           reserved, and data page, in J1939
23-16   kind        0xDA ISO-TP to one node, 0xDB ISO-TP to all, 0xEF link control (J1939 proprietary A)
15-8    target      who shall hear it; 0xFF: everybody
7-0     source      who speaks; no two nodes ever send the same identifier, as CAN requires
======  ==========  ====================================================================================

A node's number shows what it is: controllers have 1 to 127, hosts 128 to 254. So bit 7 of the source is the
direction, and a node that hears its own frames again, as some interfaces let it, knows them by their source.
All frames of a transfer have one priority, and all transfers between two nodes too: a driver that sends the
lower identifier first cannot change their order.

>>> hex(identifier(Priority.TO_CONTROLLER, Kind.ADDRESSED, target=1, source=0x80))
'0xcda0180'
"""

from __future__ import annotations

from enum import IntEnum

CONTROLLERS = range(1, 128)
"""Node numbers of controllers."""
HOSTS = range(128, 255)
"""Node numbers of hosts."""
EVERYBODY = 0xFF
ROUTE = 0x03FFFFFF
"""The part of an identifier that is not its priority."""


class Priority(IntEnum):
    """The order of frames that wait for the bus; less is more urgent."""

    FLOW = 2
    """Flow and link control: short, and what others wait for."""
    TO_CONTROLLER = 3
    """Commands, among them those that stop."""
    TO_HOST = 4
    """Answers."""
    TELEMETRY = 5
    """To everybody; a newer one follows."""


class Kind(IntEnum):
    """The meaning of the data field."""

    ADDRESSED = 0xDA
    """ISO-TP to one node."""
    BROADCAST = 0xDB
    """ISO-TP single frame to all nodes."""
    CONTROL = 0xEF
    """A `control.Control`."""


def route(kind: Kind, *, target: int, source: int) -> int:
    """An identifier without its priority."""
    return kind << 16 | target << 8 | source


def identifier(priority: Priority, kind: Kind, *, target: int, source: int) -> int:
    """A whole identifier."""
    return priority << 26 | route(kind, target=target, source=source)


def taken_apart(arbitration_id: int) -> tuple[int, int, int]:
    """Kind, target and source of an identifier, whatever they are; the reserved bits belong to the kind."""
    return arbitration_id >> 16 & 0x3FF, arbitration_id >> 8 & 0xFF, arbitration_id & 0xFF
