"""The panel of MoveSquare: the square that it is going to drive, drawn to scale; `+` and `-` choose it."""

from typing import ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.widgets import Button, Static

from robotree.tui.panels.author import Refused, RobotPanel

SIDES = (0.1, 0.2, 0.3, 0.5, 0.7, 1.0)
"""[m]"""
FULL = 10
"""[lines] of the largest square; a cell is half as wide as high."""


class SquarePanel(RobotPanel, can_focus=True):
    """Choose a square, and see how it went."""

    TITLE = "Squares"
    BINDINGS: ClassVar = [("plus", "choose(1)", "larger"), ("minus", "choose(-1)", "smaller")]

    def compose(self) -> ComposeResult:
        """The square, and a button below it."""
        yield Static(id="square")
        yield Button("drive", id="drive", compact=True)

    def on_mount(self) -> None:
        """Begin with a small one."""
        self.choice, self.said = 0, "+ and - choose the side"
        self.query_one(Button).focus()
        self.draw()

    def action_choose(self, by: int) -> None:
        """Choose another side."""
        self.choice = min(max(self.choice + by, 0), len(SIDES) - 1)
        self.draw()

    def on_button_pressed(self) -> None:
        """Drive it."""
        self.run_worker(self.drive(SIDES[self.choice]), exit_on_error=False)

    async def drive(self, side: float) -> None:
        """Drive one square, and say how it went."""
        self.said = f"drives {side:g} m"
        self.draw()
        try:
            await self.call("move_square", length=side)
            self.said = f"drove {side:g} m, and is where it began"
        except Refused as error:
            self.said = str(error)
        self.draw()

    def draw(self) -> None:
        """Draw the square."""
        lines = max(round(SIDES[self.choice] / SIDES[-1] * FULL), 2)
        wide = 2 * lines - 2
        square = ["┌" + "─" * wide + "┐", *["│" + " " * wide + "│"] * (lines - 2), "└" + "─" * wide + "┘"]
        self.query_one("#square", Static).update(
            Text("\n".join([*square, f"side {SIDES[self.choice]:g} m", self.said]))
        )
