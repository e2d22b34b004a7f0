"""The calls of assistants that wait for a person: a list, and the question about one of them."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING, ClassVar, Literal

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.widgets import Button, OptionList, Static
from textual.widgets.option_list import Option

from robotree.files import read
from robotree.tui.line.grammar import Line
from robotree.tui.line.permits import permit_portrait, permits_of, refusal
from robotree.tui.screen.pages.dialogs import LOOK, Modal
from robotree.tui.screen.widgets.marks import tint
from robotree.tui.screen.widgets.picture import PictureView
from robotree.vr.base.requests import Picture

if TYPE_CHECKING:
    from robotree.tui.screen.operator_app import OperatorApp
    from robotree.vr.base.permit import Permit

LARGEST = 1 << 20
"""[B] of a picture."""
RATE = 1.0
"""[Hz] of looks at the file of the picture, which does not change."""

Verdict = Literal["allow", "deny"]


def ask_about_permit(app: OperatorApp, permit: Permit) -> None:
    """Ask the person whether an assistant may have this carried out; no answer leaves it waiting."""

    def answered(verdict: Verdict | None) -> None:
        if verdict:
            app.perform(Line(f"permit {verdict}", {"PERMIT": permit.id}))

    app.push_screen(PermitDialog(permit, readonly=app.readonly), answered)


class PermitsPage(Modal[None]):
    """A list of calls that wait; choosing one asks about it."""

    def __init__(self) -> None:
        """Nothing is drawn yet."""
        super().__init__()
        self._shown: tuple[Permit, ...] | None = None

    def box(self) -> ComposeResult:
        """The list."""
        with Vertical(classes="dialog reading") as box:
            box.border_title = "permits"
            yield OptionList(id="permits-list", markup=False)
            yield Static("", id="permits-note", markup=False)

    def on_mount(self) -> None:
        """Look now and then."""
        self.query_one(OptionList).focus()
        self._look()
        self.set_interval(LOOK, self.guarded(self._look))

    def _look(self) -> None:
        waiting = self.app.store.permits
        if waiting == self._shown:
            return
        choices, before = self.query_one(OptionList), self._shown or ()
        at = before[choices.highlighted].id if before and choices.highlighted is not None else ""
        self._shown = waiting
        choices.clear_options()
        choices.add_options([Option(self._row(each), id=each.id) for each in waiting])
        ids = [each.id for each in waiting]
        choices.highlighted = ids.index(at) if at in ids else 0 if ids else None
        self.query_one("#permits-note", Static).update("" if waiting else "no permit waits for an answer")

    def _row(self, permit: Permit) -> Text:
        return Text.assemble(
            (f"{permit.id}  ", tint(self.app, "muted")),
            (f"{permit.call}  ", "bold"),
            (f"{permit.assistant}  ", tint(self.app, "warning")),
            f"«{permit.why}»",
        )

    @on(OptionList.OptionSelected)
    def _chosen(self, event: OptionList.OptionSelected) -> None:
        permit = next((each for each in self._shown or () if each.id == event.option.id), None)
        if permit is not None:
            ask_about_permit(self.app, permit)


class PermitDialog(Modal[Verdict]):
    """Asks about one call. The harmless answer comes first and has the focus."""

    def __init__(self, permit: Permit, *, readonly: bool) -> None:
        """Take the permit; `readonly`: this screen allows nothing."""
        super().__init__()
        self._permit, self._readonly = permit, readonly

    def box(self) -> ComposeResult:
        """Who wants what and why, what it would do, the last picture, and the answers."""
        permit, refused = self._permit, refusal(self.app.realm_client, self._permit)
        with Vertical(classes="dialog reading"):
            yield Static(f"May {permit.assistant} do this, once?", classes="dialog-title", markup=False)
            with VerticalScroll():
                yield Static("\n".join(permit_portrait(permit, time.time())), markup=False)
                if refused is not None:
                    yield Static(Text(f"✗ {refused}", tint(self.app, "error")))
                if permit.picture:
                    yield PictureView(id="permit-picture", rate=RATE)
            with Horizontal(classes="buttons"):
                yield Button("Cancel", id="close", compact=True)
                if not (self._readonly or refused is not None):
                    yield Button("Allow it once", id="allow", variant="warning", compact=True)
                yield Button("Deny it", id="deny", variant="error", compact=True)

    def on_mount(self) -> None:
        """Focus the harmless answer, and fetch the picture."""
        self.query_one("#close", Button).focus()
        self.set_interval(LOOK, self.guarded(self._look))
        for view in self.query(PictureView):
            view.show(self._fetch, "the picture is read …")

    async def _fetch(self, width: int, height: int) -> Picture:
        path = permits_of(self.app.realm_client).folder / self._permit.picture
        jpeg = await asyncio.to_thread(read, path, LARGEST)
        return Picture(jpeg=jpeg, width=width, height=height, camera="")

    def _look(self) -> None:
        """Close when it was answered elsewhere, taken back, or has expired."""
        if self.is_current and all(each.id != self._permit.id for each in self.app.store.permits):
            self.app.tell(f"{self._permit.call} waits for no answer any more")
            self.dismiss(None)
            self.app.opened_by_itself(self.app.screen, typed=False)

    _ANSWERS: ClassVar[dict[str | None, Verdict]] = {"allow": "allow", "deny": "deny"}

    @on(Button.Pressed)
    def _pressed(self, event: Button.Pressed) -> None:
        self.dismiss(self._ANSWERS.get(event.button.id))
