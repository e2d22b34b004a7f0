"""Small dialogs over a page: to confirm, to read, to choose, to hold a key."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Literal, NamedTuple

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.events import Key
from textual.screen import ModalScreen, ScreenResultType
from textual.widgets import Button, Input, OptionList, Static
from textual.widgets.option_list import Option

from robotree.tui.screen.hanging import containing, hanging
from robotree.tui.screen.part import Leaving, Part
from robotree.tui.screen.widgets.key_line import KeyLine
from robotree.tui.words import say
from robotree.vr.core.machine import ATTENTION
from robotree.vr.exchange.attendance import Attendance

LOW = [(0, "-tight"), (20, "-low"), (32, "-roomy")]
"""Lines below which a question leaves its margins out, so that its answers can be read."""

LOOK = 0.25
"""[s] between two looks whether a question is still one."""


class Modal(Part, ModalScreen[ScreenResultType], Leaving[ScreenResultType]):
    """A box over a page: it dims the page, and has its own keys in the line at the bottom."""

    VERTICAL_BREAKPOINTS = LOW
    KEYS_OF = "question"

    def compose(self) -> ComposeResult:
        """The box and its keys."""
        yield from self.box()
        yield KeyLine()

    def box(self) -> ComposeResult:
        """Yield the box."""
        yield from ()

    def action_other(self) -> None:
        """Go to the other button or list."""
        self.focus_next()

    @on(Button.Pressed, "#no")
    def _decline(self) -> None:
        self.dismiss(None)

    def action_answer(self, _answer: bool) -> None:  # noqa: FBT001 # Textual calls it with a literal
        """Leave without an answer."""
        self.dismiss(None)


class Answer(NamedTuple):
    """A button of a question."""

    word: str
    """What stands on it; unlike `name`, it is translated."""
    name: str
    """What the question answers then."""
    variant: Literal["default", "primary", "warning", "error"] = "default"


class Question(Modal[str]):
    """Asks something. The harmless answer comes first and has the focus; it answers nothing."""

    def __init__(
        self,
        question: str,
        text: str,
        *answers: Answer,
        harmless: str = "Cancel",
        outlived: Callable[[], str] = lambda: "",
    ) -> None:
        """Prepare to ask.

        Args:
            question: the title.
            text: what one must know for it.
            *answers: what can be answered.
            harmless: the label of the button that changes nothing.
            outlived: returns why there is nothing to ask any more; empty: there is. The dialog closes then.
        """
        super().__init__()
        self._question, self._text, self.answers = question, text, answers
        self._harmless, self._outlived = harmless, outlived

    def box(self) -> ComposeResult:
        """Question, text, buttons."""
        with Vertical(classes="dialog"):
            yield Static(self._question, classes="dialog-title", markup=False)
            yield from self.body()
            with Horizontal(classes="buttons"):
                yield Button(Text(say(self._harmless)), id="no", compact=True)
                for word, name, variant in self.answers:
                    yield Button(Text(say(word)), name=name, id=name, variant=variant, compact=True)

    def body(self) -> ComposeResult:
        """Yield what stands between question and buttons."""
        with VerticalScroll():
            yield Static(self._text, markup=False)

    def on_mount(self) -> None:
        """Focus the harmless answer."""
        self.query_one("#no", Button).focus()
        self.set_interval(LOOK, self.guarded(self._look))

    def _look(self) -> None:
        """Close when the question has been answered elsewhere."""
        if self.is_current and (why := self._outlived()):
            self.app.tell(why)
            self.dismiss(None)
            self.app.guard.opened_by_itself(self.app.screen, typed=False)

    @on(Button.Pressed)
    def _pressed(self, event: Button.Pressed) -> None:
        self.dismiss(event.button.name)


class Confirm(Question):
    """Asks before something is taken away."""

    def __init__(
        self, question: str, consequence: str, yes: str, outlived: Callable[[], str] = lambda: ""
    ) -> None:
        """Prepare to ask; `yes` is the word on the button (`Question`)."""
        super().__init__(question, consequence, Answer(yes, "yes", "error"), outlived=outlived)
        self.add_class("-danger")

    def body(self) -> ComposeResult:
        """What would happen."""
        yield Static(self._text, classes="dialog-text", markup=False)


class Broken(Part, Static):
    """Shows a text whose long lines go on below their last column, whole or the lines with some letters."""

    def __init__(self, text: Text) -> None:
        """Show a text; it is no markup."""
        super().__init__(text, markup=False)
        self._text, self._shown = text, text

    def replace(self, text: Text) -> None:
        """Show another text."""
        if text != self._text:
            self._text = self._shown = text
            self.on_resize()

    def search(self, letters: str) -> None:
        """Show only the parts of the text that contain these letters; none: all of it."""
        self._shown = self._text
        if letters.strip():
            self._shown = containing(self._text, letters) or Text("nothing found")
        self.on_resize()

    def on_resize(self) -> None:
        """Break the lines for this width."""
        self.update(hanging(self._shown, self.size.width, self.app.console))


class Reading(Modal[None]):
    """Shows a longer text, as the command line would print it."""

    KEYS_OF = "text"

    def __init__(self, title: str, text: str | Text) -> None:
        """Show `text` under `title`; neither is markup."""
        super().__init__()
        self.heading, self._text = title, Text(text) if isinstance(text, str) else text

    def box(self) -> ComposeResult:
        """Title, text, and the field for a search, which is hidden until somebody searches."""
        with Vertical(classes="dialog reading") as box:
            box.border_title = Text(self.heading)
            with VerticalScroll():
                yield Broken(self._text)
            yield Input(compact=True, id="search", placeholder="letters to search for; esc shows all again")

    def on_mount(self) -> None:
        """Let the arrow keys scroll."""
        self.query_one(Input).display = False
        self.query_one(VerticalScroll).focus()

    def action_search(self) -> None:
        """Begin to type the letters that are searched for."""
        field = self.query_one(Input)
        field.display = True
        field.focus()

    def action_leave(self) -> None:
        """Leave the search, then the text."""
        field = self.query_one(Input)
        if not field.display:
            self.dismiss()
            return
        field.value, field.display = "", False
        self.query_one(VerticalScroll).focus()

    @on(Input.Changed)
    def _search(self, event: Input.Changed) -> None:
        self.query_one(Broken).search(event.value)

    @on(Input.Submitted)
    def _found(self) -> None:
        """Scroll in what was found."""
        self.query_one(VerticalScroll).focus()


class Choosing(Modal[str]):
    """Choose one of several."""

    def __init__(
        self, question: str, choices: Iterable[tuple[str, str]], *, note: str = "", at: str = ""
    ) -> None:
        """Offer pairs of what is chosen and what is said of it; the cursor begins at one of them."""
        super().__init__()
        self._question, self._choices, self._note, self._at = question, list(choices), note, at

    def box(self) -> ComposeResult:
        """A list."""
        with Vertical(classes="dialog reading") as box:
            box.border_title = Text(self._question)
            if self._note:
                yield Static(self._note, classes="dialog-text", markup=False)
            yield OptionList(
                *(Option(Text.assemble((word, "bold"), f"  {about}")) for word, about in self._choices),
                markup=False,
                id="choosing",
            )

    def on_mount(self) -> None:
        """Let the arrows choose."""
        choices, words = self.query_one(OptionList), [word for word, _ in self._choices]
        choices.highlighted = words.index(self._at) if self._at in words else 0
        choices.focus()

    @on(OptionList.OptionSelected)
    def _chosen(self, event: OptionList.OptionSelected) -> None:
        self.dismiss(self._choices[event.option_index][0])


TICK = 0.1
"""[s] between two looks at how long ago the last key was."""
CELLS = 20
"""Width of the bar that runs down."""


class AttendDialog(Modal[None]):
    """In front while a command goes on that wants somebody at a key; each key is passed on to the robot."""

    KEYS_OF = "attend"

    def __init__(self, robot: str, command: str, attendance: Attendance) -> None:
        """Pass the keys on to `attendance`."""
        super().__init__()
        self._robot, self._command, self._attendance = robot, command, attendance
        self._last = 0.0

    def box(self) -> ComposeResult:
        """What to do, and how much time is left."""
        with Vertical(classes="dialog"):
            yield Static(f"{self._robot}.{self._command} goes on", classes="dialog-title", markup=False)
            text = f"Hold any letter. It ends {ATTENTION:g} s after the last one, whatever happens here."
            yield Static(text, classes="dialog-text", markup=False)
            yield Static("", id="attention", markup=False)

    def on_mount(self) -> None:
        """The key that has begun it is the first."""
        self._last = self.app.now()
        self.set_interval(TICK, self.guarded(self._draw))
        self._draw()

    def on_key(self, event: Key) -> None:
        """Pass a key on."""
        event.stop()
        self._last = self.app.now()
        self._attendance.press()

    def action_end(self) -> None:
        """End the command."""
        self.app.do("cancel", NAME=self._robot)

    def _draw(self) -> None:
        left = max(0.0, ATTENTION - (self.app.now() - self._last))
        full = round(left / ATTENTION * CELLS)
        self.query_one("#attention", Static).update(f"{'━' * full}{'╌' * (CELLS - full)} {left:.1f} s")

    def over(self) -> None:
        """The command has ended."""
        if self.is_attached and self.is_current:
            self.dismiss(None)
            self.app.guard.opened_by_itself(self.app.screen, typed=False)
        elif self.is_attached:
            self.remove()
