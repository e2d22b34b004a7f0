"""Groups in the list of robots: a line each, a form for all members, one answer from each of them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from textual.widgets import OptionList

from robotree.tui.screen.pages.dialogs import Confirm, Reading
from robotree.tui.screen.pages.group import GroupPanel
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.pages.panel import SidePane
from robotree.tui.screen.widgets.robot_table import RobotTable
from robotree.vr import Robot, command
from robotree.vr.base.group import RobotGroup
from robotree.vr.network.policy_file import PolicyFile

if TYPE_CHECKING:
    from screens.conftest import Operate
    from tui.conftest import Realm


class Cart(Robot):
    """A cart."""

    def __init__(self, name: str, strength: float) -> None:
        super().__init__(name)
        self.strength, self.stopped_by, self.loaded = strength, "", 0.0

    def safe_stop(self, reason: str) -> None:
        self.stopped_by = reason

    @command
    def load(self, kilos: float) -> float:
        """Take something on."""
        if kilos > self.strength:
            raise ValueError("too heavy")
        self.loaded = kilos
        return kilos


class Tipper(Cart):
    """A cart that tips."""

    @command
    def tip(self) -> None:
        """Tip it out."""


@pytest.fixture
async def carts(realm: Realm, tmp_path: Path) -> list[Cart]:
    realm.network.gate = PolicyFile(tmp_path)
    realm.members["operator"].gate = realm.network.gate
    found = [Cart("c1", 80.0), Tipper("c2", 20.0)]
    for cart in found:
        await realm.robot(cart)
    realm.realm_client.groups.write(RobotGroup(name="carts", names=("c1", "c2")))
    return found


async def test_a_group_is_a_line_of_the_list_and_each_member_answers(
    realm: Realm, carts: list[Cart], operate: Operate
) -> None:
    async with operate(realm.realm_client) as operator:
        await operator.select("carts")
        await operator.sees("carts", "group of 2", "2 free", "c1, c2")
        await operator.press("enter")
        await operator.until(lambda: isinstance(operator.app.screen, GroupPanel), "its panel")
        await operator.sees("carts / group", "load", "members")
        assert not operator.app.screen.query(SidePane), "a group has no branch and no camera"
        commands = operator.one(OptionList, "#commands")
        named = [str(commands.get_option_at_index(i).prompt) for i in range(commands.option_count)]
        assert "load" in named
        assert "tip" not in named, "only what all of them can do"
        commands.highlighted = named.index("load")
        await operator.press("enter")
        await operator.type("50")
        await operator.press("ctrl+r")
        await operator.sees("1 of 2 robots did not do it: c2: ", "✓ 50", "✗")
        assert carts[0].loaded == 50.0
        await operator.press("ctrl+l", "exclamation_mark")
        await operator.until(lambda: all(cart.stopped_by for cart in carts), "both are stopped")
        await operator.press("escape")
        await operator.sees("2 stopped")


async def test_what_concerns_one_robot_is_refused_for_a_group_and_its_name_can_go(
    realm: Realm, carts: list[Cart], operate: Operate
) -> None:
    async with operate(realm.realm_client) as operator:
        await operator.select("carts")
        await operator.press("r")
        await operator.sees("carts is a group: select one of its members")
        await operator.obey("pause carts")
        await operator.hears("2 of 2 robots of group carts did not do it: c1: c1 is no virtual robot")
        await operator.at(Reading)
        await operator.press("escape")
        await operator.at(MainPage)
        await operator.press("d")
        await operator.until(lambda: isinstance(operator.app.screen, Confirm), "a question")
        await operator.sees("its robots stay as they are")
        await operator.press("tab", "enter")
        await operator.until(lambda: "carts" not in realm.realm_client.groups.names(), "it is gone")
        table = operator.one(RobotTable)
        await operator.until(lambda: "carts" not in table.names, "its line, too")
        assert {"c1", "c2"} <= set(table.names)
    assert not any(cart.stopped_by for cart in carts)
