"""The command line `robotree`, run by tests as a person runs it: as a process of its own."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path

ROBOTREE = [sys.executable, "-m", "robotree.tui"]
PATIENCE = 60.0
"""[s] A busy machine may take that long for one line."""

NO_BYTECODE = {"PYTHONDONTWRITEBYTECODE": "1"}
"""For the environment of a process whose files are limited: Python 3.11 keeps byte code that did not fit as
if it were whole, and every later process fails on it."""

Run = Callable[..., Awaitable[tuple[int, str, str]]]
"""Takes the words of a line; gives its exit code, its output and its complaints."""


def robotree(
    *words: str | Path, within: float = PATIENCE, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run one line to its end, with nobody at the keyboard.

    Args:
        words: behind the program's name.
        within: [s] it must end by itself.
        environment: variables beside those of this process.
    """
    return subprocess.run(
        [*ROBOTREE, *map(str, words)],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
        timeout=within,
        env={**os.environ, **environment},
    )


def within_realm(realm: str) -> Run:
    """Return how to run lines in a realm, beside whatever the test's event loop does."""

    async def run(*words: str) -> tuple[int, str, str]:
        process = await asyncio.create_subprocess_exec(
            *(*ROBOTREE, *words, "--realm", realm),
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
        )
        async with asyncio.timeout(PATIENCE):
            out, complaints = await process.communicate()
        return process.returncode or 0, out.decode(), complaints.decode()

    return run
