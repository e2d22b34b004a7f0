"""The arrangement of the screen: parts of the list, sizes, saved filters; kept for the person, and still."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import TYPE_CHECKING

from textual.geometry import Region

from robotree.tui.processes.layout import LayoutFile
from robotree.tui.screen.widgets.robot_table import RobotTable

if TYPE_CHECKING:
    from screens.conftest import Operate, Operator
    from tui.conftest import Realm

GOAL = {"x": 0.3, "y": 0.0, "z": 0.3, "twist": 0.0}
PARTS = ("#robots", "#below", "#details-box", "#picture-box", "#last")


def places(operator: Operator) -> dict[str, Region]:
    return {part: operator.app.screen.query_one(part).region for part in PARTS}


async def test_tree_picture_and_readings_stand_still_while_commands_begin_and_end(
    realm: Realm, operate: Operate
) -> None:
    async with operate(realm.realm_client, size=(160, 45)) as operator:
        await operator.until(lambda: "arm-1" in operator.app.store.descriptions)
        operator.app.choose("arm-1")
        await operator.sees("arm-1", "pose")
        await operator.until(lambda: places(operator)["#picture-box"].width > 0, "the picture")
        before = places(operator)
        realm.arm.under_way = True
        moving = asyncio.create_task(realm.realm_client.call("arm-1", "go_to", GOAL))
        await operator.sees("◐ go_to")
        assert places(operator) == before
        realm.arm.under_way = False
        await moving
        await operator.until(lambda: "◐ go_to" not in operator.text, "it has ended")
        assert places(operator) == before


async def test_parts_sizes_and_filters_are_so_after_a_restart(
    realm: Realm, operate: Operate, tmp_path: Path
) -> None:
    file = tmp_path / "screen.yaml"
    async with operate(realm.realm_client, layout=LayoutFile(file)) as operator:
        await operator.sees("arm-1", "rover-1")
        await operator.press("I", "I")
        await operator.sees("robots, in parts by kind", "Arm: 1 robot", "Rover: 1 robot")
        await operator.press("home")
        assert operator.one(RobotTable).selected == "arm-1", "the cursor passes over headings"
        await operator.press("up", "down", "down")
        assert operator.one(RobotTable).selected == "rover-1"
        high = operator.app.screen.query_one("#below").region.height
        await operator.press("plus")
        await operator.settled()
        high, before = operator.app.screen.query_one("#below").region.height, high
        assert high > before
        broad = places(operator)["#picture-box"].width
        await operator.press("right_parenthesis")
        await operator.settled()
        assert places(operator)["#picture-box"].width > broad > 0
        broad = places(operator)["#picture-box"].width
        await operator.press("N")
        await operator.sees("no filter is saved yet")
        await operator.obey("view save night")
        await operator.sees("nothing is filtered")
        await operator.press("slash")
        await operator.type("~am1")
        await operator.press("enter")
        await operator.obey("view save night")
        await operator.sees("the filter ~am1 is kept as night")
        await operator.press("escape", "v")
    async with operate(realm.realm_client, layout=LayoutFile(file)) as operator:
        await operator.sees("views")
        await operator.press("l")
        await operator.sees("in parts by kind", "Rover: 1 robot")
        assert places(operator)["#picture-box"].width == broad
        assert places(operator)["#below"].height == high
        await operator.obey("view night")
        await operator.sees("night /~am1", "1 of 2")
        await operator.press("N")
        await operator.sees("Rover: 1 robot")
        await operator.obey("view day")
        await operator.sees("no saved filter 'day'; there are night")
        await operator.obey("view drop night")
        assert LayoutFile(file).layout.filters == {}


async def test_a_layout_that_is_no_yaml_is_one_sentence_on_a_usual_screen(
    realm: Realm, operate: Operate, tmp_path: Path
) -> None:
    file = tmp_path / "screen.yaml"
    file.write_text("page: [robots\n")
    async with operate(realm.realm_client, layout=LayoutFile(file), size=(160, 45)) as operator:
        await operator.sees("is no layout of the screen (no YAML in line 2)", "arm-1")
