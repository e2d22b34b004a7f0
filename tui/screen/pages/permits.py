"""What waits for the answer of a person: questions of robots, and calls of assistants, which are listed."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.widgets import Button, Input, Static

from robotree.files import read
from robotree.tui.line.permits import permit_portrait, permits_of, refusal
from robotree.tui.screen.pages.dialogs import LOOK, Answer, Modal, Question
from robotree.tui.screen.widgets.cameras import PictureView
from robotree.tui.screen.widgets.marks import tint
from robotree.tui.screen.widgets.row_list import Row, RowList
from robotree.tui.seen.asked import AskedQuestion, questions_of
from robotree.vr.base.requests import Picture

if TYPE_CHECKING:
    from robotree.tui.screen.operator_app import OperatorApp
    from robotree.vr.base.permit import Permit

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


LARGEST = 1 << 20
"""[B] of a picture."""
RATE = 1.0
"""[Hz] of looks at the file of the picture, which does not change."""


def ask_about_permit(app: OperatorApp, permit: Permit) -> None:
    """Ask the person whether an assistant may have this carried out; no answer leaves it waiting."""
    app.ask(PermitDialog(app, permit), lambda verdict: app.do(f"permit {verdict}", PERMIT=permit.id))


class PermitsPage(Modal[None]):
    """A list of calls that wait; choosing one asks about it."""

    def box(self) -> ComposeResult:
        """The list."""
        with Vertical(classes="dialog reading") as box:
            box.border_title = "permits"
            yield RowList(id="permits-list")
            yield Static("", id="permits-note", markup=False)

    def on_mount(self) -> None:
        """Look now and then."""
        self.query_one(RowList).focus()
        self._look()
        self.set_interval(LOOK, self.guarded(self._look))

    def _look(self) -> None:
        waiting = self.app.store.permits
        self.query_one(RowList).fill(Row(each, self._row(each)) for each in waiting)
        self.query_one("#permits-note", Static).update("" if waiting else "no permit waits for an answer")

    def _row(self, permit: Permit) -> Text:
        return Text.assemble(
            (f"{permit.id}  ", tint(self.app, "muted")),
            (f"{permit.call}  ", "bold"),
            (f"{permit.assistant}  ", tint(self.app, "warning")),
            f"«{permit.why}»",
        )

    @on(RowList.OptionSelected)
    def _chosen(self, event: RowList.OptionSelected) -> None:
        for permit in self.app.store.permits:
            if permit == event.key:
                ask_about_permit(self.app, permit)


class PermitDialog(Question):
    """Asks about one call."""

    def __init__(self, app: OperatorApp, permit: Permit) -> None:
        """Ask about this permit; where this screen or person can allow nothing, it can be denied."""
        self._permit, self._refused = permit, refusal(app.realm_client, permit)
        allow = [Answer("Allow it once", "allow", "warning")]
        super().__init__(
            f"May {permit.assistant} do this, once?",
            "\n".join(permit_portrait(permit, time.time())),
            *([] if app.readonly or self._refused is not None else allow),
            Answer("Deny it", "deny", "error"),
            outlived=lambda: (
                ""
                if any(each.id == permit.id for each in app.store.permits)
                else f"{permit.call} waits for no answer any more"
            ),
        )

    def body(self) -> ComposeResult:
        """Who wants what and why, what it would do, and the last picture."""
        with VerticalScroll():
            yield Static(self._text, markup=False)
            if self._refused is not None:
                yield Static(Text(f"✗ {self._refused}", tint(self.app, "error")))
            if self._permit.picture:
                yield PictureView(id="permit-picture", rate=RATE)

    def on_mount(self) -> None:
        """Fetch the picture."""
        for view in self.query(PictureView):
            view.show(self._fetch, "the picture is read …")

    async def _fetch(self, width: int, height: int) -> Picture:
        path = permits_of(self.app.realm_client).folder / self._permit.picture
        jpeg = await asyncio.to_thread(read, path, LARGEST)
        return Picture(jpeg=jpeg, width=width, height=height, camera="")
