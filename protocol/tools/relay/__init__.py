"""A relay that does to a running link what the world does: loss, delay, repetition, silence.

It stands between two programs that know nothing of it: one connects to the relay, the relay connects to the
other. What happens to a frame is decided by the loopback link (`robotree.protocol.links.loopback`). It is for
demonstrations: whoever looks on sees a robot and its supervisor bear it.
"""

from robotree.protocol.tools.relay.joint import Joint, Traffic
from robotree.protocol.tools.relay.server import Relay, relaying

__all__ = ["Joint", "Relay", "Traffic", "relaying"]
