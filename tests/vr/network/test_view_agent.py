"""Views: one question, one picture, and nothing made for nobody."""

from __future__ import annotations

import asyncio
import io
from collections.abc import AsyncIterator, Mapping, Sequence

import pytest
from PIL import Image

from robotree.vr.agents.view import ViewAgent, jpeg_size
from robotree.vr.base.description import Template
from robotree.vr.base.errors import BadArgument, DuplicateName, VrError
from robotree.vr.base.requests import DescribeHost, HostDescribed
from robotree.vr.base.transport import Transport
from robotree.vr.exchange.asking import ask
from robotree.vr.exchange.client import ViewClient
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.lookup.service import LookupService
from robotree.vr.world.network import MemoryNetwork
from robotree.vr.world.testing import in_virtual_time


def picture(width: int, height: int, **options: object) -> bytes:
    file = io.BytesIO()
    Image.new("RGB", (width, height), "teal").save(file, "JPEG", **options)
    return file.getvalue()


class Window:
    """A view that counts how often it is looked through. No picture is wider than 640."""

    def __init__(self) -> None:
        self.looks = 0

    @property
    def cameras(self) -> Sequence[str]:
        return ("cell", "wrist")

    @property
    def reading_units(self) -> Mapping[str, str]:
        return {"lever": "rad"}

    def readings(self) -> dict[str, float]:
        return {"lever": 0.25}

    async def look(self, camera: str, width: int, height: int, quality: int) -> bytes:
        self.looks += 1
        if camera not in {"", *self.cameras}:
            raise BadArgument(command="window.look", parameter="camera", reason=f"there is no {camera!r}")
        if quality > 100:
            raise RuntimeError("a fault of the view")
        return picture(min(width, 640), height, quality=quality)


@pytest.fixture
async def network() -> AsyncIterator[MemoryNetwork]:
    network = MemoryNetwork()
    yield network
    for transport in list(network.members):
        await transport.close()


async def show(transport: Transport, view: Window) -> ViewAgent:
    agent = ViewAgent(view, transport, "cell", registrar=Registrar(transport))
    await agent.start()
    return agent


async def test_a_view_describes_itself_without_a_picture_and_one_comes_as_large_as_it_is(
    network: MemoryNetwork,
) -> None:
    view = Window()
    agent = await show(network.join(), view)
    client = ViewClient(network.join(), agent.address)
    described = await client.describe()
    assert described.cameras == ("cell", "wrist")
    assert (described.units, described.readings) == ({"lever": "rad"}, {"lever": 0.25})
    assert view.looks == 0
    seen = await client.look()
    assert (seen.width, seen.height, seen.camera) == (320, 180, "cell")
    assert Image.open(io.BytesIO(seen.jpeg)).size == (320, 180)
    seen = await client.look("wrist", width=2000, height=40, quality=20)
    assert (seen.width, seen.height, seen.camera) == (640, 40, "wrist")
    assert view.looks == 2, "one question, one picture"
    await agent.close()


async def test_what_a_view_refuses_travels_and_what_breaks_it_does_not_end_it(network: MemoryNetwork) -> None:
    agent = await show(network.join(), Window())
    client = ViewClient(network.join(), agent.address)
    with pytest.raises(BadArgument, match="there is no 'roof'"):
        await client.look("roof")
    with pytest.raises(VrError, match=r"cell: internal error: .*a fault of the view"):
        await client.look(quality=101)
    with pytest.raises(VrError, match="a view does not answer DescribeHost"):
        await ask(network.join(), agent.address.key, DescribeHost(), HostDescribed, timeout=5)
    assert (await client.look()).width == 320
    await agent.close()


@in_virtual_time
async def test_a_view_is_listed_until_it_ends_and_its_name_is_its_own() -> None:
    network = MemoryNetwork()
    service = LookupService(network.join(), "lookup-1")
    await service.start()
    agent = await show(network.join(), Window())
    ((listing, _),) = service.table.find(Template(), asyncio.get_running_loop().time())
    assert (listing.name, listing.kinds) == ("cell", ("View",))
    assert listing.attributes == {"cameras": "cell, wrist"}
    with pytest.raises(DuplicateName, match="a view named 'cell'"):
        await show(network.join(), Window())
    await agent.close()
    await agent.close()
    assert service.table.find(Template(), asyncio.get_running_loop().time()) == ()
    await (await show(network.join(), Window())).close()


@pytest.mark.parametrize("options", [{}, {"progressive": True}, {"quality": 5, "comment": b"x" * 300}])
def test_the_size_of_a_picture_is_read_from_its_header(options: dict[str, object]) -> None:
    assert jpeg_size(picture(123, 45, **options)) == (123, 45)


@pytest.mark.parametrize(
    "nonsense", [b"", b"\xff", b"\xff\xd8", b"\x89PNG" * 9, picture(8, 8)[:100], b"\xff\xd8\xff\xc0"]
)
def test_what_is_no_picture_has_no_size(nonsense: bytes) -> None:
    assert jpeg_size(nonsense) == (0, 0)
