"""A host for one robot alone: a process that is started here and outlives this one.

So a page that holds the interpreter, or crashes it, takes no other robot with it. The host ends when its
robot is deleted, or when none has come within a minute.
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
from collections.abc import AsyncGenerator
from pathlib import Path

from robotree.files import overwrite
from robotree.tui.errors import MemberFailed
from robotree.tui.processes.crew import READY, START_LIMIT
from robotree.tui.processes.state_files import state_file

LAST_LINES = 3
"""Of what it said, when it did not come up."""


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
    process = await asyncio.to_thread(_start, realm, name, robot)
    try:
        yield name
    except BaseException:
        process.terminate()
        raise


def _start(realm: str, name: str, robot: str) -> subprocess.Popen[bytes]:
    words = ("host", name, "--only", robot, "--realm", realm)
    log = state_file(realm, f"{name}.log")
    if log is not None:
        overwrite(log, b"")
    with (log or Path(os.devnull)).open("ab") as errors:
        process = subprocess.Popen(
            [sys.executable, "-m", "robotree.tui", *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=errors,
            start_new_session=True,  # it outlives this program and its terminal
        )
    # when it has ended, somebody must ask how: else it stays in the list of processes
    threading.Thread(target=process.wait, name=f"end of {name}", daemon=True).start()
    if not _is_ready(process):
        process.kill()
        said = "" if log is None else log.read_text(errors="replace")
        last = [line.removeprefix("robotree: ") for line in said.strip().splitlines()[-LAST_LINES:]]
        raise MemberFailed(words, "did not come up", "\n".join(last))
    return process


def _is_ready(process: subprocess.Popen[bytes]) -> bool:
    """Wait until it says that it is up; return whether it has."""
    assert process.stdout is not None  # noqa: S101 # started with a pipe
    latest, said = time.monotonic() + START_LIMIT, b""
    with process.stdout as out:
        while not said.startswith(f"{READY} ".encode()) or b"\n" not in said:
            left = max(latest - time.monotonic(), 0.0)
            if not select.select([out], [], [], left)[0] or not (piece := os.read(out.fileno(), 4096)):
                return False
            said += piece
    return True
