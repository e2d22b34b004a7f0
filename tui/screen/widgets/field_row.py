"""One field of a form: name, entry, what it takes; what is wrong with it stands below."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.message import Message
from textual.widget import Widget
from textual.widgets import Input, Label

from robotree.tui.screen import entry
from robotree.tui.screen.part import Part
from robotree.tui.screen.widgets.choice import Choice
from robotree.tui.seen import wording
from robotree.vr.description import FieldSpec

YES_NO = ("yes", "no")


class Hint(Part, Widget):
    """Shows the parts of a hint for which there is room, each whole."""

    def __init__(self, parts: Sequence[str]) -> None:
        """Show these parts."""
        super().__init__(classes="field-hint")
        self._parts = tuple(parts)

    def show(self, *parts: str) -> None:
        """Show other parts, unless they are the same."""
        if parts != self._parts:
            self._parts = parts
            self.refresh()

    def render(self) -> Text:
        """Return what fits into the width."""
        return Text(entry.fitting(self._parts, self.content_size.width), no_wrap=True, overflow="ellipsis")


class FieldRow(Part, Vertical):
    """Draws one parameter of a command."""

    class Changed(Message):
        """Something else stands in the field."""

    class Onward(Message):
        """Enter was pressed in the field: the next one shall have the cursor."""

        def __init__(self, row: FieldRow) -> None:
            """Carry the row."""
            super().__init__()
            self.row = row

    def __init__(self, spec: FieldSpec, readings: Mapping[str, float]) -> None:
        """Draw `spec`, with what the robot reads now."""
        super().__init__(classes="field")
        self.spec = spec
        self._first = self._shown = entry.first_text(spec, readings)
        self._readings = readings
        self._touched = False

    @property
    def _options(self) -> tuple[str, ...]:
        return YES_NO if self.spec.type == "bool" else self.spec.choices

    def compose(self) -> ComposeResult:
        """Name, entry, hint; below them room for a complaint."""
        with Horizontal():
            yield Label(self.spec.name, classes="field-name", markup=False)
            if self._options:
                chosen = self._first if self._first in self._options else None
                yield Choice([(option, option) for option in self._options], chosen=chosen, classes="entry")
            else:
                yield Input(self._first, compact=True, classes="entry", select_on_focus=True)
            yield Hint(entry.hints(self.spec, self._readings))
        if self.spec.doc:
            yield Label(wording.summary(self.spec.doc), classes="field-doc", markup=False)
        complaint = Label("", classes="field-complaint", markup=False)
        complaint.display = False
        yield complaint

    @property
    def text(self) -> str:
        """What stands in the field."""
        if self._options:
            return self.query_one(Choice).chosen
        return self.query_one(Input).value

    @property
    def touched(self) -> bool:
        """Whether a person typed something into it, also when the message about it has not come yet."""
        return self._touched or (not self._options and self.query_one(Input).value != self._shown)

    def focus_entry(self) -> None:
        """Put the cursor into the field."""
        self.query_one(".entry").focus()

    def tell_readings(self, readings: Mapping[str, float]) -> None:
        """Show the value now; a field that nobody touched takes it over."""
        self._readings = readings
        touched = ["typed"] if self.touched else []
        self.query_one(Hint).show(*touched, *entry.hints(self.spec, readings))
        if not self._options and not self.touched and entry.follows(self.spec, readings):
            self._take(entry.first_text(self.spec, readings))

    def become(self, spec: FieldSpec) -> None:
        """Be a field with another default; what a person has typed stays."""
        self.spec = spec
        if not self._options:
            self.tell_readings(self._readings)
            if not self.touched:
                self._take(entry.first_text(spec, self._readings))
        else:
            self.query_one(Choice).value = entry.first_text(spec, self._readings)

    def _take(self, text: str) -> None:
        line, self._shown = self.query_one(Input), text
        if text == line.value:
            return
        line.value = text
        if line.has_focus:
            line.select_all()  # what is typed replaces it, as when the cursor came
        self.complain("")
        self.post_message(self.Changed())

    def follow(self) -> None:
        """Follow the robot again, or go back to the default."""
        if not self._options:
            self._touch(False)
            self._take(entry.first_text(self.spec, self._readings))
            self.tell_readings(self._readings)

    def type_text(self, text: str) -> None:
        """Put a text into the field as if a person had typed it."""
        if not self._options:
            self.query_one(Input).value = text

    def _touch(self, touched: bool) -> None:  # noqa: FBT001 # a setter
        """Mark a field in which a person typed: it follows the robot no more."""
        self._touched = touched
        self.set_class(touched, "-touched")
        self.query_one(".field-name", Label).update(f"{self.spec.name} *" if touched else self.spec.name)

    def complain(self, reason: str) -> None:
        """Show why the field is refused; empty: nothing is wrong."""
        label = self.query_one(".field-complaint", Label)
        label.update(reason and f"✗ {reason}")
        label.display = bool(reason)
        self.set_class(bool(reason), "-wrong")

    @on(Input.Changed)
    def _changed(self) -> None:
        if not self.touched:
            return  # it was put there for the person
        self._touch(True)
        self.complain("")
        self.tell_readings(self._readings)
        self.post_message(self.Changed())

    @on(Choice.Changed)
    def _chosen(self) -> None:
        self.complain("")
        self.post_message(self.Changed())

    @on(Input.Blurred)
    def _left(self) -> None:
        if self.touched:
            self.complain(entry.complaint(self.spec, self.text))

    @on(Input.Submitted)
    def _submitted(self, event: Input.Submitted) -> None:
        event.stop()
        self.post_message(self.Onward(self))
