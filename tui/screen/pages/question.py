"""A question that a robot asks a person: its answers as buttons, or a field for a text."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.widgets import Button, Input, Static

from robotree.tui.screen.pages.dialogs import Question
from robotree.tui.seen.asked import AskedQuestion, questions_of

if TYPE_CHECKING:
    from robotree.tui.screen.operator_app import OperatorApp

DOUBT = {"done": "It is done", "again": "Again", "abort": "End it"}
"""The answers of a robot that was killed in the middle of a command, for people."""


def ask_question(app: OperatorApp, question: AskedQuestion) -> None:
    """Ask the person at this screen; no answer leaves the question waiting."""
    values = {"--question": question.id} if question.id else {}
    app.ask(
        QuestionDialog(app, question),
        lambda answer: app.do("decide", NAME=question.robot, ANSWER=answer, **values),
    )


class QuestionDialog(Question):
    """One question, with its answers below each other, for they may be long."""

    def __init__(self, app: OperatorApp, asked: AskedQuestion) -> None:
        """Take the question; where one may only look it cannot be answered."""
        super().__init__(asked.text, "", outlived=self._answered)
        self._asked, self._readonly = asked, app.readonly

    def box(self) -> ComposeResult:
        """The question, and the answers."""
        asked = self._asked
        with VerticalScroll(classes="dialog"):
            yield Static(asked.text, classes="dialog-title", markup=False)
            yield Static(f"{asked.robot} asks", markup=False)
            with Vertical(classes="answers"):
                yield Button("Later" if asked.id else "I do not know", id="no", compact=True)
                if not self._readonly:
                    for answer in asked.answers:
                        word = answer if asked.id else DOUBT.get(answer, answer)
                        ends = not asked.id and answer == "abort"
                        yield Button(
                            Text(word), name=answer, variant="error" if ends else "primary", compact=True
                        )
            if not (asked.answers or self._readonly):
                with Horizontal():
                    yield Input(placeholder="your answer, then enter", id="said", compact=True)

    def on_mount(self) -> None:
        """Focus the field as soon as it is there."""
        for field in self.query(Input):
            self.call_after_refresh(field.focus)

    def _answered(self) -> str:
        """Say so when somebody else has answered it, or its script has ended."""
        name, store = self._asked.robot, self.app.store
        robot = store.described(name)  # one that is slow to describe itself still asks
        asked = robot is None or any(each.id == self._asked.id for each in questions_of(robot))
        return "" if asked and name in store.known else f"{name} asks that no more"

    @on(Input.Submitted)
    def _said(self, event: Input.Submitted) -> None:
        if event.value.strip():
            self.dismiss(event.value.strip())
