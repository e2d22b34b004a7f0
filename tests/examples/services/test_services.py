"""The services of the examples stand on real libraries: one understands what another says, and facts last."""

from __future__ import annotations

import asyncio
import math
import random
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import pytest

from robotree.proxy import kinds
from robotree.proxy.agent import running_proxy
from robotree.sim.companion.world import build
from robotree.sim.kinds import HEAD
from robotree.sim.physics.camera import Renderer, jpeg
from robotree.sim.serving.server import serving
from robotree.vr.base.errors import CommandFailed
from robotree.vr.bundle import Bundle
from robotree.vr.exchange.client import RobotClient
from tests.vr.place import HostPlace
from tests.waiting import until

SERVICES = Path(__file__).parents[3] / "examples/services"


class House(HostPlace):
    """A host for services, that may be started again."""

    async def add(self, file: str, name: str) -> Callable[..., Any]:
        """Add a service; returns how it is called."""
        await self.client.create(Bundle.read(SERVICES / file), name)
        return self.asker(name)

    def asker(self, name: str) -> Callable[..., Any]:
        robot = self.robot(name)
        return lambda command, **arguments: robot.call(command, arguments, deadline=120.0)

    async def watch(self, watcher: str, slot: str, watched: Any) -> None:
        robot = RobotClient(self.network.join(), self.host.agents[watcher].address)
        await robot.enslave(slot, watched)

    async def facts(self, name: str) -> dict[str, float]:
        """The readings of a service."""
        return self.host.agents[name].robot.readings()

    def listeners(self, name: str, stream: str) -> int:
        streams = self.host.agents[name].description().streams
        return next(one.listeners for one in streams if one.name == stream)


@pytest.fixture
async def house(tmp_path: Path) -> AsyncIterator[House]:
    house = House(tmp_path)
    await house.start()
    yield house
    await house.end()


async def test_what_one_service_says_another_understands(house: House) -> None:
    mouth, ears = await house.add("mouth.py", "mouth"), await house.add("ears.py", "ears")
    await house.watch("ears", "mouth", house.host.agents["mouth"].address)
    listening = asyncio.ensure_future(ears("listen"))
    await until(lambda: house.listeners("mouth", "sound") == 1, "they listen")
    said = ["please stop", "go on", "bring me the red cup", "where is the blue cup", "give it to anna"]
    understood: list[str] = []
    for number, text in enumerate(said):
        assert await mouth("say", text=text) > 0.4
        understood.append((await ears("next", after=number))["text"])
    assert sum(a != b for a, b in zip(said, understood, strict=True)) <= 1, understood
    with pytest.raises(CommandFailed, match="knows no xyzzyq"):
        await ears("expect", sentences=["please xyzzyq"])
    listening.cancel()
    await asyncio.gather(listening, return_exceptions=True)


async def test_facts_outlive_a_run_and_what_follows_from_them_is_told_with_its_reason(house: House) -> None:
    facts = await house.add("information.py", "facts")
    await facts("tell", subject="red cup", relation="in", object="table")
    await facts("tell", subject="table", relation="in", object="kitchen")
    await facts("tell", subject="anna", relation="has", object="key")
    await facts("tell", subject="anna", relation="in", object="hall")
    await house.end()
    await house.start()
    facts = house.asker("facts")
    assert await facts("find", relation="in", object="kitchen") == ["red cup", "table"]
    assert await facts("why", subject="red cup", relation="in", object="kitchen") == [
        "red cup in table",
        "table in kitchen",
    ]
    assert await facts("answer", question="Where is the red cup?") == "kitchen, table"
    assert await facts("answer", question="where is the key") == "hall"
    await facts("forget", subject="table")
    assert await facts("find", relation="in", object="kitchen") == []
    with pytest.raises(CommandFailed, match="understands: where is X"):
        await facts("answer", question="why?")


@pytest.fixture
async def companion(house: House) -> AsyncIterator[dict[str, RobotClient]]:
    """Head and base of a simulated companion that stands at the table and sees what is on it."""
    async with AsyncExitStack() as stack:
        server = await stack.enter_async_context(serving("companion", "tcp:127.0.0.1:0"))
        found: dict[str, RobotClient] = {}
        for kind, component in (("base", 1), ("head", HEAD)):
            robot = kinds.make(kind, kind, server.address, chance=random.Random(1), component=component)
            transport = house.network.join(kind)
            agent = await stack.enter_async_context(running_proxy(robot, transport))
            await until(lambda robot=robot: robot.online and bool(robot.readings()), f"{kind} is found")
            found[kind] = RobotClient(transport, agent.address)
        yield found


@pytest.mark.soak
@pytest.mark.timeout(300)
async def test_a_camera_recognises_what_is_on_the_table_and_where(
    house: House, companion: dict[str, RobotClient]
) -> None:
    eyes = await house.add("recogniser.py", "eyes")
    head, base = companion["head"], companion["base"]
    described = {one.name: one for one in (await head.describe()).streams}
    assert described["pictures"].listeners == 0
    for slot, robot in (("head", head), ("base", base)):
        await house.watch("eyes", slot, robot.address)
    await base.call("drive", {"x": 0.95, "y": 0.9, "heading": 0.0, "speed": 0.8}, deadline=120.0)
    await head.call("look", {"pan": 0.0, "tilt": 0.65})
    looking = asyncio.ensure_future(eyes("watch"))

    async def sees() -> bool:
        return (await house.facts("eyes")).get("known", 0.0) >= 3.0

    await until(sees, "it sees three cups")
    sent = next(one for one in (await head.describe()).streams if one.name == "pictures")
    assert sent.listeners == 1
    for what, tag in (("red cup", 1), ("green cup", 2), ("blue cup", 3)):
        seen, true = await eyes("where", what=what), await head.call("see", {"tag": tag})
        assert math.dist([seen[axis] for axis in "xyz"], [true[axis] for axis in "xyz"]) < 0.05
    with pytest.raises(CommandFailed, match="anna was not seen yet"):
        await eyes("where", what="anna")
    looking.cancel()
    await asyncio.gather(looking, return_exceptions=True)

    async def nobody_listens() -> bool:
        streams = (await head.describe()).streams
        return all(one.listeners == 0 for one in streams)

    await until(nobody_listens, "it listens no more")


def test_who_stands_at_the_door_is_recognised_in_a_picture_and_is_where_the_service_says() -> None:
    """The picture is drawn as the simulated camera draws it, and compressed as it crosses the wire."""
    world = build(plays=(), start=(-1.55, -1.10, -2.55))
    world.flat.visitors[0].put(-2.45, -1.5, 0.42)
    world.cell.advance(20)
    picture = Renderer(world.cell.model).picture(world.cell.published, "companion/eye_left", 640, 480)
    eyes: Any = Bundle.read(SERVICES / "recogniser.py").load()("eyes")
    stand = (-1.55, -1.10, -2.55, 0.0, 0.0)
    found = {one.what: one for one in eyes.recognised(jpeg(picture, 92), stand, 0.0)}
    assert set(found) == {"anna"}, "the others wait too far away"
    assert math.dist((found["anna"].x, found["anna"].y), (-2.45, -1.5)) < 0.05
    assert abs(found["anna"].z - 0.68 * 1.68) < 0.05
    assert eyes.recognised(b"no picture", stand, 0.0) == []
