"""A link's table tells who is there, and who was."""

from __future__ import annotations

from robotree.protocol import encode
from robotree.protocol.messages import AnyMessage, Heartbeat, MavState, MavType, Timesync
from robotree.protocol.services.heartbeat import SILENCE
from robotree.protocol.tools.capture.gauges import MAX_PEERS, LinkGauge, PeerReading

ROVER = Heartbeat(MavType.GROUND_ROVER, 0, 0, 0, MavState.ACTIVE)


def say(message: AnyMessage, system: int = 1, component: int = 1) -> bytes:
    return encode(message, sequence=0, system=system, component=component)


def test_who_falls_silent_is_gone_and_who_speaks_again_is_there() -> None:
    gauge = LinkGauge("tcp:far")
    gauge.receive(say(ROVER) + say(ROVER, 2), 1.0)
    gauge.receive(say(Timesync(0, 1)), 3.0)
    rover = PeerReading(1, 1, MavType.GROUND_ROVER, MavState.ACTIVE, 1.5, there=True)
    gone = PeerReading(2, 1, MavType.GROUND_ROVER, MavState.ACTIVE, 3.5, there=False)
    assert gauge.reading(4.5).peers == [rover, gone]
    gauge.receive(say(Timesync(0, 1), 2), 5.0)
    assert [peer.there for peer in gauge.reading(5.0).peers] == [True, False], "it has yet to say who it is"
    gauge.receive(say(ROVER, 2), 5.5)
    assert [peer.there for peer in gauge.reading(5.5).peers] == [True, True]


def test_the_latest_heartbeat_counts() -> None:
    gauge = LinkGauge("tcp:far")
    for state in (MavState.BOOT, MavState.CRITICAL):
        gauge.receive(say(Heartbeat(0, 0, 0, 0, state)), 1.0)
    (peer,) = gauge.reading(1.0).peers
    assert peer.state == MavState.CRITICAL


def test_forged_peers_that_come_and_go_do_not_fill_the_memory() -> None:
    gauge = LinkGauge("tcp:far")
    for wave in range(3):
        now = wave * 2 * SILENCE
        crowd = (divmod(wave * MAX_PEERS + i, 255) for i in range(MAX_PEERS))
        gauge.receive(b"".join(say(ROVER, 1 + system, component) for component, system in crowd), now)
        peers = gauge.reading(now + SILENCE).peers
        assert len(peers) == MAX_PEERS
        assert not any(peer.there for peer in peers)
