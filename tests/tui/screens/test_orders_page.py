"""Robots that are away in the list, and the page of the orders."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from textual.widgets import OptionList

from robotree.tui.screen.pages.orders import OrdersPage
from robotree.vr import Robot, command
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.orders.ledger import Ledger, OrderMemory
from robotree.vr.orders.service import DirectoryService
from robotree.vr.orders.store import OrderStore

if TYPE_CHECKING:
    from screens.conftest import Operate
    from tui.conftest import Realm


class Cart(Robot):
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
        Cart("cart-7"), transport, registrar=registrar, orders=OrderMemory(Ledger(None), "the-cart")
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
