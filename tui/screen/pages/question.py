"""A question that a script asks a person: its answers as buttons, or a field for a text."""

from __future__ import annotations

from typing import TYPE_CHECKING

from textual import on
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.widgets import Button, Input, Static

from robotree.tui.line.grammar import Line
from robotree.tui.screen.pages.dialogs import LOOK, Modal
from robotree.tui.seen.asked import AskedQuestion, questions_of

if TYPE_CHECKING:
    from robotree.tui.screen.operator_app import OperatorApp


def ask_question(app: OperatorApp, question: AskedQuestion) -> None:
    """Ask the person at this screen; no answer leaves the question waiting."""

    def answered(answer: str | None) -> None:
        if answer:
            app.perform(Line("decide", {"NAME": question.robot, "ANSWER": answer, "--question": question.id}))

    app.push_screen(QuestionDialog(question, readonly=app.readonly), answered)


class QuestionDialog(Modal[str]):
    """One question. No answer comes first and has the focus: a hasty key answers nothing."""

    def __init__(self, question: AskedQuestion, *, readonly: bool) -> None:
        """Take the question; `readonly`: it cannot be answered from here."""
        super().__init__()
        self._question, self._readonly = question, readonly

    def box(self) -> ComposeResult:
        """The question, and the answers below each other: they may be long."""
        asked = self._question
        with VerticalScroll(classes="dialog"):
            yield Static(asked.text, classes="dialog-title", markup=False)
            yield Static(f"{asked.robot} asks", markup=False)
            with Vertical(classes="answers"):
                yield Button("Later", id="close", compact=True)
                if not self._readonly:
                    for number, answer in enumerate(asked.answers):
                        yield Button(answer, id=f"answer-{number}", variant="primary", compact=True)
            if not (asked.answers or self._readonly):
                with Horizontal():
                    yield Input(placeholder="your answer, then enter", id="said", compact=True)

    def on_mount(self) -> None:
        """Focus what answers nothing, or the field as soon as it is there."""
        typed = not (self._question.answers or self._readonly)
        self.call_after_refresh(self._focus, "#said" if typed else "#close")
        self.set_interval(LOOK, self.guarded(self._look))

    def _focus(self, selector: str) -> None:
        for widget in self.query(selector):
            widget.focus()

    def _look(self) -> None:
        """Close when somebody else has answered it, or its script has ended."""
        name, store = self._question.robot, self.app.store
        robot = store.described(name)  # one that is slow to describe itself still asks
        asked = robot is None or any(one.id == self._question.id for one in questions_of(robot))
        if self.is_current and not (asked and name in store.known):
            self.app.tell(f"{self._question.robot} asks that no more")
            self.dismiss("")
            self.app.opened_by_itself(self.app.screen, typed=False)

    @on(Input.Submitted)
    def _said(self, event: Input.Submitted) -> None:
        if event.value.strip():
            self.dismiss(event.value.strip())

    @on(Button.Pressed)
    def _pressed(self, event: Button.Pressed) -> None:
        number = (event.button.id or "").removeprefix("answer-")
        self.dismiss(self._question.answers[int(number)] if number.isdigit() else "")
