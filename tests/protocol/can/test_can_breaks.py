"""Links over CAN whose bus breaks, and ends that are withheld the processor."""

from __future__ import annotations

import asyncio
import weakref
from collections.abc import Callable

import can
import pytest
from can.interfaces.virtual import VirtualBus

from robotree.protocol.canbus import LoopbackBus
from robotree.protocol.errors import LinkBroken, LinkRefused
from robotree.protocol.links.can import CanAddress, CanLink, connect
from robotree.protocol.links.can import listener as can_listener
from robotree.protocol.testing import RecordingHandler, RecordingHandlers, until
from tests.protocol.can.ends import connected, listening

SOON = 60.0


@pytest.fixture(autouse=True)
def soon_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """A broken bus is entered again at once."""
    monkeypatch.setattr(can_listener, "AGAIN", 0.05)


async def again(address: CanAddress) -> CanLink:
    """The link that there is as soon as the controller has come back."""
    while True:
        try:
            return await connect(address, RecordingHandler)
        except LinkRefused:
            continue


async def test_a_broken_bus_ends_the_links_and_is_entered_again(here: CanAddress) -> None:
    at_controller = RecordingHandlers()
    async with listening(here, at_controller) as listener:
        async with connected(here, RecordingHandler):
            listener._port.bus.shutdown()
            await until(lambda: bool(at_controller[0].reasons))
            assert isinstance(at_controller[0].reasons[0], LinkBroken)
            assert listener.statistics.breaks == 1

        (await again(here)).close()
        await until(lambda: len(at_controller) == 2 and bool(at_controller[1].reasons))


async def test_who_is_closed_while_the_bus_is_entered_again_leaves_nobody_on_it(
    here: CanAddress, monkeypatch: pytest.MonkeyPatch
) -> None:
    entered, loop = list[LoopbackBus](), asyncio.get_running_loop()
    begun = loop.create_future()

    def enter(**options: str) -> LoopbackBus:
        loop.call_soon_threadsafe(begun.set_result, None)
        entered.append(LoopbackBus(options["channel"]))
        return entered[-1]

    async with listening(here, RecordingHandler) as listener:
        monkeypatch.setattr(can, "Bus", enter)
        listener._port._break("the cable was cut")
        await begun
        await listener.close()
    assert [bus._is_shutdown for bus in entered] == [True]


@pytest.fixture
async def leap(monkeypatch: pytest.MonkeyPatch) -> Callable[[float], None]:
    """Has time pass in which the system gives the processor to others, [s]."""
    loop = asyncio.get_running_loop()
    clock, passed = loop.time, [0.0]
    monkeypatch.setattr(loop, "time", lambda: clock() + sum(passed))
    return passed.append


async def test_who_was_withheld_the_processor_takes_nobody_for_gone(
    here: CanAddress, leap: Callable[[float], None]
) -> None:
    at_controller, at_host = RecordingHandlers(), RecordingHandlers()
    async with listening(here, at_controller), connected(here, at_host) as link:
        leap(60.0)
        link.send(b"still here")
        await until(lambda: at_controller[0].data == b"still here")
        assert not at_controller[0].reasons
        assert not at_host[0].reasons


async def test_who_was_withheld_the_processor_gives_no_number_away(
    channel: str, leap: Callable[[float], None]
) -> None:
    where = CanAddress(interface="robotree", channel=channel, host=200)
    at_controller = RecordingHandlers()
    async with listening(where, at_controller) as listener, connected(where, RecordingHandler):
        links = listener.links
        leap(60.0)
        listener._open(200, session=1, fd=True)  # as if it were the first thing that we find
        assert listener.links == links


@pytest.fixture
def pulled(address: CanAddress, monkeypatch: pytest.MonkeyPatch) -> CanAddress:
    """Of a bus that cannot be shut down in order, as an adapter that was pulled."""
    kind: type[can.BusABC] = LoopbackBus if address.interface == "robotree" else VirtualBus
    shutdown = kind.shutdown

    def fail(bus: can.BusABC) -> None:
        shutdown(bus)
        raise can.CanOperationError("the adapter was pulled")

    monkeypatch.setattr(kind, "shutdown", fail)
    return address


async def test_a_bus_that_cannot_be_shut_down_is_entered_again_and_left(pulled: CanAddress) -> None:
    async with listening(pulled, RecordingHandler) as listener:
        async with connected(pulled, RecordingHandler):
            with pytest.raises(can.CanOperationError):
                listener._port.bus.shutdown()
            await until(lambda: listener.statistics.breaks == 1)
        async with asyncio.timeout(3 * SOON):
            (await again(pulled)).close()


async def test_nothing_is_kept_of_a_pulled_adapter_while_it_is_away(
    pulled: CanAddress, monkeypatch: pytest.MonkeyPatch
) -> None:
    def away(**_: object) -> None:
        raise can.CanInitializationError("there is no such adapter")

    async with listening(pulled, RecordingHandler) as listener, connected(pulled, RecordingHandler):
        monkeypatch.setattr(can, "Bus", away)
        bus = weakref.ref(listener._port.bus)
        with pytest.raises(can.CanOperationError):
            listener._port.bus.shutdown()
        await until(lambda: listener.statistics.breaks == 1)
        await until(lambda: bus() is None)


@pytest.mark.usefixtures("impatient")
async def test_who_finds_nobody_is_refused_although_the_bus_cannot_be_shut_down(pulled: CanAddress) -> None:
    with pytest.raises(LinkRefused, match="no controller with node=1 answers"):
        await connect(pulled, RecordingHandler)
