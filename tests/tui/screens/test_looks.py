"""Other colours, words and sizes, chosen by key or line and kept for the person; without colours, signs."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from rich.segment import Segment
from textual.geometry import Region
from textual.widgets._footer import FooterKey

from robotree.tui import words
from robotree.tui.processes.layout import LayoutFile
from robotree.tui.screen.pages.dialogs import Confirm
from robotree.tui.screen.themes import chosen, read
from robotree.tui.screen.widgets.key_line import KeyLine
from robotree.tui.screen.widgets.robot_table import RobotTable

if TYPE_CHECKING:
    from screens.conftest import Operate, Operator
    from tui.conftest import Realm


@pytest.mark.parametrize("code", ["de", "ar"])
async def test_a_person_reads_keys_headers_states_and_questions_in_another_language(
    realm: Realm, operate: Operate, code: str
) -> None:
    await realm.create("move_to.py", "mover")
    async with operate(realm.realm_client, size=(80, 24)) as operator:
        await operator.sees("mover", "rover-1", "STATE")
        await operator.obey(f"language {code}")
        say = words.say
        await operator.sees(say("free"), say("STATE"), say("STOP"), say("New"), say("Help"))
        footer = [key.description for key in operator.one(KeyLine).query(FooterKey)]
        assert say("Help") in footer
        assert say("New") in footer
        assert all(len(line) <= 80 for line in operator.text.splitlines())
        operator.app.choose("mover")
        await operator.press("d")
        await operator.until(lambda: isinstance(operator.app.screen, Confirm), "a question")
        await operator.sees("delete mover?", say("Cancel"), say("Delete"))
        await operator.press("escape", "space")
        await operator.sees(say("PROTECTIVE STOP"), say("{key} resumes", key="R"), say("stopped"))
        await operator.obey("language xx")
        await operator.sees("no language 'xx'")


async def test_a_person_changes_the_colours_by_key_and_by_name(realm: Realm, operate: Operate) -> None:
    async with operate(realm.realm_client, size=(80, 24)) as operator:
        app = operator.app
        app.looks.wear(app.looks.kept, [read('[colours]\nprimary = "#ffffff"\n', "desk", "desk.toml")])
        await operator.sees("rover-1")
        before = app.theme
        await operator.press("f8")
        assert app.theme != before
        await operator.obey("theme desk")
        await operator.sees("theme desk")
        assert app.theme == chosen("desk", app.console.color_system, app.looks.own_themes).name
        await operator.obey("theme neon")
        await operator.sees("no theme 'neon'")
        assert app.store.entries[-1].text.endswith("robotree/themes/NAME.toml, read at the start")
        assert app.looks.kept.get("theme", "") == "desk"


def drawn(operator: Operator) -> list[list[Segment]]:
    """Return the lines as the terminal gets them: through all filters."""
    app = operator.app
    ground = app.screen.background_colors[1]
    lines: list[list[Segment]] = []
    for strip in app.screen._compositor.render_strips():
        for line_filter in app.get_line_filters():
            strip = strip.apply_filter(line_filter, ground)  # noqa: PLW2901 # one after the other
        lines.append(list(strip))
    return lines


def reversed_text(operator: Operator) -> str:
    """Return what is drawn in reverse."""
    return "\n".join(
        "".join(one.text for one in line if one.style and one.style.reverse) for line in drawn(operator)
    )


async def test_without_colours_the_stop_and_the_selected_robot_are_reversed(
    realm: Realm, operate: Operate, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    async with operate(realm.realm_client) as operator:
        await operator.until(lambda: "rover-1" in operator.app.store.descriptions, "it is known")
        operator.app.choose("rover-1")
        await operator.until(lambda: operator.one(RobotTable).selected == "rover-1", "the cursor")
        await operator.sees("● free", "space STOP")
        assert "space STOP" in reversed_text(operator)
        await operator.until(lambda: "rover-1" in reversed_text(operator), "the cursor is seen")
        await operator.press("space")
        await operator.sees("■ PROTECTIVE STOP: arm-1, rover-1", "■ stopped")
        assert "■ PROTECTIVE STOP: arm-1, rover-1" in reversed_text(operator)
        colours = {
            colour
            for line in drawn(operator)
            for one in line
            if one.style
            for colour in (one.style.color, one.style.bgcolor)
            if colour is not None and not colour.is_default
        }
        assert {colour.get_truecolor().red for colour in colours} == {
            colour.get_truecolor().green for colour in colours
        }, "only greys"


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
        await operator.until(lambda: places(operator)["#picture-box"].width == broad, "as broad as before")
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
