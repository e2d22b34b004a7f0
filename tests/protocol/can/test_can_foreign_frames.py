"""Links over CAN beside devices of other makers, and with frames that belong to no link."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator

import can
import isotp

from robotree.protocol import Parser, encode
from robotree.protocol.errors import LinkBroken, LinkOverrun
from robotree.protocol.links.can import CanAddress, CanLink, CanListener, connect
from robotree.protocol.links.can.identifiers import EVERYBODY, HOSTS, Kind, Priority, identifier
from robotree.protocol.messages import Statustext, Timesync
from robotree.protocol.testing import RecordingHandler, RecordingHandlers, until
from tests.protocol.can.ends import connected, listening

PING = Timesync(tc1=0, ts1=1)


class Outsider:
    """A node that knows nothing of our sessions: can-isotp on its own identifiers."""

    def __init__(self, bus: can.BusABC, own: int, partner: int) -> None:
        to_partner = identifier(Priority.TO_HOST, Kind.ADDRESSED, target=partner, source=own)
        self.own, self.bus = own, bus
        self._from_partner = {
            identifier(priority, Kind.ADDRESSED, target=own, source=partner) for priority in Priority
        }
        self._layer = isotp.TransportLayerLogic(
            rxfn=self._hear,
            txfn=lambda message: self.say(to_partner, bytes(message.data)),
            address=isotp.Address(isotp.AddressingMode.Normal_29bits, txid=to_partner, rxid=1),
            params={"tx_data_length": 64, "can_fd": True, "blocking_send": False},
        )
        self.arrived: list[bytes] = []

    def say(self, arbitration_id: int, data: bytes) -> None:
        self.bus.send(can.Message(arbitration_id=arbitration_id, data=data, is_fd=True))

    def send(self, payload: bytes) -> None:
        self._layer.send(payload)
        self.work()

    def work(self) -> None:
        self._layer.process()
        while (payload := self._layer.recv()) is not None:
            self.arrived.append(bytes(payload))

    def _hear(self, _timeout: float) -> isotp.CanMessage | None:
        while (message := self.bus.recv(0)) is not None:
            if message.arbitration_id in self._from_partner:
                return isotp.CanMessage(arbitration_id=1, data=message.data, extended_id=True, is_fd=True)
        return None


@contextlib.asynccontextmanager
async def met(here: CanAddress) -> AsyncIterator[tuple[CanListener, RecordingHandler]]:
    """A controller that listens, and its side of the link with an outsider who says no more."""
    at_controller = RecordingHandlers()
    with can.Bus(interface="robotree", channel=here.channel) as bus:
        outsider = Outsider(bus, own=HOSTS[0], partner=here.node)
        async with listening(here, at_controller) as listener:
            outsider.send(encode(PING, sequence=0, system=255, component=1))
            await until(lambda: bool(listener.links))
            yield listener, at_controller[0]


async def test_a_host_of_other_people_is_linked_with_by_its_first_frame(here: CanAddress) -> None:
    at_controller = RecordingHandlers()
    with can.Bus(interface="robotree", channel=here.channel) as bus:
        outsider = Outsider(bus, own=HOSTS[5], partner=here.node)
        async with listening(here, at_controller) as listener:
            outsider.send(b"garbage opens nothing")
            await until(lambda: listener.statistics.unknown == 1)
            assert not at_controller
            frame = encode(PING, sequence=0, system=255, component=1)
            outsider.send(frame)
            await until(lambda: bool(at_controller))
            recorder = at_controller[0]
            await until(lambda: recorder.data == frame)
            long = encode(Statustext(severity=6, text="x" * 50, id=1), sequence=1, system=255, component=1)
            outsider.send(long * 4)
            recorder.link.send(long * 4)

            def settled() -> bool:
                outsider.work()
                return recorder.data == frame + long * 4 and outsider.arrived == [long * 4]

            await until(settled)


async def test_a_controller_of_other_people_is_linked_with_by_its_heartbeat(here: CanAddress) -> None:
    at_host = RecordingHandlers()
    with can.Bus(interface="robotree", channel=here.channel) as bus:
        outsider = Outsider(bus, own=here.node, partner=0x99)
        frame = encode(PING, sequence=0, system=1, component=1)
        everybody = identifier(Priority.TELEMETRY, Kind.BROADCAST, target=EVERYBODY, source=here.node)
        opening = asyncio.create_task(
            connect(CanAddress(interface="robotree", channel=here.channel, host=0x99, silence=0.5), at_host)
        )
        while not opening.done():
            outsider.say(everybody, bytes((0, len(frame))) + frame + bytes(64 - 2 - len(frame)))
            await asyncio.sleep(0.1)
        link = await opening
        link.send(b"command")

        def settled() -> bool:
            outsider.work()
            return outsider.arrived == [b"command"]

        await until(settled)
        await until(lambda: bool(at_host[0].reasons))  # and by its silence the link ends
        assert isinstance(at_host[0].reasons[0], LinkBroken)
        assert frame in at_host[0].data or not at_host[0].data


async def test_frames_that_are_not_for_us_are_counted(here: CanAddress) -> None:
    at_controller = RecordingHandlers()
    with can.Bus(interface="robotree", channel=here.channel) as bus:
        async with listening(here, at_controller) as listener, connected(here, RecordingHandler) as link:
            bus.send(can.Message(arbitration_id=0x123, is_extended_id=False))
            bus.send(can.Message(arbitration_id=0x18FEF100, data=bytes(8)))  # J1939 cruise control
            own = link.ends.own
            for data in (b"", b"\xff" * 8, b"\x21orphan", b"\x30\x00\x00"):
                wrong = identifier(Priority.TO_CONTROLLER, Kind.ADDRESSED, target=here.node, source=own)
                bus.send(can.Message(arbitration_id=wrong, data=data))
            await until(lambda: listener.statistics.foreign == 2)
            (far,) = listener.links
            assert isinstance(far, CanLink)
            transfers = far._channel
            await until(lambda: transfers.statistics.malformed == 2)
            assert transfers.statistics.receiver.unexpected == transfers.statistics.sender.unexpected == 1
            link.send(b"undisturbed")
            await until(lambda: at_controller[0].data == b"undisturbed")


async def test_a_partner_that_gives_no_leave_ends_the_link(here: CanAddress) -> None:
    """A host that can say that it lives but never takes a long frame."""
    async with met(here) as (listener, recorder):
        recorder.link.send(bytes(200), "telemetry is given up")
        await until(lambda: recorder.link.statistics.dropped == 1)
        assert not recorder.reasons
        recorder.link.send(bytes(200))
        await until(lambda: bool(recorder.reasons))
        assert isinstance(recorder.reasons[0], LinkBroken)
        assert "no flow control, 3 times" in str(recorder.reasons[0])
        assert not listener.links


async def test_a_far_end_that_takes_nothing_is_cut_before_it_costs_memory(here: CanAddress) -> None:
    async with met(here) as (_, recorder):
        for _ in range(4000):
            recorder.link.send(bytes(280))
        await until(lambda: bool(recorder.reasons))
        assert isinstance(recorder.reasons[0], LinkOverrun)
        assert recorder.link.statistics.dropped > 0


async def test_no_random_frames_disturb_a_link(here: CanAddress) -> None:
    """Everything goes through the real door: identifiers of ours, data of nobody's."""
    import random

    chance, parser, at_controller = random.Random(1), Parser(), RecordingHandlers()
    with can.Bus(interface="robotree", channel=here.channel) as bus:
        async with listening(here, at_controller) as listener, connected(here, RecordingHandler) as link:
            for _ in range(2000):
                kind = chance.choice([*Kind, 0x0DA, 0x3FF])
                target, source = chance.choice([1, 2, 255, 128]), chance.choice([1, 2, 130, 254, 255])
                arbitration_id = chance.randrange(8) << 26 | (kind & 0x3FF) << 16 | target << 8 | source
                if source == link.ends.own:
                    continue
                bus.send(
                    can.Message(arbitration_id=arbitration_id, data=chance.randbytes(chance.randrange(9)))
                )
            link.send(encode(PING, sequence=0, system=255, component=1))
            await until(lambda: bool(parser.feed(at_controller[0].data)))
            assert any(far.address.endswith(f"host={link.ends.own}") for far in listener.links)
