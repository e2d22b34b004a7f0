"""On a real terminal: hanging robots are shown at once, commands have entries, keys may come in a burst."""

from __future__ import annotations

import json
import os
import re
import signal
import time
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any

import pytest
import pytest_asyncio

from robotree.client.joining import joined
from robotree.tui.processes.crew import Crew
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.testing import until
from tests.command_line import within_realm
from tests.terminal import ENTER, ESCAPE, Person

pytestmark = [pytest.mark.e2e, pytest.mark.asyncio(loop_scope="module"), pytest.mark.timeout(600)]

REALM = "trust"
WITHIN = 1.0
"""[s] in which a process that does not answer must be shown."""
BUSY = 0.5
"""[s] that a busy machine may take besides."""
RUN = within_realm(REALM)


class Cell:
    """The processes of a cell, and a realm client that sees them."""

    def __init__(self, crew: Crew, realm_client: RealmClient, proxy: int) -> None:
        self.crew, self.realm_client, self.proxy = crew, realm_client, proxy


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def cell(shared_place: Path) -> AsyncIterator[Cell]:
    async with Crew(REALM, shared_place) as crew:
        rover = await crew.start("sim", "rover", "--listen", "tcp:127.0.0.1:0", "--open")
        *_, proxy = await crew.start_all(
            ("lookup", "lookup-1"),
            ("host", "host-1"),
            ("proxy", "rover", "rover-1", "--connect", rover.address, "--open"),
        )
        async with joined(REALM) as realm_client:
            await until(lambda: len(realm_client.robots()) == 1, "the rover is listed")
            yield Cell(crew, realm_client, proxy.pid)


@pytest.fixture
def screen(cell: Cell) -> Iterator[Person]:
    del cell  # it is there
    found = Person(REALM)
    try:
        found.shows(b"place")  # in the details of the rover, which is selected
        yield found
    finally:
        found.leave()


@pytest.mark.speed
async def test_a_robot_that_hangs_is_seen_within_a_second_in_the_list_and_in_an_open_panel(
    cell: Cell, screen: Person
) -> None:
    screen.types(ENTER, sees="readings")  # its panel
    os.kill(cell.proxy, signal.SIGSTOP)
    began = time.monotonic()
    try:
        screen.shown = b""
        screen.shows(b"late", b"HANGS")
        assert time.monotonic() - began < WITHIN + BUSY
        screen.shows(f"HANGS (pid {cell.proxy})".encode())
        assert b"gone" not in screen.shown
    finally:
        os.kill(cell.proxy, signal.SIGCONT)
    screen.shows(b"answers again")
    screen.types(ESCAPE, sees="log  g")


async def test_a_parent_says_that_its_child_hangs_and_not_that_it_needs_one(
    cell: Cell, screen: Person
) -> None:
    screen.types(":create examples/move_square.py as square\r", sees="needs rover")
    screen.types(":enslave square.rover rover-1\r", sees="under square")
    os.kill(cell.proxy, signal.SIGSTOP)
    try:
        screen.shown = b""
        screen.shows(b"rover: rover-1 hangs")
        _, listed, _ = await RUN("ls")
        assert re.search(r"square .*rover: rover-1 hangs", listed), listed
    finally:
        os.kill(cell.proxy, signal.SIGCONT)
    screen.shows(b"answers again")
    await cell.realm_client.delete("square")
    await until(lambda: len(cell.realm_client.robots()) == 1, "the rover is free")


async def test_two_people_who_command_one_robot_have_two_entries_with_their_names(
    cell: Cell, screen: Person
) -> None:
    assert not (await cell.realm_client.describe("rover-1")).busy
    way = ("call", "rover-1.go_to", "y=0")
    anna = Person(REALM, *way, "x=0.12", "speed=0.03")
    people = [anna]
    try:
        screen.shows(f"by {os_user()}@{anna.terminal} begins".encode())
        people.append(bob := Person(REALM, *way, "x=0", "speed=0.2"))
        screen.shows(f"by {os_user()}@{bob.terminal} waits".encode())
        bob.shows(f"waits: {os_user()}@{anna.terminal}'s go_to first, 2 s".encode())
        bob.shows(b"has waited")
        screen.shows(f"by {os_user()}@{bob.terminal} is done".encode())
    finally:
        for person in people:
            person.leave()
    last: dict[str, Any] = {}

    async def logged() -> bool:
        _, out, _ = await RUN("log", "rover-1", "--json")
        ended = [one for one in json.loads(out) if one["level"] == "done" and one["command"] == "go_to"]
        last.clear()
        last.update({one["caller"]: one for one in ended[-2:]})
        return set(last) == {f"{os_user()}@{who.terminal}" for who in people}

    await until(logged, "both are in the log")
    first, second = sorted(last.values(), key=lambda one: one["unix"])
    assert first["waited"] < 0.1 < second["waited"], "the time in the queue is told apart"
    assert "y=0" in first["arguments"]
    _, text, _ = await RUN("log")
    done = rf"\d{{4}}-\d\d-\d\d .* rover-1: go_to by {os_user()}@pts/\d+ is done: waited"
    assert re.search(done, text), text


async def test_the_deaths_of_a_host_and_a_lookup_service_are_in_both_logs_with_their_processes(
    cell: Cell, screen: Person
) -> None:
    host, lookup = await cell.crew.start_all(("host", "host-2"), ("lookup", "lookup-2"))
    screen.shows(b"host-2 (host) has come")
    for member, name, role in ((host, "host-2", "host"), (lookup, "lookup-2", "lookup")):
        screen.shown = b""
        member.process.kill()
        screen.shows(f"{name} ({role}) has died".encode())
        await member.process.wait()
        cell.crew.members.remove(member)
        await member.stop()
    _, text, _ = await RUN("log")
    for member, name, role in ((host, "host-2", "host"), (lookup, "lookup-2", "lookup")):
        died = rf"\d{{4}}-\d\d-\d\d .* error .*{name} \({role}, process {member.pid}\) has died"
        assert len(re.findall(died, text)) == 1, text


async def test_states_are_counted_coloured_and_searched_on_a_terminal_of_16_colours(
    cell: Cell, screen: Person
) -> None:
    screen.shows(b"1 free")
    assert re.search(rb"\x1b\[[0-9;]*92[0-9;]*m\xe2\x97\x8f", screen.shown), "free is bright green"
    screen.types("/zzz", sees="zzz")
    screen.types(ESCAPE, sees="rover-1")
    os.kill(cell.proxy, signal.SIGSTOP)
    try:
        screen.shown = b""
        screen.shows(b"1 hang")
    finally:
        os.kill(cell.proxy, signal.SIGCONT)
    screen.shows(b"answers again")
    screen.types("?", sees="Protective stop")
    screen.types("/delete", sees="delete")
    screen.types(ESCAPE, sees="Close")


def os_user() -> str:
    import pwd

    return pwd.getpwuid(os.geteuid()).pw_name
