"""The messages on a proxy's wire: rate, age, fields; a field that is ticked is drawn over time."""

from __future__ import annotations

from collections.abc import Mapping

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.containers import Horizontal

from robotree.tui.processes.wire_watch import WireMessage
from robotree.tui.screen.pages.page import Page
from robotree.tui.screen.widgets.cached_text import CachedText, entitle
from robotree.tui.screen.widgets.marks import tint
from robotree.tui.screen.widgets.row_list import Row, RowList
from robotree.tui.seen.cells import fit, seen
from robotree.tui.seen.series import Reading

NAME = 26
"""Cells for the name of a message."""


class MessagesPage(Page):
    """Watches the wire of one proxy while it is in front, or while a field of it is ticked."""

    KEYS_OF = "messages"

    def __init__(self, robot: str) -> None:
        """Watch a robot's wire."""
        super().__init__()
        self.robot = robot

    def parts(self) -> ComposeResult:
        """Messages; beside them the fields of the one under the cursor."""
        yield CachedText(id="messages-note")
        with Horizontal(classes="columns"):
            yield RowList(id="messages-list", compact=True)
            yield RowList(id="messages-fields", compact=True)

    def on_mount(self) -> None:
        """Begin to listen."""
        self.app.watching.watch_wire(self.robot)
        self.query_one("#messages-list").focus()

    def title_of_page(self) -> str:
        """Say whose wire it is."""
        return f"messages of {self.robot}"

    def action_back(self) -> None:
        """Leave; the wire is watched no longer, unless a field is ticked."""
        self.dismiss()
        self.app.watching.leave_wire(self.robot)

    def action_plots(self) -> None:
        """Show what is ticked over time."""
        self.app.ask_for("readings")

    @on(RowList.OptionSelected, "#messages-list")
    def _into(self) -> None:
        self.query_one("#messages-fields").focus()

    @on(RowList.OptionSelected, "#messages-fields")
    def _ticked(self) -> None:
        message, field = self.chosen, str(self.query_one("#messages-fields", RowList).chosen)
        if message is None:
            return
        if field in message.numbers():
            self.app.watching.tick(self._reading(message, field))
        else:
            self.app.tell(f"{field} is no number: only numbers are drawn over time", "warning")
        self.draw()

    def _reading(self, message: WireMessage, field: str) -> Reading:
        return self.robot, f"{message.name}.{field}"

    @property
    def _messages(self) -> tuple[WireMessage, ...]:
        watch = self.app.watching.wires.get(self.robot)
        return tuple(sorted(watch.messages, key=lambda one: one.id)) if watch else ()

    @property
    def chosen(self) -> WireMessage | None:
        """The message under the cursor."""
        wanted = self.query_one("#messages-list", RowList).chosen
        return next((one for one in self._messages if one.id == wanted), None)

    # -- drawing -----------------------------------------------------------------------------------

    def draw(self) -> None:
        """Draw what the wire says."""
        super().draw()
        if not self.is_mounted:
            return
        watch, messages = self.app.watching.wires.get(self.robot), self._messages
        note = self.query_one("#messages-note", CachedText)
        note.display = bool(watch and watch.note)
        note.show(Text(f" {seen(watch.note)}" if watch else "", tint(self.app, "warning")))
        self.query_one("#messages-list", RowList).fill(Row(each.id, self._row(each)) for each in messages)
        message = self.chosen
        fields = list[Row]()
        if message is not None:
            numbers = message.numbers()
            names = [*numbers, *(name for name in message.fields if not any(
                number.partition("[")[0] == name for number in numbers))]  # fmt: skip
            fields = [Row(name, self._field(message, name, numbers)) for name in names]
        self.query_one("#messages-fields", RowList).fill(fields)
        entitle(self.query_one("#messages-list"), "message, rate, age")
        entitle(self.query_one("#messages-fields"), f"fields of {message.name}" if message else "fields")

    def _row(self, one: WireMessage) -> Text:
        muted = tint(self.app, "muted")
        rate = "once" if one.rate is None else f"{one.rate:.1f}/s"
        return Text.assemble(
            (f"{one.sysid}/{one.compid} ".rjust(6), muted),
            fit(one.name, NAME),
            (f"{rate:>9} {one.age:>7.1f} s", ""),
        )

    def _field(self, message: WireMessage, field: str, values: Mapping[str, float]) -> Text:
        is_ticked = self._reading(message, field) in self.app.store.watched.ticked.series
        sign = ("■ " if is_ticked else "□ ") if field in values else "  "
        value = f"{values[field]:g}" if field in values else str(message.fields[field])
        return Text.assemble(
            (sign, tint(self.app, "accent" if is_ticked else "muted")),
            f"{seen(field)}  ",
            (seen(value), "bold"),
        )
