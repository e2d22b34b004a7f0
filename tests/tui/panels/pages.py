"""Panels that are programs: one that behaves, and those that do not."""

GOOD = """
from textual.containers import Vertical
from textual.widgets import Button, Label

from robotree.tui.panels.author import RobotPanel


class Waving(RobotPanel):
    TITLE = "Waving"
    BINDINGS = [("w", "wave", "wave")]

    def compose(self):
        yield Label("hello", id="said")
        yield Button("wave", id="wave")

    def on_mount(self):
        self.query_one(Button).focus()

    def see(self):
        battery, unit = self.readings["battery"], self.units["battery"]
        self.query_one("#said", Label).update(f"battery {battery:.0f} {unit}")

    def on_button_pressed(self):
        self.action_wave()

    def action_wave(self):
        self.run_worker(self._wave())

    async def _wave(self):
        from robotree.tui.panels.author import Refused

        try:
            said = await self.call("wave", times=3)
        except Refused as error:
            said = f"no: {error}"
        self.query_one("#said", Label).update(f"{said}")
"""

WORST = """
import asyncio
import os
import socket
import time

from textual.widgets import Label

from robotree.tui.panels import frames
from robotree.tui.panels.author import RobotPanel


class Worst(RobotPanel):
    def compose(self):
        yield Label("harmless")

    def on_mount(self):
        self.set_timer(0.2, self.worst)

    def worst(self):
        {worst}
"""
