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

import asyncio
from collections.abc import Mapping
from typing import Any, ClassVar, Protocol

from rich.color import Color
from rich.style import Style
from rich.text import Text
from textual.containers import Vertical
from textual.widgets import Static

from robotree.vr.base.description import RobotDescription
from robotree.vr.base.errors import VrError


class Refused(VrError):
    """A command for which a panel has asked was not carried out."""

    sentence = "{reason}"


class Way(Protocol):
    """The way out of the process."""

    async def carry_out(self, command: str, arguments: Mapping[str, Any]) -> Any:
        """Have a command carried out."""
        ...

    async def look(self, view: str, camera: str, width: int, height: int) -> bytes:
        """Fetch a picture."""
        ...


class PanelCamera(Static):
    """The picture of a camera, as characters; in a `RobotPanel`."""

    DEFAULT_CSS = "PanelCamera { width: 1fr; height: 1fr; }"

    def __init__(self, camera: str, *, period: float = 1.0, id: str | None = None) -> None:  # noqa: A002 # Textual's
        """Look through VIEW.CAMERA every `period` seconds."""
        super().__init__("looking …", id=id)
        self._camera, self._period = camera, period

    def on_mount(self) -> None:
        """Begin to look."""
        self.run_worker(self._keep_looking(), exit_on_error=False)

    async def _keep_looking(self) -> None:
        from robotree.tui.seen.halfblocks import BLOCK, decode

        panel = next(one for one in self.ancestors if isinstance(one, RobotPanel))
        while True:
            columns, rows = self.content_size
            try:
                jpeg = await panel.look(self._camera, max(columns, 1) * 2, max(rows, 1) * 4)
                runs = await asyncio.to_thread(decode, jpeg, max(columns, 1), max(rows, 1))
            except (Refused, OSError) as error:
                self.update(Text(str(error)))
            else:
                lines = (
                    Text.assemble(*((BLOCK * many, _style(upper, lower)) for many, upper, lower in row))
                    for row in runs
                )
                self.update(Text("\n").join(lines))
            await asyncio.sleep(self._period)


def _style(upper: tuple[int, int, int], lower: tuple[int, int, int]) -> Style:
    return Style(color=Color.from_rgb(*upper), bgcolor=Color.from_rgb(*lower))


class RobotPanel(Vertical):
    """A panel of one robot: any Textual widgets, and these few things of the robot."""

    TITLE: ClassVar[str] = ""
    DEFAULT_CSS = "RobotPanel { width: 1fr; height: 1fr; }"

    def __init__(self, robot: RobotDescription, way: Way) -> None:
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
        self._way = way

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
        return await self._way.carry_out(command, arguments)

    async def look(self, camera: str, width: int = 320, height: int = 180) -> bytes:
        """Return the picture of VIEW.CAMERA as JPEG, if the manifest of the page permits that stream.

        Args:
            camera: VIEW.CAMERA
            width: [px] wanted.
            height: [px] wanted.

        Raises:
            Refused: there is none; says why.
        """
        view, _, name = camera.partition(".")
        return await self._way.look(view, name, width, height)

    def ask(self, command: str, **arguments: Any) -> None:
        """Have a command carried out in the background; `refused` says why not."""

        async def carry_out() -> None:
            try:
                await self.call(command, **arguments)
            except Refused as error:
                self.refused(str(error))

        self.run_worker(carry_out(), exit_on_error=False)
