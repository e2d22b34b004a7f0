"""Real processes and a real terminal: the messages on a proxy's wire, and a field of them over time."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from robotree.tui.processes.crew import Crew
from tests.command_line import within_realm
from tests.terminal import ENTER, Person

pytestmark = pytest.mark.e2e


async def test_a_field_on_the_wire_is_ticked_and_drawn(place: Path) -> None:
    run = within_realm("messages")
    async with Crew("messages", place) as crew:
        await crew.start("lookup", "l1")
        rover = await crew.start("sim", "rover", "--listen", "tcp:127.0.0.1:0", "--state", "none")
        await crew.start("proxy", "rover", "rover-1", "--connect", rover.address)
        code, _, complaints = await run("show", "rover-1")
        assert code == 0, complaints
        person = Person("messages", columns=140, lines=44)
        try:
            await asyncio.to_thread(person.shows, b"rover-1")
            await asyncio.to_thread(person.types, "Q", sees="HEARTBEAT")
            await asyncio.to_thread(person.types, "", sees="□")
            await asyncio.to_thread(person.types, ENTER, sees="0.")
            await asyncio.to_thread(person.types, ENTER, sees="■")
            await asyncio.to_thread(person.types, "U", sees="⠉⠉")
        finally:
            person.leave()
