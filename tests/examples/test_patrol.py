"""The patrol finds out by itself where its next robot lives, also when that has moved, and goes there."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

from robotree.vr.bundle import Bundle
from robotree.vr.exchange.client import HostClient
from tests.vr.moving.stage import Stage, played

EXAMPLES = Path(__file__).parents[2] / "examples"
DRIVER = """
class Rover(VirtualRobot):
    legs: int = state(0)

    @command
    def move(self, x: float, y: float) -> None:
        self.sleep(0.01)
        self.legs = self.legs + 1
"""


def test_a_patrol_travels_to_where_its_next_robot_is(tmp_path: Path) -> None:
    async def story(stage: Stage) -> None:
        await stage.add("h1", "h2", "h3")
        await stage.create("h1", "rover-1", DRIVER)
        await stage.create("h2", "rover-2", DRIVER)
        client = HostClient(stage.operator, stage.homes["h3"].host.address)
        await client.create(await asyncio.to_thread(Bundle.read, EXAMPLES / "patrol.py"), "patrol")
        await stage.until(lambda: bool(stage.keys("robot", "patrol")))
        for slot, rover in (("near", "rover-1"), ("far", "rover-2")):
            await stage.enslave("patrol", slot, rover)
        seen: list[str] = []
        for home in stage.homes.values():
            took = home.host.settle_in

            async def settle_in(*given: Any, home: Any = home, took: Any = took) -> Any:
                if given[0].name == "patrol":
                    seen.append(home.name)
                return await took(*given)

            home.host.settle_in = settle_in  # type: ignore[method-assign] # as it is, and noted
        patrol = stage.robot("patrol")
        assert await patrol.call("patrol", {"rounds": 1}) == 4
        assert seen == ["h1", "h2"]
        await stage.migrate("rover-1", "h3")
        assert await patrol.call("patrol", {"rounds": 1}) == 8
        assert seen == ["h1", "h2", "h3", "h2"], "it asks anew where its robots are"
        assert stage.where("patrol") == ["h2"]
        assert (stage.field("rover-1", "legs"), stage.field("rover-2", "legs")) == (4, 4)

    played(tmp_path, story)
