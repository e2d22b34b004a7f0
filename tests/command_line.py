"""Programs that tests run to their end, above all the command line `robotree`, as a person runs it."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import Any

ROBOTREE = [sys.executable, "-m", "robotree.tui"]
PATIENCE = 60.0
"""[s] A busy machine may take that long for one line."""
LONGEST = 240.0
"""[s] for any program: less than a test may take."""

NO_BYTECODE = {"PYTHONDONTWRITEBYTECODE": "1"}
"""For the environment of a process whose files are limited: Python 3.11 keeps byte code that did not fit as
if it were whole, and every later process fails on it."""

Run = Callable[..., Awaitable[tuple[int, str, str]]]
"""Takes the words of a line; gives its exit code, its output and its complaints."""


def ran(
    words: Sequence[str | Path], *, within: float = LONGEST, check: bool = False, **options: Any
) -> subprocess.CompletedProcess[str]:
    """Run a program to its end, with nobody at the keyboard.

    Args:
        words: the program and its arguments.
        within: [s] it must end by itself.
        check: whether another exit code than 0 is an error.
        options: more of `subprocess.run`.
    """
    stdin = None if "input" in options else subprocess.DEVNULL
    return subprocess.run(
        [*map(str, words)],
        stdin=stdin,
        capture_output=True,
        text=True,
        timeout=within,
        check=check,
        **options,
    )


def robotree(
    *words: str | Path, within: float = PATIENCE, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run one line to its end, with nobody at the keyboard.

    Args:
        words: behind the program's name.
        within: [s] it must end by itself.
        environment: variables beside those of this process.
    """
    return ran([*ROBOTREE, *words], within=within, env={**os.environ, **environment})


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
