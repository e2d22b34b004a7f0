"""Somebody holds a key while a command goes on that wants that: without one for 2 s the robot ends it."""

from __future__ import annotations

from textual.app import ComposeResult
from textual.containers import Vertical
from textual.events import Key
from textual.widgets import Static

from robotree.tui.screen.pages.dialogs import Modal
from robotree.vr.core.machine import ATTENTION
from robotree.vr.exchange.attendance import Attendance

LOOK = 0.1
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
        self.set_interval(LOOK, self.guarded(self._draw))
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
            self.app.opened_by_itself(self.app.screen, typed=False)
        elif self.is_attached:
            self.remove()
