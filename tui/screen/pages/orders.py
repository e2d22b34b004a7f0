"""The orders of the realm: what waits for robots, what is under way, and results that nobody has taken."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

from rich.text import Text
from textual import on, work
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.widgets import Button, OptionList, Static
from textual.widgets.option_list import Option

from robotree.tui.line import ordering
from robotree.tui.line.grammar import Line
from robotree.tui.screen.pages.dialogs import Modal
from robotree.tui.screen.widgets.marks import DIM, tint
from robotree.vr.base.errors import VrError

if TYPE_CHECKING:
    from robotree.vr.base.order import Order, OrderHold

PERIOD = 1.0
"""[s] between two looks at the directories."""
COLOURS = {"done": "success", "failed": "error", "in doubt": "error", "refused": "warning", "taken": "accent"}
"""Variable of the theme by the state of an order; all others are dim."""

NONE = "no order is left; :call ROBOT.COMMAND --queue leaves one"

Answer = Literal["cancel", "confirm", ""]


class OrdersPage(Modal[None]):
    """A list of orders; choosing one shows it, and lets it be cancelled."""

    def __init__(self) -> None:
        """Nothing is known yet."""
        super().__init__()
        self._orders: tuple[Order, ...] = ()
        self._shown: list[tuple[Any, ...]] = []

    def box(self) -> ComposeResult:
        """The list, and what holds robots."""
        with Vertical(classes="dialog reading") as box:
            box.border_title = "orders"
            yield Static("", id="orders-holds", markup=False)
            yield OptionList(id="orders-list", markup=False)
            yield Static("the directories are asked …", id="orders-note", markup=False)

    def on_mount(self) -> None:
        """Look now and then."""
        self.query_one(OptionList).focus()
        self._look()
        self.set_interval(PERIOD, self.guarded(self._look_again))

    def _look_again(self) -> None:
        self._look()

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
        choices = self.query_one(OptionList)
        choices.display = bool(orders)
        if orders and self.focused is None:
            choices.focus()
        rows = [
            (each.key, each.state, each.at, each.asks, each.confirmed_by, each.cancelled_by)
            for each in orders
        ]
        if rows == self._shown:
            return
        self._shown, self._orders = list(rows), tuple(orders)
        at = choices.highlighted
        choices.clear_options()
        choices.add_options([Option(self._row(each), id=each.key) for each in orders])
        if orders:
            choices.highlighted = min(at or 0, len(orders) - 1)

    def _row(self, order: Order) -> Text:
        state = tint(self.app, COLOURS[order.shown]) if order.shown in COLOURS else DIM
        return Text.assemble(
            (f"{order.ticket}  ", DIM),
            (f"{order.robot}.{order.command}  ", "bold"),
            (f"{order.shown}  ", state),
            f"{order.who}  {ordering.about(order)}",
        )

    @on(OptionList.OptionSelected)
    def _chosen(self, event: OptionList.OptionSelected) -> None:
        order = next((each for each in self._orders if each.key == event.option.id), None)
        if order is not None:
            self.app.push_screen(OrderDialog(order, readonly=self.app.readonly), self._answered(order))

    def _answered(self, order: Order) -> Any:
        def answered(answer: Answer | None) -> None:
            if answer:
                self.app.perform(Line(f"order {answer}", {"TICKET": order.key}))
            elif order.over:
                self._take(order)
            self._look()

        return answered

    @work(exit_on_error=False, group="results")
    async def _take(self, order: Order) -> None:
        """Take a result that a person has seen out of the inbox."""
        mine = {each.key for each in await self.app.realm_client.orders.inbox()}
        if order.key in mine:
            await self.app.realm_client.orders.mark_seen([order])
            self._look()


class OrderDialog(Modal[Answer]):
    """Shows one order. The harmless answer comes first and has the focus."""

    def __init__(self, order: Order, *, readonly: bool) -> None:
        """Take the order; `readonly`: it cannot be changed from here."""
        super().__init__()
        self._order, self._readonly = order, readonly

    def box(self) -> ComposeResult:
        """What is known of it, and what can be done."""
        order = self._order
        with Vertical(classes="dialog"):
            yield Static(f"order {order.ticket}", classes="dialog-title", markup=False)
            with VerticalScroll():
                yield Static(ordering.portrait(order), markup=False)
            with Horizontal(classes="buttons"):
                yield Button("Close", id="close", compact=True)
                if not (order.over or self._readonly):
                    if order.asks and not order.confirmed_by:
                        yield Button("Let it begin", id="confirm", compact=True)
                    yield Button("Cancel the order", id="cancel", variant="error", compact=True)

    def on_mount(self) -> None:
        """Focus the harmless answer."""
        self.query_one("#close", Button).focus()

    @on(Button.Pressed)
    def _pressed(self, event: Button.Pressed) -> None:
        answers: dict[str | None, Answer] = {"cancel": "cancel", "confirm": "confirm"}
        self.dismiss(answers.get(event.button.id, ""))
