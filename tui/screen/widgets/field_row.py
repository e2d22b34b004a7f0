"""One field of a form: name, entry or choice, what it takes; what is wrong with it stands below."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.message import Message
from textual.widget import Widget
from textual.widgets import Input, Label, Select

from robotree.tui.screen import entry
from robotree.tui.screen.part import Part
from robotree.tui.seen import wording
from robotree.vr.base.description import CommandSpec, FieldSpec


class Choice(Select[str]):
    """A compact list that drops down. Its options are plain words, never markup."""

    def __init__(
        self,
        words: Iterable[tuple[str, str]],
        *,
        chosen: str | None = None,
        prompt: str = "choose",
        id: str | None = None,  # noqa: A002 # Textual's name for it
        classes: str | None = None,
    ) -> None:
        """Offer pairs of what is shown and what it means; with `chosen` one is chosen, and always will be."""
        value = Select.NULL if chosen is None else chosen
        options = [(Text(shown), meant) for shown, meant in words]
        blank = chosen is None
        self._first = chosen or ""
        super().__init__(
            options, value=value, allow_blank=blank, prompt=prompt, compact=True, id=id, classes=classes
        )

    @property
    def chosen(self) -> str:
        """The choice, also before it is on the screen; empty: none."""
        return self.value if isinstance(self.value, str) else self._first

    def choose(self, word: str) -> None:
        """Choose a word, or nothing where that is allowed; what is not offered changes nothing."""
        value = word or Select.NULL
        if value in self._legal_values:
            self.value = value

    def offer(self, words: Iterable[tuple[str, str]]) -> None:
        """Offer other words; nothing is chosen then."""
        self.set_options([(Text(shown), meant) for shown, meant in words])


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
        self._readings = readings
        self._entry = _entry(spec, entry.first_text(spec, readings))
        self._shown = self.text
        """The text that the program put into the field; any other is a person's."""
        self._touched = False

    def compose(self) -> ComposeResult:
        """Name, entry, hint; below them room for a complaint."""
        with Horizontal():
            yield Label(self.spec.name, classes="field-name", markup=False)
            yield self._entry
            yield Hint(entry.hints(self.spec, self._readings))
        if self.spec.doc:
            yield Label(wording.summary(self.spec.doc), classes="field-doc", markup=False)
        complaint = Label("", classes="field-complaint", markup=False)
        complaint.display = False
        yield complaint

    @property
    def text(self) -> str:
        """The text in the field."""
        return self._entry.chosen if isinstance(self._entry, Choice) else self._entry.value

    @property
    def touched(self) -> bool:
        """Whether a person typed or chose something, also when the message about it has not come yet."""
        return self._touched or self.text != self._shown

    def focus_entry(self) -> None:
        """Put the cursor into the field."""
        self._entry.focus()

    def tell_readings(self, readings: Mapping[str, float]) -> None:
        """Show the value now; a field that nobody touched takes it over."""
        self._readings = readings
        word = "chosen" if isinstance(self._entry, Choice) else "typed"
        touched = [word] if self.touched else []
        self.query_one(Hint).show(*touched, *entry.hints(self.spec, readings))
        if not self.touched and entry.follows(self.spec, readings):
            self._take(entry.first_text(self.spec, readings))

    def become(self, spec: FieldSpec) -> None:
        """Be a field with another default; what a person has typed or chosen stays."""
        self.spec = spec
        self.tell_readings(self._readings)
        if not self.touched:
            self._take(entry.first_text(spec, self._readings))

    def _take(self, text: str) -> None:
        before = self.text
        self.type_text(text)
        self._shown = self.text
        if self._shown == before:
            return
        if isinstance(self._entry, Input) and self._entry.has_focus:
            self._entry.select_all()  # what is typed replaces it, as when the cursor came
        self.complain("")
        self.post_message(self.Changed())

    def follow(self) -> None:
        """Follow the robot again, or go back to the default."""
        self._take(entry.first_text(self.spec, self._readings))
        self._touch(False)
        self.tell_readings(self._readings)

    def type_text(self, text: str) -> None:
        """Put a text into the field as if a person had typed or chosen it."""
        if isinstance(self._entry, Choice):
            self._entry.choose(text)
        else:
            self._entry.value = text

    def _touch(self, touched: bool) -> None:  # noqa: FBT001 # a setter
        """Mark a field that a person has changed: it follows the robot no more."""
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
    @on(Choice.Changed)
    def _changed(self) -> None:
        if not self.touched:
            return  # it was put there for the person
        self._touch(True)
        self.complain("")
        self.tell_readings(self._readings)
        self.post_message(self.Changed())

    @on(Input.Blurred)
    def _left(self) -> None:
        if self.touched:
            self.complain(entry.complaint(self.spec, self.text))

    @on(Input.Submitted)
    def _submitted(self, event: Input.Submitted) -> None:
        event.stop()
        self.post_message(self.Onward(self))


def filled_in(spec: CommandSpec, rows: Iterable[FieldRow]) -> dict[str, Any] | None:
    """Return the arguments that stand in the fields of a form; None: some are wrong, and say why."""
    by_name = {row.spec.name: row for row in rows}
    read = entry.read(spec, {name: row.text for name, row in by_name.items()})
    for name, row in by_name.items():
        row.complain(read.complaints.get(name, ""))
    if read.complaints:
        by_name[next(iter(read.complaints))].focus_entry()
        return None
    return dict(read.arguments)


def _entry(spec: FieldSpec, text: str) -> Choice | Input:
    """Return what a person types or chooses a value of `spec` in; it begins with `text`."""
    options = YES_NO if spec.type == "bool" else spec.choices
    if not options:
        return Input(text, compact=True, classes="entry", select_on_focus=True)
    chosen = text if text in options else None
    return Choice([(option, option) for option in options], chosen=chosen, classes="entry")
