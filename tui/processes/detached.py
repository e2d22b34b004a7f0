"""A process of robotree that is started here and outlives this one; what it says is kept in a log.

A host for one robot alone is one: so a page that holds the interpreter, or crashes it, takes no other robot
with it. Such a host ends when its robot is deleted, or when none has come within a minute.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import select
import subprocess
import sys
import threading
import time
from collections.abc import AsyncGenerator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from robotree.files import overwrite
from robotree.tui.errors import MemberFailed
from robotree.tui.processes.crew import READY, START_LIMIT
from robotree.tui.processes.state_files import state_file

LAST_LINES = 3
"""Of what it said, when it did not come up."""


class Started(NamedTuple):
    """A process that is up."""

    process: subprocess.Popen[bytes]
    address: str
    """As it said when it was ready."""


def start_detached(
    realm: str, name: str, words: Sequence[str], environment: Mapping[str, str] | None = None
) -> Started:
    """Start `robotree WORDS… --realm REALM`, and wait until it is ready. Blocks.

    Args:
        realm: in which it lives; its log is kept there, too.
        name: of its log.
        words: its line.
        environment: variables beside those of this process.

    Raises:
        MemberFailed: it did not come up.
    """
    log = state_file(realm, f"{name}.log")
    if log is not None:
        overwrite(log, b"")
    with (log or Path(os.devnull)).open("ab") as errors:
        process = subprocess.Popen(
            [sys.executable, "-m", "robotree.tui", *words, "--realm", realm],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=errors,
            env={**os.environ, **(environment or {})},
            start_new_session=True,  # it outlives this program and its terminal
        )
    # when it has ended, somebody must ask how: else it stays in the list of processes
    threading.Thread(target=process.wait, name=f"end of {name}", daemon=True).start()
    address = _address(process)
    if address is None:
        process.kill()
        said = "" if log is None else log.read_text(errors="replace")
        last = [line.removeprefix("robotree: ") for line in said.strip().splitlines()[-LAST_LINES:]]
        raise MemberFailed(words, "did not come up", "\n".join(last))
    return Started(process, address)


def _address(process: subprocess.Popen[bytes]) -> str | None:
    """Wait until it says that it is up; return its address, or None if it does not."""
    assert process.stdout is not None  # noqa: S101 # started with a pipe
    latest, said = time.monotonic() + START_LIMIT, b""
    with process.stdout as out:
        while not said.startswith(f"{READY} ".encode()) or b"\n" not in said:
            left = max(latest - time.monotonic(), 0.0)
            if not select.select([out], [], [], left)[0] or not (piece := os.read(out.fileno(), 4096)):
                return None
            said += piece
    return said.decode(errors="replace").partition("\n")[0].partition(" ")[2]


@contextlib.asynccontextmanager
async def own_host(realm: str, robot: str) -> AsyncGenerator[str]:
    """Start a host for a robot that is made in this block; if it is not, the host ends.

    Args:
        realm: in which it lives.
        robot: name of the robot.

    Yields:
        The host's name.

    Raises:
        MemberFailed: it did not come up.
    """
    name = f"{robot}-host"
    started = await asyncio.to_thread(start_detached, realm, name, ("host", name, "--only", robot))
    try:
        yield name
    except BaseException:
        started.process.terminate()
        raise
