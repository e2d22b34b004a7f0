"""The list of robots: groups, robots that are away or that nobody lists, and how they are found."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from textual.widgets import OptionList

from robotree.tui.screen.pages.dialogs import Choosing, Confirm, Reading
from robotree.tui.screen.pages.group import GroupPanel
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.pages.orders import OrdersPage
from robotree.tui.screen.pages.panel import PanelPage, SidePane
from robotree.tui.screen.widgets.robot_table import RobotTable
from robotree.vr import Robot, command
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.base.group import RobotGroup
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.network.policy_file import PolicyFile
from robotree.vr.orders.ledger import Ledger, OrderMemory
from robotree.vr.orders.service import DirectoryService
from robotree.vr.orders.store import OrderStore
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.testing import until
from tests.tui.conftest import EXAMPLES
from tests.tui.screens.test_panel_page import open_panel

if TYPE_CHECKING:
    from screens.conftest import Operate, Operator
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
    carts: list[Cart], operator: Operator
) -> None:
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


class Carrier(Robot):
    """A cart."""

    @command(offline="queue")
    def roll(self, x: float) -> float:
        """Roll."""
        return x


async def test_orders_of_a_robot_that_is_away_are_shown_and_cancelled(
    realm: Realm, operate: Operate, tmp_path: Path
) -> None:
    store = OrderStore(tmp_path / "directory.db")
    directory = DirectoryService(realm.network.join("directory"), "d1", store)
    await directory.start()
    transport = realm.network.join("cart")
    registrar = Registrar(transport)
    agent = RobotAgent(
        Carrier("cart-7"), transport, registrar=registrar, orders=OrderMemory(Ledger(None), "the-cart")
    )
    await agent.start()
    async with operate(realm.realm_client) as operator:
        await operator.until(lambda: "the-cart" in store.agents, "the directory knows it")
        await agent.close()
        await operator.until(lambda: operator.app.store.is_away("cart-7"), "it is away")
        await operator.press("A")
        await operator.sees("no order is left; :call ROBOT.COMMAND --queue leaves one")
        assert not operator.one(OptionList).display, "no empty box"
        await operator.press("escape")
        await operator.sees("cart-7", "away since")
        left = await realm.realm_client.orders.leave("cart-7", "roll", {"x": 1.0})
        await operator.press("A")
        await operator.sees("orders", left.order.ticket, "cart-7.roll", "waiting")
        assert isinstance(operator.app.screen, OrdersPage)
        await operator.press("enter")
        await operator.sees("Cancel the order", "left by")
        await operator.press("tab", "enter")
        await operator.until(
            lambda: store.orders[left.order.key].state == "cancelled", "the directory has cancelled it"
        )
        await operator.sees("cancelled")
    await registrar.close()
    await directory.close()
    store.close()


async def test_who_comes_after_the_last_lookup_service_sees_what_ls_lists_marked_stale(
    realm: Realm, operate: Operate
) -> None:
    await realm.create("move_to.py", "mover")
    await realm.realm_client.enslave("mover", "arm", "arm-1")
    realm.network.kill(realm.members["lookup-1"])
    await until(lambda: realm.realm_client.stale, "the lookup service has gone")
    realm_client = RealmClient(realm.network.join("newcomer"))
    await realm_client.start()
    async with operate(realm_client) as operator:
        await operator.sees("STALE: no lookup service is left", "mover", "rover-1", "● free stale", "2 free")
        assert set(operator.one(RobotTable).names) == {"mover", "arm-1", "rover-1"}
        assert set(operator.app.store.robots) == {"mover", "rover-1"}, "the enslaved arm is on no list"
        await operator.until(lambda: set(operator.app.store.views) == {"cell"}, "the view")
        await realm.robot(Robot("late-1"))
        await operator.sees("late-1 (Robot) has come, but no lookup service lists it", "3 free")
        await realm.lookup("lookup-2")
        listed = {"mover", "rover-1", "late-1"}
        await operator.until(
            lambda: not operator.app.store.stale and set(operator.app.store.robots) == listed, "the new list"
        )
        told = [happening.text for happening in operator.app.store.entries]
        assert "a lookup service is back" in told
        assert not [text for text in told if "left the list" in text], "they were on none"
        await operator.until(lambda: "stale" not in operator.text, "nothing is in doubt")
    await realm_client.close()


async def test_the_death_of_an_enslaved_robots_process_is_told_once_and_its_hanging_is_none(
    realm: Realm, operate: Operate
) -> None:
    await realm.create("move_to.py", "mover")
    await realm.create("move_square.py", "square")
    await realm.realm_client.enslave("mover", "arm", "arm-1")
    await realm.realm_client.enslave("square", "rover", "rover-1")
    async with operate(realm.realm_client) as operator:
        store = operator.app.store
        await operator.until(lambda: len(store.enslaved) == 2, "both are known to be enslaved")
        realm.network.freeze(realm.members["rover-1"])
        realm.network.kill(realm.members["arm-1"])
        operator.app.feed.hint()
        await operator.sees("✗ arm-1 (Arm): its process has gone")
        await realm.realm_client.delete("mover")
        await operator.until(lambda: "mover" not in store.descriptions, "the next look")
        gone = [happening.text for happening in store.entries if "has gone" in happening.text]
        assert gone == ["arm-1 (Arm): its process has gone"]
        realm.network.thaw(realm.members["rover-1"])


async def test_a_robot_that_would_be_better_off_elsewhere_is_marked_and_a_key_carries_that_out(
    realm: Realm, operator: Operator
) -> None:
    host = await realm.host("host-9")
    await realm.realm_client.create(str(EXAMPLES / "move_to.py"), "mover", "host-9")
    runtime = host.agents["mover"].runtime
    await operator.until(lambda: "mover" in operator.app.store.descriptions, "its description")
    operator.app.choose("mover")
    await operator.press("f")
    await operator.at(Choosing)
    await operator.sees("mover is on", "nobody has looked yet", "manual", "people alone move it (now)")
    await operator.press("down", "enter")
    await operator.at(MainPage)
    await operator.until(lambda: runtime.placement == "advise", "it is placed by advice")
    runtime.advice, runtime.advised = "host-2 is nearer than host-1", "host-2"
    runtime.changed()
    await operator.sees("better off on host-2")
    await operator.until(
        lambda: operator.app.store.descriptions["mover"].advice == runtime.advice, "the advice"
    )
    await operator.press("f")
    await operator.at(Choosing)
    await operator.sees(
        "host-2 is nearer than host-1", "move to host-2 now", "where it would be better off (now)"
    )
    await operator.press("enter")
    await operator.at(MainPage)
    await operator.sees("no host named 'host-2' is running")  # it was obeyed: only the host is missing here
    operator.app.choose("arm-1")
    await operator.press("f")
    await operator.sees("arm-1 is a proxy, and stays where its controller is")


async def test_the_help_shows_only_what_is_searched_for_until_escape(operator: Operator) -> None:
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
    operator: Operator,
) -> None:
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
    found = [one for one in operator.app.get_system_commands(operator.app.screen) if "rover-1" in one.title]
    assert [command.title for command in found] == ["Robot: rover-1"]
    found[0].callback()
    await operator.at(MainPage)
    await operator.until(lambda: operator.app.selection.name == "rover-1", "it is selected")
