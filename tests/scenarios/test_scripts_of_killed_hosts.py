"""A host whose script leads a robot elsewhere is killed with SIGKILL and started again: real processes."""

from __future__ import annotations

import asyncio
import os
import signal
from pathlib import Path

import pytest

from robotree.tui.processes.crew import Crew
from tests.command_line import within_realm

pytestmark = pytest.mark.e2e

REALM = "killed-scripts"
robotree = within_realm(REALM)
GUIDE = Path(__file__).parents[2] / "examples" / "guide.yaml"
COMPANION = '''
"""Companion: keeps what it has said and where it has gone."""
from robotree.vr import VirtualRobot, command

class Companion(VirtualRobot):
    """Keeps what it does."""

    def note(self, text: str) -> None:
        self.sleep(0.4)
        with open("NOTES", "a") as notes:
            notes.write(f"{text}\\n")

    @command
    def say(self, text: str) -> None:
        """Say something."""
        self.note(text)

    @command
    def go_to(self, place: str) -> None:
        """Go to a place."""
        self.note(place)

    @command
    def wave(self) -> None:
        """Wave."""
        self.note("wave")
'''


def lines_of(file: Path) -> list[str]:
    return file.read_text().splitlines() if file.exists() else []


async def did(file: Path, at_least: int) -> list[str]:
    """Return what the companion has done, when it is so much."""
    async with asyncio.timeout(60):
        while len(lines_of(file)) < at_least:  # noqa: ASYNC110 # another process writes it
            await asyncio.sleep(0.1)
    return lines_of(file)


async def test_visitors_are_still_known_and_nothing_is_said_twice(tmp_path: Path) -> None:
    page = tmp_path / "companion.py"
    notes = tmp_path / "notes"
    page.write_text(COMPANION.replace("NOTES", str(notes)))
    async with Crew(REALM, tmp_path, state=tmp_path / "state") as crew:
        await crew.start("host", "h2")
        host = await crew.start("host", "h1")
        for words in (
            ("create", f"{page}", "as", "c1", "on", "h2"),
            ("create", str(GUIDE), "as", "guide", "on", "h1"),
            ("enslave", "guide.robot", "c1"),
            ("call", "guide.start", "--detach"),
            ("call", "guide.person_seen", "who=anna", "place=kitchen"),
        ):
            said = await robotree(*words)
            assert said[0] == 0, said
        await did(notes, 1)
        os.kill(host.pid, signal.SIGKILL)
        await host.process.wait()
        await crew.start("host", "h1")
        bela = await robotree("call", "guide.person_seen", "who=bela", "place=hall")
        assert bela[0] == 0, bela
        way = ["wave", "Welcome, {who}", "{place}", "Here is the {place}."]
        visits = (("anna", "kitchen"), ("bela", "hall"))
        assert await did(notes, 8) == [
            line.format(who=who, place=place) for who, place in visits for line in way
        ]
