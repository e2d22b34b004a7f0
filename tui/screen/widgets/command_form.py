"""The form of one command: its fields, a button, progress, result."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.containers import Horizontal, VerticalScroll
from textual.dom import DOMNode
from textual.events import Event, Key
from textual.message import Message
from textual.widget import Widget
from textual.widgets import Button, Label, Static

from robotree.tui.screen import entry, key_guard
from robotree.tui.screen.key_guard import Form
from robotree.tui.screen.part import Part
from robotree.tui.screen.widgets.cached_text import CachedText
from robotree.tui.screen.widgets.field_row import FieldRow, filled_in
from robotree.tui.screen.widgets.marks import tint
from robotree.tui.seen import wording
from robotree.tui.seen.errand import CallListener
from robotree.vr.base.description import CommandSpec
from robotree.vr.network.realms import DEFAULT_REALM

CELLS = 20
"""Of the bar that shows how far a command is."""


class CommandForm(Form, CallListener, Part, VerticalScroll):
    """Draws one command; asks the screen to run or to cancel it."""

    class Run(Message):
        """The form is filled in well and shall be carried out."""

        def __init__(self, form: CommandForm, arguments: Mapping[str, Any]) -> None:
            """Carry the form and what was filled in."""
            super().__init__()
            self.form, self.arguments = form, arguments

    class Cancel(Message):
        """A request to cancel the running command."""

    def __init__(self, robot: str, spec: CommandSpec, readings: Mapping[str, float]) -> None:
        """Draw a command of a robot, with what that reads now."""
        super().__init__(classes="form", can_focus=False)
        self.robot, self.spec = robot, spec
        self._fraction, self._text = math.nan, ""
        self._readings = dict(readings)
        self.answers = True
        """The robot is there to be commanded."""
        self.denied = ""
        """Why the policy denies it, as a sentence; empty: it does not."""
        self._began = self._turned = 0.0
        """[s] When the command was sent, and when its turn came, on the clock of events."""
        self._came_from: Widget | None = None
        """The widget that had the focus when the command was sent."""

    @property
    def running(self) -> bool:
        """Whether the command is being carried out."""
        return bool(self.carrying)

    def lets(self, node: DOMNode | None, event: Event) -> bool:
        """Let what runs be cancelled by a person who has seen that it runs (`Form.lets`)."""
        seen = self.app.now() - self._began >= key_guard.LOOK
        pressed = not isinstance(event, Key) or event.key == "enter"
        return node is not None and node.id == "cancel" and pressed and seen

    def compose(self) -> ComposeResult:
        """Documentation, fields, buttons, progress, result."""
        yield Label(self.spec.doc.strip() or "No description.", classes="form-doc", markup=False)
        for field in self.spec.parameters:
            yield FieldRow(field, self._readings)
        with Horizontal(classes="buttons"):
            yield Button(Text(f"▶ {self.spec.name}"), variant="primary", id="run", compact=True)
            yield Button("■ cancel", id="cancel", disabled=True, compact=True)
        yield CachedText(id="progress")
        yield Static("", id="outcome", markup=False)
        yield CachedText(id="as-line")

    def on_mount(self) -> None:
        """Say at once when the command cannot be used."""
        self._enable()
        self.query_one("#progress").display = False
        self._draw_line()
        if self.denied:
            self._say("✗", "warning", self.denied)
        elif not self.spec.available:
            slot = self.spec.through.partition(".")[0]
            self._say(
                "!",
                "warning",
                f"the slot {slot} is empty: enslave a robot first (key {self.app.keymap.spelled('enslave')})",
            )

    def focus_first(self) -> None:
        """Put the cursor into the first field; where there is none, say how it is run.

        Never on the button: a hasty Enter after the one that led here would make a robot move.
        """
        rows = list(self.query(FieldRow))
        if rows:
            rows[0].focus_entry()
        elif self.spec.available and not self.denied:
            self._say("·", "muted", f"{self.app.keymap.spelled('panel.run')} runs it, or the button")

    @on(FieldRow.Onward)
    def _onward(self, event: FieldRow.Onward) -> None:
        rows = list(self.query(FieldRow))
        following = rows[rows.index(event.row) + 1 :]
        if following:
            following[0].focus_entry()
        else:
            self._say("·", "muted", f"{self.app.keymap.spelled('panel.run')} runs it, or the button")

    def draw(self, readings: Mapping[str, float]) -> None:
        """Show the values now; a form that is carried out keeps what was sent, and shows how far it is."""
        if self.running:
            self._draw_progress()
            return
        for row in self.query(FieldRow):
            row.tell_readings(readings)

    def follow_settings(self, spec: CommandSpec) -> None:
        """Show the present values of settings in the fields that nobody has touched."""
        if spec.beside and spec != self.spec:
            self.spec = spec
            for row, field in zip(self.query(FieldRow), spec.parameters, strict=False):
                row.become(field)

    # -- the same as a line ------------------------------------------------------------------------

    @property
    def texts(self) -> dict[str, str]:
        """The texts in the fields, by name."""
        return {row.spec.name: row.text for row in self.query(FieldRow)}

    @property
    def line(self) -> str:
        """The command line that does the same as the form."""
        realm = self.app.realm
        return entry.command_line(
            self.robot, self.spec, self.texts, realm="" if realm == DEFAULT_REALM else realm
        )

    @on(FieldRow.Changed)
    def _draw_line(self) -> None:
        self.query_one("#as-line", CachedText).show(Text(f"$ {self.line}", tint(self.app, "muted")))

    @property
    def typed(self) -> dict[str, str]:
        """The texts that a person typed, by field."""
        return {row.spec.name: row.text for row in self.query(FieldRow) if row.touched}

    @property
    def at(self) -> str:
        """Name of the field with the cursor; empty: it is elsewhere."""
        return next((row.spec.name for row in self.query(FieldRow) if row.has_focus_within), "")

    def restore(self, typed: Mapping[str, str], at: str) -> None:
        """Take over what was typed into a form of the same command, and where the cursor was."""
        for row in self.query(FieldRow):
            if row.spec.name in typed:
                row.type_text(typed[row.spec.name])
            if row.spec.name == at:
                row.focus_entry()

    def follow(self) -> None:
        """Let the field with the cursor, or all of them, follow the robot again."""
        rows = list(self.query(FieldRow))
        for row in [one for one in rows if one.has_focus_within] or rows:
            row.follow()

    # -- what the person does ----------------------------------------------------------------------

    @on(Button.Pressed, "#run")
    def send(self) -> None:
        """Ask for the command, if the form is filled in well; else explain beside the fields."""
        if self.running:
            self.app.tell(f"{self.carrying} already; cancel it, or wait until it has ended", "warning")
            return
        if not self.answers:
            self.app.tell(f"{self.robot} does not answer: {self.spec.name} was not sent", "warning")
            return
        if self.denied or not self.spec.available:  # the form shows why, and the remedy
            return
        arguments = filled_in(self.spec, self.query(FieldRow))
        if arguments is None:
            return
        if self.spec.beside:  # what stays as it is, another person may be changing
            arguments = {name: value for name, value in arguments.items() if name in self.typed}
        self.carrying, self._began = f"{self.spec.name} is running", self.app.now()
        self._came_from = self.screen.focused
        self._enable()
        self.post_message(self.Run(self, arguments))

    @on(Button.Pressed, "#cancel")
    def _cancel(self) -> None:
        self.post_message(self.Cancel())

    # -- what comes of it --------------------------------------------------------------------------

    def started(self) -> None:
        """The command was sent."""
        if self._left:
            return
        self._fraction, self._text, self._turned = math.nan, "", self._began
        self.query_one("#outcome", Static).update("")
        self.query_one("#progress").display = True
        self._draw_progress()

    @property
    def _left(self) -> bool:
        """Whether the panel was left meanwhile and the form has gone with it."""
        return not self.query("#outcome")

    def progressed(self, fraction: float, text: str) -> None:
        """The command reports how far it is."""
        if self._left:
            return
        if wording.is_waiting(self._text) and not wording.is_waiting(text):
            self._turned = self.app.now()
        self._fraction, self._text = fraction, text
        self._draw_progress()

    def _draw_progress(self) -> None:
        """Draw how far it is, as far as the command says, and for how long it has been running or waiting."""
        style, muted = tint(self.app, "accent"), tint(self.app, "muted")
        line = Text.assemble(("◐ ", style), (self.spec.name, "bold"))
        if math.isfinite(self._fraction):
            share = min(max(self._fraction, 0.0), 1.0)
            whole = round(share * CELLS)
            line.append_text(Text.assemble("  ", ("━" * whole, style), ("─" * (CELLS - whole), muted)))
            line.append(f" {share:.0%}")
        if not wording.is_waiting(self._text):
            line.append(f"  {self.app.now() - self._turned:.0f} s", muted)
        line.append(f"  {self._text}" if self._text else "")
        self.query_one("#progress", CachedText).show(line)

    def succeeded(self, value: Any, seconds: float) -> None:
        """The command succeeded."""
        if self._left:
            return
        self._ended()
        rows = wording.result(self.spec.result, value)
        body = wording.columns([(name, text) if name else (text,) for name, text in rows]) if rows else ""
        self._say("✓", "success", f"done in {seconds:.1f} s", body)

    def failed(self, reason: str) -> None:
        """The command was refused or failed."""
        if self._left:
            return
        self._ended()
        self._say("✗", "error", reason)

    def note_answers(self, *, answers: bool) -> None:
        """Take whether the robot is there to be commanded: nothing can be sent to one that is not."""
        if answers != self.answers:
            self.answers = answers
            self._enable()

    def _ended(self) -> None:
        self.carrying = ""
        self.query_one("#progress").display = False
        if self.query_one("#cancel", Button).has_focus and self._came_from is not None:
            self._came_from.focus()  # a button that can no longer be pressed would keep the keys
        self._enable()

    def _enable(self) -> None:
        usable = self.spec.available and self.answers and not self.denied
        self.query_one("#run", Button).disabled = self.running or not usable
        self.query_one("#cancel", Button).disabled = not self.running
        if self.running and self.has_focus_within:
            self.query_one("#cancel", Button).focus()

    def _say(self, sign: str, colour: str, text: str, body: str = "") -> None:
        style = tint(self.app, colour)
        lines = Text.assemble((f"{sign} ", style), (text, style if colour == "error" else ""))
        if body:
            lines.append(f"\n{body}")
        outcome = self.query_one("#outcome", Static)
        outcome.update(lines)
        outcome.scroll_visible(animate=False)
