"""A relay that disturbs a running link as the world does: loss, delay, repetition, silence.

It stands between two programs that know nothing of it: one connects to the relay, and the relay connects to
the other. The loopback link (`robotree.protocol.links.loopback`) decides what happens to a frame. It is for
demonstrations: one sees how a robot and its supervisor cope with a bad link.
"""

from robotree.protocol.tools.relay.server import FaultyCable, Relay, Traffic, relaying

__all__ = ["FaultyCable", "Relay", "Traffic", "relaying"]
