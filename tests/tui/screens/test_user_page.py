"""The page for people who do not operate robots, on 40 by 20 characters."""

from __future__ import annotations

import asyncio
import os
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from textual.widgets import Button, Input, OptionList, TextArea

from robotree.tui.line import taken
from robotree.tui.line.known_kinds import checked_script
from robotree.tui.screen.pages.user import DoingPage, UserPage, WritePage, template
from robotree.tui.screen.user_app import UserApp
from robotree.tui.screen.widgets.row_list import RowList
from robotree.tui.seen.watched import Alarm
from robotree.vr import Robot, command
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.base.policy import PolicyGate
from robotree.vr.base.policy_reading import read_policy
from robotree.vr.base.principal import user_name
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.orders.ledger import Ledger, OrderMemory
from robotree.vr.orders.service import DirectoryService
from robotree.vr.orders.store import OrderStore
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.network import MemoryNetwork

if TYPE_CHECKING:
    from screens.conftest import Operate, Operator
    from tui.conftest import Realm

SIZE = (40, 20)
POINT, HOLD = "Move the gripper to a point.", "Stay here."


class Cart(Robot):
    """A cart."""

    @command(offline="queue")
    def roll(self, x: float) -> float:
        """Bring the post to the door."""
        return 2 * x


async def opened(operator: Operator, title: str) -> DoingPage:
    """Choose what can be done by its title."""
    listed = operator.one(RowList)

    def place() -> int | None:
        can = (at for at, row in enumerate(listed.rows) if str(row.key).startswith("can:"))
        return next((at for at in can if title in listed.rows[at].text.plain), None)

    await operator.until(lambda: place() is not None, title)
    listed.highlighted = place()
    await operator.press("enter")
    return await operator.at(DoingPage)


async def test_something_is_begun_watched_and_its_result_taken(realm: Realm, operate: Operate) -> None:
    realm.arm.under_way = True
    async with operate(realm.realm_client, size=SIZE, kind=UserApp) as operator:
        page = await opened(operator, POINT)
        await operator.type("0.3")
        await operator.press("ctrl+r")
        assert realm.arm.calls == [], "it lacks a value, and says so"
        await operator.sees("needs a number")
        for value in ("0", "0.4", "0"):
            await operator.press("tab") if not isinstance(operator.app.focused, Input) else None
            await operator.type(value)
            await operator.press("enter")
        await operator.press("ctrl+r")
        assert not page.is_attached
        await operator.sees("Under way", POINT[:20], "◐", " s")
        realm.arm.under_way = False
        await operator.sees("Results", "done")
        listed = operator.one(OptionList, "#can")
        listed.highlighted = 1
        await operator.press("enter")
        await operator.until(lambda: "Results" not in operator.text, "the result is taken")


async def test_alarms_of_operators_are_not_shown_to_who_operates_nothing(
    realm: Realm, operate: Operate
) -> None:
    async with operate(realm.realm_client, size=SIZE, kind=UserApp) as operator:
        app = operator.app
        app.tell("the door is open")
        await operator.sees("the door is open")
        alarm = Alarm(robot="arm-1", reading="j1", sign=">", limit=0.1, raised=1.0, value=0.2)
        app.store.take_alarms([alarm], app.now(), "`alarm ack` acknowledges it")
        assert app.store.entries[-1].text.startswith("ALARM: arm-1.j1")
        app.screen.draw()
        await operator.settled()
        assert "ALARM" not in operator.text
        assert "the door is open" in operator.text


async def test_an_order_is_left_for_who_is_away_and_its_result_waits(
    realm: Realm, operate: Operate, tmp_path: Path
) -> None:
    store, ledger = OrderStore(tmp_path / "directory.db"), Ledger(None)
    directory = DirectoryService(realm.network.join("directory"), "d1", store)
    await directory.start()

    async def cart(name: str) -> tuple[RobotAgent, Registrar]:
        transport = realm.network.join(name)
        registrar = Registrar(transport)
        made = RobotAgent(
            Cart("cart-7"), transport, registrar=registrar, orders=OrderMemory(ledger, "the-cart")
        )
        await made.start()
        return made, registrar

    agent, registrar = await cart("cart")
    async with operate(realm.realm_client, size=SIZE, kind=UserApp) as operator:
        await operator.until(lambda: "the-cart" in store.agents, "the directory knows it")
        await agent.close()
        await registrar.close()
        await operator.until(lambda: operator.app.store.is_away("cart-7"), "it is away")
        page = await opened(operator, "Bring the post")
        await operator.sees("when it is back")
        assert page.query_one("#begin", Button).disabled
        await operator.type("3")
        page.query_one("#until", Input).value = "soon"
        page.query_one("#order", Button).press()
        await operator.sees("30min, 2h or 3d")
        page.query_one("#until", Input).value = "2h"
        page.query_one("#order", Button).press()
        await operator.sees("Left for later", "waits, to begin by")
        agent, registrar = await cart("cart again")
        await operator.sees("Results", "done: 6")
        operator.one(OptionList, "#can").highlighted = 1
        await operator.press("enter")
        await operator.until(lambda: all(each.seen for each in store.orders.values()), "it is taken")
        await operator.until(lambda: "Results" not in operator.text, "it is off the list")
    await agent.close()
    await registrar.close()
    await directory.close()
    store.close()


