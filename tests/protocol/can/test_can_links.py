"""Links over CAN: what passes in which order, several hosts and controllers, and devices of other makers."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack

import can
import isotp
import pytest

from robotree.protocol import Endpoint, Frame, Parser, encode
from robotree.protocol.canbus import channel_id, first_port
from robotree.protocol.canbus.membership import HOST
from robotree.protocol.canbus.records import Greeting
from robotree.protocol.errors import BadUrl, LinkBroken, LinkClosed, LinkOverrun, LinkRefused
from robotree.protocol.links.can import CanAddress, CanLink, CanListener, Telemetry, connect, listen
from robotree.protocol.links.can import listener as can_listener
from robotree.protocol.links.can.identifiers import EVERYBODY, HOSTS, Kind, Priority, identifier
from robotree.protocol.links.link import Link
from robotree.protocol.links.url import connect as connect_url
from robotree.protocol.links.url import listen as listen_url
from robotree.protocol.messages import (
    CommandAck,
    Gripper,
    Heartbeat,
    Message,
    NamedValueFloat,
    Statustext,
    Timesync,
)
from robotree.protocol.testing import RecordingHandler, RecordingHandlers, until
from tests.protocol.can.ends import connected, listening

SOON = 60.0
LONG = 60.0
"""[s] that no test takes, however slow the machine is."""
BEAT = Heartbeat(0, 0, 0, 0, 0)


async def test_several_hosts_and_controllers_share_a_bus(here: CanAddress) -> None:
    def echo(link: Link) -> Endpoint:
        def answer(frame: Frame) -> None:
            endpoint.send(frame.message)

        endpoint = Endpoint(link, system=1, component=1, on_frame=answer)
        return endpoint

    nodes = (1, 2, 127)
    async with AsyncExitStack() as stack:
        for node in nodes:
            where = CanAddress(interface="robotree", channel=here.channel, node=node)
            await stack.enter_async_context(listening(where, echo))
        heard: list[list[Frame]] = []
        endpoints: list[Endpoint] = []
        for node in nodes * 2:
            where = CanAddress(interface="robotree", channel=here.channel, node=node)
            heard.append([])

            def hear(link: Link, frames: list[Frame] = heard[-1]) -> Endpoint:
                endpoints.append(Endpoint(link, system=255, component=1, on_frame=frames.append))
                return endpoints[-1]

            await stack.enter_async_context(connected(where, hear))
        for index, endpoint in enumerate(endpoints):
            for part in range(20):
                endpoint.send(Statustext(severity=6, text=f"host {index} says {part}" + "!" * 20, id=part))
        await until(lambda: all(len(frames) == 20 for frames in heard))
        for index, frames in enumerate(heard):
            texts = [frame.message.text for frame in frames if isinstance(frame.message, Statustext)]
            assert texts == [f"host {index} says {part}" + "!" * 20 for part in range(20)]


async def test_a_controller_answers_each_host_in_the_format_that_it_speaks(channel: str) -> None:
    both, classic = (CanAddress(interface="robotree", channel=channel, fd=fd) for fd in (True, False))
    at_controller, at_modern, at_classic = RecordingHandlers(), RecordingHandlers(), RecordingHandlers()
    async with listening(both, at_controller), connected(both, at_modern), connected(classic, at_classic):
        for recorder in at_controller:
            recorder.link.send(bytes(200))
        heard = [each[0] for each in (at_modern, at_classic)]
        await until(lambda: all(len(each.data) >= 200 for each in heard))
        assert [each.data for each in heard] == [bytes(200)] * 2


async def test_telemetry_goes_to_all_while_there_is_one_host(here: CanAddress) -> None:
    at_controller, at_host, at_second = RecordingHandlers(), RecordingHandlers(), RecordingHandlers()
    with can.Bus(interface="robotree", channel=here.channel) as monitor:
        kinds: list[int] = []

        def watch() -> None:
            while (message := monitor.recv(0)) is not None:
                kinds.append(message.arbitration_id >> 16 & 0x3FF)

        async with listening(here, at_controller), connected(here, at_host):
            far = at_controller[0].link
            far.send(b"joints", "joints")
            far.send(bytes(100), "too long for one frame")
            far.send(b"answer")
            await until(lambda: len(at_host[0].data) == 112)
            watch()
            assert kinds.count(Kind.BROADCAST) == 1
            async with connected(here, at_second):
                far.send(b"only for the first", "joints")
                at_controller[1].link.send(b"only for the second", "joints")
                await until(lambda: bool(at_second[0].data))
                assert at_host[0].data.endswith(b"only for the first")
                assert at_second[0].data == b"only for the second"
            watch()
            assert kinds.count(Kind.BROADCAST) == 1


async def test_telemetry_that_is_the_same_for_all_can_go_out_once(channel: str) -> None:
    where = CanAddress(interface="robotree", channel=channel, telemetry=Telemetry.BROADCAST)
    at_controller, first, second = RecordingHandlers(), RecordingHandlers(), RecordingHandlers()
    async with listening(where, at_controller) as listener, connected(where, first), connected(where, second):
        before = listener._port.bus.statistics.sent
        for text in (b"one", b"two"):
            for recorder in at_controller:
                recorder.link.send(text, "joints")
        assert listener._port.bus.statistics.sent == before + 2
        await until(lambda: first[0].data == second[0].data == b"onetwo")


async def test_a_reading_goes_out_once_although_each_link_numbers_its_frames(channel: str) -> None:
    where = CanAddress(interface="robotree", channel=channel, telemetry=Telemetry.BROADCAST)
    first, second, speakers = RecordingHandlers(), RecordingHandlers(), list[Endpoint]()

    def speak(link: Link) -> Endpoint:
        speakers.append(Endpoint(link, system=1, component=1, on_frame=lambda _: None))
        return speakers[-1]

    async with listening(where, speak) as listener, connected(where, first), connected(where, second):
        speakers[0].send(CommandAck(1, 0, 0, 0, 255, 190))
        before = listener._port.bus.statistics.sent
        for moment in range(10):
            for speaker in speakers:
                speaker.send(Gripper(moment, 0.1, 0.1, 0.0, 1), telemetry=True)
                speaker.send(BEAT, telemetry=True)
        assert listener._port.bus.statistics.sent == before + 2 * 10
        speakers[1].send(NamedValueFloat(1, "asked for", 1.0), telemetry=True)
        for speaker in speakers:
            speaker.send(Statustext(6, "x" * 50, 0, 0), telemetry=True)

        def heard(recorder: RecordingHandler, kind: type[Message]) -> int:
            return sum(isinstance(frame.message, kind) for frame in Parser().feed(recorder.data))

        for each in (first[0], second[0]):
            await until(lambda each=each: heard(each, Statustext) == 1, SOON)
            assert [heard(each, kind) for kind in (Gripper, Heartbeat, NamedValueFloat)] == [10, 10, 1]


@pytest.mark.usefixtures("impatient")
async def test_nobody_answers_on_an_empty_bus(here: CanAddress) -> None:
    with pytest.raises(LinkRefused, match="no controller with node=1 answers"):
        await connect(here, RecordingHandler)


async def test_a_node_number_belongs_to_one_controller(
    here: CanAddress, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with listening(here, RecordingHandler):
        monkeypatch.setattr(can_listener, "CLAIM_TIME", LONG)  # the other one answers, on a slow machine late
        with pytest.raises(LinkRefused, match="another controller on this bus has node=1"):
            await listen(here, RecordingHandler)


async def test_a_host_number_belongs_to_one_host(channel: str) -> None:
    where = CanAddress(interface="robotree", channel=channel, host=200)
    at_controller = RecordingHandlers()
    async with listening(where, at_controller), connected(where, RecordingHandler) as first:
        with pytest.raises(LinkRefused, match="another host has number 200"):
            await connect(where, RecordingHandler)
        first.send(b"still here")
        await until(lambda: at_controller[0].data == b"still here")


async def test_a_host_that_left_in_order_may_come_back_at_once(channel: str) -> None:
    where = CanAddress(interface="robotree", channel=channel, host=200)
    at_controller = RecordingHandlers()
    async with listening(where, at_controller):
        for _ in range(3):
            async with connected(where, RecordingHandler):
                pass
        await until(lambda: all(recorder.reasons for recorder in at_controller))
        assert [type(each) for recorder in at_controller for each in recorder.reasons] == [LinkClosed] * 3


async def test_a_burst_of_long_frames_arrives_whole_and_in_order(address: CanAddress) -> None:
    at_controller, at_host = RecordingHandlers(), RecordingHandlers()
    async with listening(address, at_controller), connected(address, at_host) as link:
        (far,) = [recorder.link for recorder in at_controller]
        frames = [
            bytes((index % 256, size % 256)) * (size // 2) for index, size in enumerate(range(2, 280, 2))
        ]
        for frame in frames:
            link.send(frame)
            far.send(frame)
        assert link.congested
        whole = b"".join(frames)
        await until(lambda: len(at_controller[0].data) >= len(whole))
        await until(lambda: len(at_host[0].data) >= len(whole))
        assert at_controller[0].data == at_host[0].data == whole
        assert not link.congested


async def test_telemetry_that_waits_is_superseded_and_the_rest_is_not(here: CanAddress) -> None:
    at_controller = RecordingHandlers()
    async with listening(here, at_controller), connected(here, RecordingHandlers()) as link:
        link.send(bytes(200))  # under way until the far end gives leave
        for index in range(1, 6):
            link.send(bytes((index,)) * 100, "joints")
        link.send(b"command")
        await until(lambda: at_controller[0].data.endswith(b"command"))
        assert at_controller[0].data == bytes(200) + b"\x05" * 100 + b"command"
        assert link.statistics.superseded == 4


async def test_on_a_crowded_bus_order_is_kept_and_telemetry_superseded(here: CanAddress) -> None:
    at_controller, at_host = RecordingHandlers(), RecordingHandlers()
    async with listening(here, at_controller) as listener, connected(here, at_host):
        link = at_controller[0].link
        with socket.create_connection((HOST, first_port(here.channel))) as sleeper:
            sleeper.sendall(Greeting(answer=False, channel=channel_id(here.channel), token=1).encode())
            await until(lambda: listener._port.bus.statistics.members == 2)  # type: ignore[attr-defined]
            sent = 0
            while not link.congested:
                link.send(sent.to_bytes(4) + bytes(50))
                sent += 1
                if sent % 50 == 0:
                    await asyncio.sleep(0)
            for index in range(5):
                link.send(b"telemetry %d" % index, "telemetry")
            link.send(b"command")
            expected = (
                b"".join(index.to_bytes(4) + bytes(50) for index in range(sent)) + b"telemetry 4command"
            )
            await until(lambda: len(at_host[0].data) >= len(expected))
            assert at_host[0].data == expected
            assert link.statistics.superseded == 4


async def test_an_unknown_interface_is_refused(channel: str) -> None:
    with pytest.raises(LinkRefused, match="teleport"):
        await connect_url(f"can:teleport/{channel}", RecordingHandler)


async def test_a_bus_that_other_machines_reach_must_be_asked_for() -> None:
    with pytest.raises(BadUrl, match="use an interface of this machine"):
        await listen_url("can:udp_multicast/239.0.0.1", RecordingHandler)


async def test_the_address_of_a_listener_is_what_hosts_need(here: CanAddress) -> None:
    at_host = RecordingHandlers()
    async with listening(here, RecordingHandler) as listener:
        link = await connect_url(listener.address, at_host)
        assert link.address == listener.address
        await listener.close()
        await until(lambda: bool(at_host[0].reasons))
        assert isinstance(at_host[0].reasons[0], LinkClosed)


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
