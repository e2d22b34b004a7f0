"""UDP: every address that speaks is a link, until it has been silent for long."""

from __future__ import annotations

import asyncio
import socket
from typing import TYPE_CHECKING

import pytest

from robotree.protocol import Endpoint, Frame
from robotree.protocol.errors import BadUrl, LinkBroken, LinkError, LinkOverrun
from robotree.protocol.links import udp
from robotree.protocol.links.outbox import BOUND
from robotree.protocol.links.url import connect, listen
from robotree.protocol.messages import Heartbeat, Timesync
from robotree.protocol.testing import RecordingHandler, RecordingHandlers, until

if TYPE_CHECKING:
    from robotree.protocol.links.link import Link


async def test_a_controller_answers_several_clients_each_on_its_own_link() -> None:
    endpoints: list[Endpoint] = []

    def accept(link: Link) -> Endpoint:
        def answer(frame: Frame) -> None:
            endpoint.send(Timesync(tc1=1, ts1=frame.system))

        endpoint = Endpoint(link, system=1, component=1, on_frame=answer)
        endpoints.append(endpoint)
        return endpoint

    listener = await listen("udp:0", accept)
    heard: dict[int, list[Frame]] = {system: [] for system in (10, 11, 12)}
    links: list[Link] = []
    for system, frames in heard.items():

        def client(link: Link, system: int = system, frames: list[Frame] = frames) -> Endpoint:
            endpoint = Endpoint(link, system=system, component=1, on_frame=frames.append)
            endpoint.send(Heartbeat(6, 8, 0, 0, 4))
            return endpoint

        links.append(await connect(listener.address, client))
    await until(lambda: all(heard.values()))
    for system, frames in heard.items():
        assert [frame.message for frame in frames] == [Timesync(1, system)]
    assert len({link.address for link in listener.links}) == 3
    for link in links:
        link.close()
    await listener.close()
    assert listener.links == frozenset()


async def test_a_client_may_come_before_its_controller() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as place:
        place.bind(("127.0.0.1", 0))
        address = f"udp:127.0.0.1:{place.getsockname()[1]}"
    link = await connect(address, RecordingHandler)
    link.send(b"anybody there?")
    await asyncio.sleep(0.01)
    heard = RecordingHandlers()
    listener = await listen(address, heard)
    link.send(b"now?")
    await until(lambda: heard and heard[0].data == b"now?")
    assert len(heard) == 1
    link.close()
    await listener.close()


async def test_a_silent_address_is_taken_for_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(udp, "SILENCE", 0.02)
    monkeypatch.setattr(udp, "SWEEP", 0.005)
    reasons: list[LinkError] = []

    def accept(link: Link) -> Endpoint:
        return Endpoint(link, system=1, component=1, on_frame=lambda _: None, on_closed=reasons.append)

    listener = await listen("udp:0", accept)
    link = await connect(listener.address, RecordingHandler)
    link.send(b"once")
    await until(lambda: reasons)
    assert isinstance(reasons[0], LinkBroken)
    assert "silent for" in str(reasons[0])
    assert listener.links == frozenset()
    link.close()
    await listener.close()


async def test_a_crowd_is_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(udp, "MAX_LINKS", 3)
    heard = RecordingHandlers()
    listener = await listen("udp:0", heard)
    links = [await connect(listener.address, RecordingHandler) for _ in range(6)]
    for link in (*links, links[0]):
        link.send(b"x")
    await until(lambda: heard and heard[0].data == b"xx")  # said last, and so heard after all others
    assert len(heard) == len(listener.links) == 3
    for link in links:
        link.close()
    await listener.close()


async def test_an_address_that_is_silent_gives_its_place_to_one_that_speaks(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(udp, "MAX_LINKS", 3)
    monkeypatch.setattr(udp, "LINGER", 0.05)
    heard = RecordingHandlers()
    listener = await listen("udp:0", heard)
    first, *others = [await connect(listener.address, RecordingHandler) for _ in range(4)]
    for link in (first, *others[:2]):
        link.send(b"x")
    await until(lambda: len(heard) == 3)
    for _ in range(20):
        first.send(b"y")
        await asyncio.sleep(0.005)
    others[2].send(b"new")
    await until(lambda: len(heard) == 4)
    assert heard[3].data == b"new"
    assert [len(each.reasons) for each in heard] == [0, 1, 0, 0], "who has been silent for longest makes room"
    assert "needed its place" in str(heard[1].reasons[0])
    for link in (first, *others):
        link.close()
    await listener.close()


async def test_a_handler_that_cannot_be_made_for_a_newcomer_leaves_no_link() -> None:
    failures: list[object] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, context: failures.append(context["exception"]))

    def accept(_: Link) -> RecordingHandler:
        raise RuntimeError("out of order")

    listener = await listen("udp:0", accept)
    link = await connect(listener.address, RecordingHandler)
    link.send(b"x")
    await until(lambda: failures)
    assert listener.links == frozenset()
    link.close()
    await listener.close()


async def test_what_the_system_does_not_take_waits_newest_first_and_is_cut_at_the_bound() -> None:
    listener = await listen("udp:0", RecordingHandler)
    reasons: list[LinkError] = []
    link = await connect(
        listener.address,
        lambda link: Endpoint(link, system=1, component=1, on_frame=lambda _: None, on_closed=reasons.append),
    )
    assert isinstance(link, udp.UdpLink)
    link._carrier.pause_writing()
    link.send(b"old", "telemetry")
    link.send(b"new", "telemetry")
    assert link.congested
    assert (link.statistics.waiting, link.statistics.superseded) == (3, 1)
    link._carrier.resume_writing()
    assert (link.statistics.waiting, link.statistics.sent) == (0, 3)
    link._carrier.pause_writing()
    for _ in range(BOUND // 1000 + 1):
        link.send(bytes(1000))
    assert isinstance(reasons[0], LinkOverrun)
    await listener.close()


async def test_an_address_of_the_world_is_refused() -> None:
    with pytest.raises(BadUrl, match="can be reached from outside"):
        await listen("udp:0.0.0.0:0", RecordingHandler)


async def test_a_handler_that_cannot_be_made_opens_nothing() -> None:
    def accept(_: Link) -> RecordingHandler:
        raise RuntimeError("out of order")

    with pytest.raises(RuntimeError, match="out of order"):
        await connect("udp:127.0.0.1:9", accept)