async def test_what_a_person_may_not_is_there_with_the_reason(
    realm: Realm, operate: Operate, monkeypatch: pytest.MonkeyPatch
) -> None:
    gate, me = PolicyGate(), user_name(os.geteuid())
    gate.policy = read_policy(
        f"realm: test\nversion: 1\nask: anna\npersons: {{{me}: guest}}\n"
        "roles: {guest: {see: '*', command: arm-1.hold}}\n",
    )
    monkeypatch.setattr(realm.realm_client._transport, "gate", gate)
    async with operate(realm.realm_client, size=(60, 40), kind=UserApp) as operator:
        page = await opened(operator, POINT)
        assert "may not command arm-1.go_to" in page.behaviour.state
        await operator.sees("ask anna")
        await operator.type("0")
        await operator.press("ctrl+r")
        assert page.is_attached
        assert realm.arm.calls == []


async def test_without_a_network_orders_are_left_in_what_was_taken_along(
    realm: Realm, operate: Operate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    store = OrderStore(tmp_path / "directory.db")
    directory = DirectoryService(realm.network.join("directory"), "d1", store)
    await directory.start()
    transport = realm.network.join("cart")
    agent = RobotAgent(Cart("cart-7"), transport, orders=OrderMemory(Ledger(None), "the-cart"))
    await agent.start()
    async with asyncio.timeout(60):
        while "the-cart" not in store.agents:  # noqa: ASYNC110 # a directory that looks around
            await asyncio.sleep(0.02)
    with taken.opened("test", "me") as book:
        book.keep(agents=[store.agents["the-cart"]])
    await agent.close()
    await directory.close()
    store.close()
    client = RealmClient(MemoryNetwork().join("alone"), "test")
    await client.start()
    try:
        async with operate(client, size=SIZE, kind=UserApp) as operator:
            page = await opened(operator, "Bring the post")
            await operator.sees("without network")
            await operator.type("3")
            page.query_one("#order", Button).press()
            await operator.sees("Left for later", "waits, to begin by")
    finally:
        await client.close()
    with taken.opened("test") as book:
        assert [(each.command, each.state, each.who) for each in book.store.orders.values()] == [
            ("roll", "waiting", "me")
        ]


async def test_a_script_is_written_checked_and_made(
    realm: Realm, operate: Operate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    async with operate(realm.realm_client, size=(60, 30), kind=UserApp) as operator:
        await operator.until(lambda: "arm-1" in operator.app.store.descriptions, "the arm")
        listed = operator.one(OptionList, "#can")
        await operator.until(lambda: "Write a script" in operator.text, "the row")
        listed.highlighted = listed.option_count - 1
        await operator.press("enter")
        page = await operator.at(WritePage)
        area = page.query_one(TextArea)
        area.focus()
        await operator.press("space")
        assert area.text.startswith(" "), "a space is a letter here, and stops nobody"
        assert operator.app.store.stopped == ()
        await operator.press("backspace")
        good = area.text
        area.text = good.replace("- start", "- stat")
        page.query_one("#check", Button).press()
        await operator.sees("✗")
        area.text = good
        await operator.press("ctrl+r")
        await operator.until(lambda: "mine" in operator.app.store.descriptions, "the script is there")
        await operator.until(lambda: isinstance(operator.app.screen, UserPage), "the list")
        await operator.sees("What it is for.")
    assert await asyncio.to_thread((tmp_path / "mine.yaml").read_text) == good


def test_the_template_of_a_script_is_a_script_also_where_nobody_is() -> None:
    assert checked_script(template("mine", []), "mine.yaml") == 2


async def test_what_a_robot_without_its_arm_does_cannot_be_begun_and_says_so(
    realm: Realm, operate: Operate
) -> None:
    await realm.create("move_to.py", "mover")
    async with operate(realm.realm_client, size=SIZE, kind=UserApp) as operator:
        await operator.until(lambda: bool(operator.app.desk.behaviours()), "there is something")

        def of_mover() -> list[tuple[bool, str]]:
            found = operator.app.desk.behaviours()
            return [(one.doers[0].begins, one.state) for one in found if one.robot.name == "mover"]

        await operator.until(lambda: bool(of_mover()), "the mover is listed")
        assert all(not begins and "it has no arm yet" in state for begins, state in of_mover())
        await operator.sees("✗")
        await realm.realm_client.enslave("mover", "arm", "arm-1")
        await operator.until(lambda: any(begins for begins, _ in of_mover()), "it can now")
