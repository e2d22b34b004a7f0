"""Which process of this machine is an agent, and with which line it was started.

The realm's folder says which process holds an agent, and the kernel how the process was started: both are
true also of an agent that hangs, and nothing has to be published for it.
"""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from robotree.vr.base.address import Address
from robotree.vr.base.os_files import OS_FILES
from robotree.vr.network.realms import keys_of, members, places, process_of, realm_folder

ENDING = 5.0
"""[s] in which a process that was asked to end is gone."""
KEY_VARIABLE = "ROBOTREE_KEY"
LONGEST = 1 << 20
"""[bytes] of a command line or an environment that are read."""


class Program(NamedTuple):
    """A process that is one agent or several."""

    pid: int
    words: tuple[str, ...]
    """Its line behind `robotree`; none: it is another program, such as one of a person that has a host."""
    folder: Path
    """Its working directory."""
    key: str
    """The keys that its environment names (`$ROBOTREE_KEY`)."""


def programs(realm: str) -> dict[Address, Program]:
    """Return the processes of a realm on this machine, by their agents."""
    found: dict[Address, Program] = {}
    for place in places(realm_folder(realm)):
        for tag in members(place):
            pid = process_of(tag)
            keys = keys_of(place, tag) or [] if OS_FILES.lives(pid) else []
            agents = [address for key in keys if (address := Address.parse(key)) is not None]
            if agents and (program := program_of(pid)):
                found |= dict.fromkeys(agents, program)
    return found


def program_of(pid: int) -> Program | None:
    """Return what a process runs; None: it has ended, or is somebody else's."""
    process = Path(f"/proc/{pid}")
    try:
        line, environment = _texts(process / "cmdline"), _texts(process / "environ")
        folder = (process / "cwd").readlink()
    except OSError:
        return None
    prefix = f"{KEY_VARIABLE}="
    key = next((one.removeprefix(prefix) for one in environment if one.startswith(prefix)), "")
    return Program(pid, _behind_the_name(line), folder, key)


def _texts(path: Path) -> list[str]:
    with path.open("rb") as file:
        return file.read(LONGEST).decode(errors="replace").split("\0")[:-1]


def _behind_the_name(line: Sequence[str]) -> tuple[str, ...]:
    """Return the words behind `robotree` or `-m robotree.tui`, without the tether to a starter."""
    for number, word in enumerate(line[:6]):
        if word == "robotree.tui" or Path(word).name == "robotree":
            return tuple(one for one in line[number + 1 :] if one != "--tether")
    return ()


async def end_process(pid: int) -> None:
    """Ask a process to end, and wait until it has.

    Raises:
        TimeoutError: it has not.
        OSError: it cannot be asked.
    """
    program = program_of(pid)
    if program is None or not program.words:
        return
    with suppress(ProcessLookupError):  # it has ended by itself, as the own host of a robot does
        process, over, loop = os.pidfd_open(pid), asyncio.Event(), asyncio.get_running_loop()
        loop.add_reader(process, over.set)  # readable when it has ended
        try:
            signal.pidfd_send_signal(process, signal.SIGTERM)
            async with asyncio.timeout(ENDING):
                await over.wait()
        finally:
            loop.remove_reader(process)
            os.close(process)
