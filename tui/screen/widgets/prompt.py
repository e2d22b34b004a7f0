"""The line at the bottom for `:` verbs and `/` letters, with completion from the registry and the realm."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar, Literal

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical
from textual.message import Message
from textual.suggester import Suggester
from textual.widgets import Input, Label

from robotree.tui.line import completion
from robotree.tui.screen.key_guard import Apart
from robotree.tui.screen.part import Part
from robotree.tui.screen.widgets.cached_text import CachedText
from robotree.tui.screen.widgets.marks import tint

Kind = Literal["verb", "filter"]
SIGNS: dict[Kind, str] = {"verb": ":", "filter": "/"}
REMEMBERED = 100
NONE_YET = -1
"""Position among the candidates before Tab was pressed."""
BEFORE = 3
"""Candidates that stay in sight before the one that Tab has come to."""


class VerbSuggester(Suggester):
    """Suggests the rest of a line."""

    def __init__(self, words: Callable[[], completion.Words]) -> None:
        """Take the names of the moment from `words`."""
        super().__init__(use_cache=False, case_sensitive=True)
        self._words = words

    async def get_suggestion(self, value: str) -> str | None:
        """Return the line with its last word completed, or None."""
        return completion.complete(value, self._words())


class Prompt(Apart, Part, Vertical):
    """One line of input, and above it what the last word may become; hidden while nobody types."""

    LINE: ClassVar[str] = "line"
    """Id of the field that one types in."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape", "leave", "Leave"),
        Binding("up", "recall(-1)", "Before", show=False),
        Binding("down", "recall(1)", "After", show=False),
        Binding("tab", "complete(1)", "Complete", priority=True),
        Binding("shift+tab", "complete(-1)", "Complete", show=False, priority=True),
    ]

    class Entered(Message):
        """A verb was typed."""

        def __init__(self, text: str) -> None:
            """Carry the line."""
            super().__init__()
            self.text = text

    class Filtered(Message):
        """Other letters shall be filtered by."""

    class Left(Message):
        """The prompt was left."""

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 # Textual's name for it
        """Begin closed."""
        super().__init__(id=id)
        self.display = False
        self._suggester = VerbSuggester(self.app.words)
        self._read = ""
        """The line for which the candidates were found."""
        self._stem = ""
        """The text typed before Tab began to go through the candidates."""
        self._offered: tuple[str, ...] = ()
        self._taken = NONE_YET
        self.kind: Kind = "verb"
        self._at = 0
        self.letters = ""

    def compose(self) -> ComposeResult:
        """Candidates; a sign and an input."""
        yield CachedText(id="candidates")
        with Horizontal():
            yield Label(":", id="sign", markup=False)
            line = Input(compact=True, id=self.LINE, suggester=self._suggester, select_on_focus=False)
            line.can_focus = False  # a page gives the focus to the first part that can have it, hidden or not
            yield line

    def open(self, kind: Kind, text: str = "") -> None:
        """Begin to type a verb, or letters to filter by."""
        self.query_one("#sign", Label).update(SIGNS[kind], layout=False)  # each sign is one cell
        self.kind = kind
        line = self.query_one(Input)
        line.suggester = self._suggester if kind == "verb" else None
        line.value = self.letters if kind == "filter" and not text else text
        line.cursor_position = len(line.value)
        self._at = len(self.app.past)
        self._offer(line.value)
        self.display = line.can_focus = True
        line.focus()

    @on(Input.Submitted)
    def _submitted(self, event: Input.Submitted) -> None:
        event.stop()
        if not self.display:
            return  # it was sent already
        text = event.value.strip()
        if self.kind == "filter":
            self._filter(event.value)
        self._close()
        if self.kind == "verb" and text:
            past = self.app.past
            past[:] = [*[one for one in past if one != text], text][-REMEMBERED:]
            self.post_message(self.Entered(text))

    @on(Input.Changed)
    def _changed(self, event: Input.Changed) -> None:
        event.stop()
        text = self.query_one(Input).value
        if self.display and self.kind == "filter" and text != self.letters:
            self._filter(text)
        if text != self._read:
            self._offer(text)

    def _filter(self, letters: str) -> None:
        self.letters = letters
        self.post_message(self.Filtered())

    def action_leave(self) -> None:
        """Leave; a filter is taken away."""
        if self.kind == "filter":
            self._filter("")
        self._close()

    def action_recall(self, by: int) -> None:
        """Bring back an earlier line."""
        past = self.app.past
        if self.kind == "verb" and past:
            self._at = min(max(self._at + by, 0), len(past))
            line = self.query_one(Input)
            line.value = past[self._at] if self._at < len(past) else ""
            line.cursor_position = len(line.value)

    def action_complete(self, by: int) -> None:
        """Complete as far as there is no choice; then go through the candidates."""
        line = self.query_one(Input)
        if line.value != self._read:
            self._offer(line.value)
        whole = completion.complete(line.value, self.app.words()) if self._taken == NONE_YET else None
        if self.kind != "verb" or not (whole or self._offered):
            return
        if whole:
            line.value = whole  # what is offered changes with it
        else:
            first = 0 if by > 0 else -1
            self._taken = first if self._taken == NONE_YET else self._taken + by
            self._taken %= len(self._offered)
            self._read = line.value = self._stem + self._offered[self._taken]
            self._draw_candidates()
        line.cursor_position = len(line.value)

    def _offer(self, text: str) -> None:
        """Show what the last word may become."""
        self._read = text
        self._stem = text[: text.rfind(" ") + 1]
        self._offered = completion.candidates(text, self.app.words()) if self.kind == "verb" else ()
        self._taken = NONE_YET
        self._draw_candidates()

    def _draw_candidates(self) -> None:
        shown, muted = self.query_one("#candidates", CachedText), tint(self.app, "muted")
        shown.display = len(self._offered) > 1
        text = Text(" ", no_wrap=True, overflow="ellipsis")
        chosen = tint(self.app, "primary", bold=True)
        for position in range(max(self._taken - BEFORE, 0), len(self._offered)):
            text.append(f" {self._offered[position]} ", chosen if position == self._taken else muted)
        shown.show(text)

    def _close(self) -> None:
        self.display = self.query_one(Input).can_focus = False
        self.post_message(self.Left())
