"""From nothing to a lever that closes: eighteen keys, each pressed by a person who looks."""

from __future__ import annotations

from typing import TYPE_CHECKING

from textual.widgets import Button, DirectoryTree

from robotree.tui.screen.pages.enslave import EnslaveDialog
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.pages.new import NewPage
from robotree.tui.screen.pages.panel import PanelPage

if TYPE_CHECKING:
    from screens.conftest import Operate, Operator
    from tui.conftest import Realm


def at_a_file(tree: DirectoryTree) -> bool:
    node = tree.cursor_node
    return node is not None and node.data is not None and node.data.path.suffix == ".py"


class Counting:
    """Presses keys and counts them."""

    def __init__(self, operator: Operator) -> None:
        self.operator, self.keys = operator, 0

    async def press(self, *keys: str) -> None:
        self.keys += len(keys)
        await self.operator.press(*keys)

    async def make(self, file: str, name: str) -> None:
        """Make a robot of an example, with the name that is suggested."""
        operator = self.operator
        await self.press("n")
        page = await operator.at(NewPage)
        await operator.sees(file)
        tree = operator.one(DirectoryTree)
        await operator.until(lambda: tree.has_focus and at_a_file(tree), "the first file")
        for _ in range(9):
            node = tree.cursor_node
            if node and node.data and node.data.path.name == file:
                break
            await self.press("down")
        await self.press("enter")
        await operator.until(lambda: not page.query_one("#create", Button).disabled, "it can be made")
        await self.press("enter")
        await operator.at(MainPage)
        await operator.until(lambda: operator.app.selection.name == name, f"{name} is selected")
        await operator.until(lambda: name in operator.app.store.descriptions, f"{name} is described")
        app = operator.app
        await operator.until(lambda: not app.selection.refusal(app.now()), "a person has seen the selection")

    async def enslave(self, path: str, child: str) -> None:
        await self.press("e")
        await self.operator.at(EnslaveDialog)
        await self.operator.sees(path, child)
        await self.press("enter")
        await self.operator.sees(f"{path} commands {child}")


async def test_from_nothing_to_a_closing_lever_it_takes_eighteen_keys(realm: Realm, operate: Operate) -> None:
    async with operate(realm.realm_client) as operator:
        await operator.until(lambda: "arm-1" in operator.app.store.descriptions, "the arm")
        await operator.until(lambda: bool(operator.app.store.hosts), "a host")
        hand = Counting(operator)
        await hand.make("move_to.py", "move-to")
        await hand.enslave("move-to.arm", "arm-1")
        await hand.make("open_close_lever.py", "open-close-lever")
        await hand.enslave("open-close-lever.mover", "move-to")
        await hand.press("enter")
        page = await operator.at(PanelPage)
        await operator.until(lambda: bool(page.query("CommandForm")), "the form")
        assert page.robot.commands[0].name == "close"
        await hand.press("ctrl+r")
        await operator.sees("done in")
        assert realm.arm.lever > 0.75, "the lever is closed"
        assert hand.keys <= 18, f"{hand.keys} keys"
