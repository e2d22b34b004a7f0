"""The orders of the realm: what waits for robots, what is under way, and results that nobody has taken."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.text import Text
from textual import on, work
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.widgets import Static

from robotree.tui.line import ordering
from robotree.tui.line.grammar import Line
from robotree.tui.screen.pages.dialogs import Answer, Modal, Question
from robotree.tui.screen.widgets.marks import DIM, tint
from robotree.tui.screen.widgets.row_list import Row, RowList
from robotree.vr.base.errors import VrError

if TYPE_CHECKING:
    from robotree.vr.base.order import Order, OrderHold

PERIOD = 1.0
"""[s] between two looks at the directories."""
COLOURS = {"done": "success", "failed": "error", "in doubt": "error", "refused": "warning", "taken": "accent"}
"""Variable of the theme by the state of an order; all others are dim."""

NONE = "no order is left; :call ROBOT.COMMAND --queue leaves one"


class OrdersPage(Modal[None]):
    """A list of orders; choosing one shows it, and lets it be cancelled."""

    def __init__(self) -> None:
        """Nothing is known yet."""
        super().__init__()
        self._orders: dict[str, Order] = {}

    def box(self) -> ComposeResult:
        """The list, and what holds robots."""
        with Vertical(classes="dialog reading") as box:
            box.border_title = "orders"
            yield Static("", id="orders-holds", markup=False)
            yield RowList(id="orders-list")
            yield Static("the directories are asked …", id="orders-note", markup=False)

    def on_mount(self) -> None:
        """Look now and then."""
        self.query_one(RowList).focus()
        self._look()
        self.set_interval(PERIOD, self._look)

    @work(exclusive=True, exit_on_error=False, group="orders")
    async def _look(self) -> None:
        try:
            board = await self.app.realm_client.orders.board()
        except VrError as error:
            self._show((), (), str(error))
            return
        orders = [each for each in board.orders if not each.seen]
        silent = f"{', '.join(board.silent)} does not answer" if board.silent else ""
        self._show(orders, board.holds, silent or ("" if orders else NONE))

    def _show(self, orders: Sequence[Order], holds: Sequence[OrderHold], note: str) -> None:
        held = ordering.held(holds, f"{self.app.keymap.spelled('resume')} releases it")
        self.query_one("#orders-holds", Static).update("\n".join(held))
        self.query_one("#orders-note", Static).update(note)
        choices = self.query_one(RowList)
        choices.display = bool(orders)
        if orders and self.focused is None:
            choices.focus()
        self._orders = {each.key: each for each in orders}
        choices.fill(Row(each.key, self._row(each)) for each in orders)

    def _asking(self) -> set[str]:
        return {name for name, robot in self.app.store.descriptions.items() if robot.asks}

    def _row(self, order: Order) -> Text:
        state = tint(self.app, COLOURS[order.shown]) if order.shown in COLOURS else DIM
        return Text.assemble(
            (f"{order.ticket}  ", DIM),
            (f"{order.robot}.{order.command}  ", "bold"),
            (f"{order.shown}  ", state),
            f"{order.who}  {ordering.about(order, self._asking())}",
        )

    @on(RowList.OptionSelected)
    def _chosen(self, event: RowList.OptionSelected) -> None:
        order = self._orders.get(str(event.key))
        if order is None:
            return
        answers = [Answer("Let it begin", "confirm")] if order.asks and not order.confirmed_by else []
        answers.append(Answer("Cancel the order", "cancel", "error"))
        if order.over or self.app.readonly:
            answers = []

        def answered(answer: str | None) -> None:
            if answer:
                self.app.perform(Line(f"order {answer}", {"TICKET": order.key}))
            elif order.over:
                self._take(order)
            self._look()

        portrait = ordering.portrait(order, self._asking())
        question = Question(f"order {order.ticket}", portrait, *answers, harmless="Close")
        self.app.push_screen(question, answered)

    @work(exit_on_error=False, group="results")
    async def _take(self, order: Order) -> None:
        """Take a result that a person has seen out of the inbox."""
        mine = {each.key for each in await self.app.realm_client.orders.inbox()}
        if order.key in mine:
            await self.app.realm_client.orders.mark_seen([order])
            self._look()
