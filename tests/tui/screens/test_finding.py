"""Robots and help are found by typing: in the palette, and in the help page."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotree.tui.screen.pages.dialogs import Reading
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.pages.panel import PanelPage

from .test_panel_page import open_panel

if TYPE_CHECKING:
    from screens.conftest import Operate
    from tui.conftest import Realm


async def test_the_help_shows_only_what_is_searched_for_until_escape(realm: Realm, operate: Operate) -> None:
    async with operate(realm.realm_client) as operator:
        await operator.press("question_mark")
        await operator.at(Reading)
        await operator.sees("stops every robot at once")
        await operator.type("/palette")
        await operator.sees("Palette: everything by name")
        await operator.until(lambda: "stops every robot at once" not in operator.text, "the rest is left out")
        await operator.type("x")
        await operator.sees("nothing found")
        await operator.press("escape")
        await operator.sees("stops every robot at once")
        await operator.press("escape")
        await operator.at(MainPage)


async def test_a_panel_has_its_keys_first_in_the_help_and_another_robot_is_found_in_the_palette(
    realm: Realm, operate: Operate
) -> None:
    async with operate(realm.realm_client) as operator:
        await open_panel(operator, "arm-1")
        await operator.press("f1")
        await operator.at(Reading)
        await operator.until(
            lambda: (
                operator.text.find("In the panel of a robot")
                < operator.text.find("On every page") % (len(operator.text) + 1)
            ),
            "its keys come first",
        )
        await operator.press("escape")
        await operator.at(PanelPage)
        found = [
            one for one in operator.app.get_system_commands(operator.app.screen) if "rover-1" in one.title
        ]
        assert [command.title for command in found] == ["Robot: rover-1"]
        found[0].callback()
        await operator.at(MainPage)
        await operator.until(lambda: operator.app.selection.name == "rover-1", "it is selected")
