"""The calls of assistants that wait for a person: a list, and the question about one of them."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.containers import Vertical, VerticalScroll
from textual.widgets import Static

from robotree.files import read
from robotree.tui.line.permits import permit_portrait, permits_of, refusal
from robotree.tui.screen.pages.dialogs import LOOK, Answer, Modal, Question
from robotree.tui.screen.widgets.marks import tint
from robotree.tui.screen.widgets.picture import PictureView
from robotree.tui.screen.widgets.row_list import Row, RowList
from robotree.vr.base.requests import Picture

if TYPE_CHECKING:
    from robotree.tui.screen.operator_app import OperatorApp
    from robotree.vr.base.permit import Permit

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
