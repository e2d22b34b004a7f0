"""What a panel is written with: `NAME.panel.py` beside the page `NAME.py` has one class of this base.

    from textual.widgets import Button
    from robotree.tui.panels.author import RobotPanel

    class Waving(RobotPanel):
        TITLE = "Waving"

        def compose(self):
            yield Button("wave", id="wave")

        def on_button_pressed(self):
            self.ask("wave", times=3)

It runs in a process of its own, which reaches nothing but its region of the screen: see docs/panels.md.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from typing import Any, ClassVar

from textual.containers import Vertical

from robotree.vr.base.description import RobotDescription
from robotree.vr.base.errors import VrError


class Refused(VrError):
    """A command for which a panel has asked was not carried out."""

    sentence = "{reason}"


class RobotPanel(Vertical):
    """A panel of one robot: any Textual widgets, and these few things of the robot."""

    TITLE: ClassVar[str] = ""
    DEFAULT_CSS = "RobotPanel { width: 1fr; height: 1fr; }"

    def __init__(
        self, robot: RobotDescription, call: Callable[[str, Mapping[str, Any]], Awaitable[Any]]
    ) -> None:
        """Made by the process of the panel."""
        super().__init__()
        self.robot = robot
        """As it describes itself: its name, its commands with their parameters."""
        self.readings: Mapping[str, float] = {}
        """What the robot reads, by name."""
        self.units: Mapping[str, str] = {}
        """Units of the readings, by name."""
        self.status = ""
        """How the robot is, in one word."""
        self._call = call

    def see(self) -> None:
        """Called when `readings`, `units` or `status` have changed. Yours to write."""

    def refused(self, reason: str) -> None:
        """Called when a command of `ask` was not carried out. Yours to write; by itself it says so."""
        self.notify(reason, severity="error")

    async def call(self, command: str, **arguments: Any) -> Any:
        """Have a command of the robot carried out, and return its result.

        A panel may do so after a person has pressed a key or clicked in it, and not by itself.

        Raises:
            Refused: it was not carried out; says why.
        """
        return await self._call(command, arguments)

    def ask(self, command: str, **arguments: Any) -> None:
        """Have a command carried out in the background; `refused` says why not."""

        async def carry_out() -> None:
            try:
                await self.call(command, **arguments)
            except Refused as error:
                self.refused(str(error))

        self.run_worker(carry_out(), exit_on_error=False)
