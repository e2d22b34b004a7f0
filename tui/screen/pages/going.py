"""Sending a robot to a point, after it has said which way it would take; and giving a point a name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.timer import Timer
from textual.widgets import Button, Input, Label, Static

from robotree.tui.errors import SupervisorError
from robotree.tui.line.going import Trip, coordinates, lifetime
from robotree.tui.line.grammar import Line, Value
from robotree.tui.processes.place_files import (
    COORDINATES,
    coordinate_in_words,
    coordinate_unit,
    coordinates_in_words,
)
from robotree.tui.screen.pages.dialogs import Modal
from robotree.tui.screen.widgets.cached_text import CachedText
from robotree.tui.screen.widgets.marks import tint
from robotree.vr.base.address import check_name
from robotree.vr.base.errors import BadName
from robotree.vr.base.readable import with_unit

if TYPE_CHECKING:
    from robotree.vr.base.description import RobotDescription

REST = 0.3
"""[s] that nobody types before the robot is asked."""
LOOK = 0.1
"""[s] between two looks for its answer."""
AGAIN = 2.0
"""[s] before it is asked again: a stop, or somebody else, may have come or gone."""


class GoDialog(Modal[Line]):
    """Where a robot is to go, and what it says of that. The harmless answer has the focus."""

    def __init__(self, robot: RobotDescription, trip: Trip, frame: str) -> None:
        """Offer a trip; `frame` is that of its coordinates."""
        super().__init__()
        self._robot, self._trip, self._frame = robot, trip, frame
        self._rest: Timer | None = None
        self._complaint = ""

    def box(self) -> ComposeResult:
        """A field for each coordinate, and the answer of the robot."""
        with Vertical(classes="dialog going"):
            yield Static(f"Send {self._trip.robot} there?", classes="dialog-title", markup=False)
            for name, value in self._trip.goal.items():
                with Horizontal(classes="field-row"):
                    yield Label(name, classes="field-name", markup=False)
                    text = coordinate_in_words(name, value)
                    yield Input(text, id=f"at-{name}", classes="entry", compact=True)
                    yield Label(coordinate_unit(name), classes="field-hint", markup=False)
            yield CachedText(id="going-way")
            with Horizontal(classes="buttons"):
                yield Button("Cancel", id="no", compact=True)
                yield Button("Go there", id="yes", variant="primary", compact=True)

    def on_mount(self) -> None:
        """Ask the robot at once, and again and again."""
        self.query_one("#no", Button).focus()
        self._ask()
        self.set_interval(LOOK, self.guarded(self._look))
        self.set_interval(AGAIN, self.guarded(self._ask))

    @property
    def _typed(self) -> dict[str, str]:
        texts = {name: self.query_one(f"#at-{name}", Input).value.strip() for name in self._trip.goal}
        return {name: with_unit(text, COORDINATES[name]) for name, text in texts.items()}

    def _ask(self) -> None:
        try:
            at = coordinates(f"{name}={text}" for name, text in self._typed.items())
        except SupervisorError as error:
            self._complaint = str(error)
        else:
            self._complaint = ""
            self.app.foresee(self._robot, at, self._frame)
        self._look()

    def _look(self) -> None:
        newest = self.app.foresight.newest
        refusal = self._complaint or ("" if newest is None else newest.refusal)
        words = self._complaint or ("" if newest is None else newest.words)
        if newest is None or newest.answered or self._complaint:  # else the one before stays
            tone = tint(self.app, "error" if refusal else "success")
            self.query_one("#going-way", CachedText).show(Text(words, tone))
            self.query_one("#yes", Button).disabled = bool(refusal)

    @on(Input.Changed)
    def _changed(self) -> None:
        if self._rest is not None:
            self._rest.stop()
        self._rest = self.set_timer(REST, self.guarded(self._ask))

    @on(Input.Submitted)
    def _on(self) -> None:
        self.focus_next()

    @on(Button.Pressed, "#yes")
    def _go(self) -> None:
        texts = tuple(f"{name}={text}" for name, text in self._typed.items())
        self.dismiss(Line("go", {"ROBOT": self._trip.robot, "PLACE|COORDINATE=VALUE": texts}))


class NameDialog(Modal[Line]):
    """Gives a point a name."""

    def __init__(self, robot: str, at: Mapping[str, float] | None, frame: str) -> None:
        """Name a point in the frame of a robot, `frame`; None: where the robot is."""
        super().__init__()
        self._robot, self._at, self._frame = robot, at, frame

    def box(self) -> ComposeResult:
        """One field."""
        where = f"where {self._robot} is" if self._at is None else coordinates_in_words(self._at)
        with Vertical(classes="dialog"):
            yield Static(f"Name for {where}", classes="dialog-title", markup=False)
            yield Input(id="place-name", placeholder="shelf: then @shelf means this point", compact=True)
            yield Static(lifetime(self._frame), classes="dialog-text", markup=False)
            yield CachedText(id="place-refused")
            with Horizontal(classes="buttons"):
                yield Button("Cancel", id="no", compact=True)
                yield Button("Keep", id="yes", variant="primary", compact=True)

    def on_mount(self) -> None:
        """Let it be typed."""
        self.query_one(Input).focus()

    @on(Input.Submitted)
    @on(Button.Pressed, "#yes")
    def _keep(self) -> None:
        name = self.query_one(Input).value.strip().removeprefix("@")
        if not name:
            return
        try:
            check_name(name)
        except BadName as error:
            self.query_one("#place-refused", CachedText).show(Text(str(error), tint(self.app, "error")))
            return
        texts = tuple(f"{axis}={value:.4f}" for axis, value in (self._at or {}).items())
        values: dict[str, Value] = {"NEW": name, "ROBOT": self._robot}
        if texts:
            values["COORDINATE=VALUE"] = texts
        self.dismiss(Line("places add", values))
