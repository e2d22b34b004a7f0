"""Several hosts and controllers on one CAN bus: numbers, formats, telemetry to all."""

from __future__ import annotations

from contextlib import AsyncExitStack

import can
import pytest

from robotree.protocol import Endpoint, Frame, Parser
from robotree.protocol.errors import LinkClosed, LinkRefused
from robotree.protocol.links.can import CanAddress, Telemetry, connect, listen
from robotree.protocol.links.can import listener as can_listener
from robotree.protocol.links.can.identifiers import Kind
from robotree.protocol.links.link import Link
from robotree.protocol.messages import CommandAck, Gripper, Heartbeat, Message, NamedValueFloat, Statustext
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
