"""What must not be kept or passed on: frames that carry a secret, such as a signing key in the clear. Pure.

MAVLink asks for it: SETUP_SIGNING is for the one who is addressed, over a link that nobody else reads. A
recording is shown to others, and a relay may lead to another machine.
"""

from __future__ import annotations

from robotree.protocol.capture.framing import msgid
from robotree.protocol.dialect.table import SECRETS, by_name

_IDS = frozenset(by_name()[name].id for name in SECRETS)
_ON_THE_WIRE = tuple(number.to_bytes(3, "little") for number in _IDS)
"""How a frame of MAVLink 2 writes them; none fits into a frame of MAVLink 1."""


def carries_secret(frame: bytes) -> bool:
    """Whether a whole frame is of a message that has a secret field."""
    return msgid(frame) in _IDS


def may_carry_secret(data: bytes) -> bool:
    """Whether whole frames, looked at quickly, may have a secret among them; False: they have none."""
    return any(number in data for number in _ON_THE_WIRE)
