"""Small dialogs over a page: to confirm, to read."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.screen import ModalScreen
from textual.widgets import Button, Static

from robotree.tui.screen.fence import Fenced
from robotree.tui.screen.leaving import Leaving

LOW = [(0, "-tight"), (20, "-roomy")]
"""Lines below which a question leaves its margins out, so that its answers can be read."""

LOOK = 0.25
"""[s] between two looks whether a question is still one."""


class Confirm(Fenced, ModalScreen[bool], Leaving[bool]):
    """Asks before something is taken away. The harmless answer comes first and has the focus."""

    VERTICAL_BREAKPOINTS = LOW
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,n", "answer(False)", "Cancel"),
        Binding("left,right", "other", "Other button", show=False),
    ]

    def __init__(
        self, question: str, consequence: str, yes: str, outlived: Callable[[], str] = lambda: ""
    ) -> None:
        """Prepare to ask.

        Args:
            question: the title.
            consequence: what would happen.
            yes: the word on the button.
            outlived: tells why there is nothing to ask any more; empty: there is. The dialog closes then.
        """
        super().__init__()
        self._question, self._consequence, self._yes = question, consequence, yes
        self._outlived = outlived

    def compose(self) -> ComposeResult:
        """Question, consequence, buttons."""
        with Vertical(classes="dialog -danger"):
            yield Static(self._question, classes="dialog-title", markup=False)
            yield Static(self._consequence, classes="dialog-text", markup=False)
            with Horizontal(classes="buttons"):
                yield Button("Cancel", id="no", variant="default")
                yield Button(self._yes, id="yes", variant="error")

    def on_mount(self) -> None:
        """Focus the harmless answer."""
        self.query_one("#no", Button).focus()
        self.set_interval(LOOK, self.fenced(self._look))

    def _look(self) -> None:
        """Close when the question has been answered elsewhere."""
        if self.is_current and (why := self._outlived()):
            self.app.tell(why)
            self.dismiss(False)  # the answer
            self.app.comes_unasked(self.app.screen, typed=False)

    def action_other(self) -> None:
        """Go to the other button."""
        self.focus_next()

    def action_answer(self, answer: bool) -> None:  # noqa: FBT001 # Textual calls it with a literal
        """Answer."""
        self.dismiss(answer)

    @on(Button.Pressed)
    def _pressed(self, event: Button.Pressed) -> None:
        self.dismiss(event.button.id == "yes")


class Reading(Fenced, ModalScreen[None], Leaving[None]):
    """Shows a longer text, as the command line would print it."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape,q,enter", "dismiss", "Close")]

    def __init__(self, title: str, text: str | Text) -> None:
        """Show `text` under `title`; neither is markup."""
        super().__init__()
        self._heading, self._text = title, text

    def compose(self) -> ComposeResult:
        """Title and text."""
        with VerticalScroll(classes="dialog reading") as box:
            box.border_title = Text(self._heading)
            yield Static(self._text, markup=False)

    def on_mount(self) -> None:
        """Let the arrow keys scroll."""
        self.query_one(VerticalScroll).focus()
