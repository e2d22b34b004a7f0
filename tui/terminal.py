"""The two ends of a command line: results on standard output, everything else on standard error."""

from __future__ import annotations

import sys


def put(text: str) -> None:
    """Write a result, at once: the reader may be a pipe that waits for it."""
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def note(text: str) -> None:
    """Write something that is not a result."""
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()


def complain(error: Exception | str) -> None:
    """Write why something was not done, in its one sentence."""
    note(f"robotree: {error}")


def over(text: str) -> None:
    """Write over the present line of the screen, without ending it; empty: take the line away."""
    sys.stderr.write(f"\r\x1b[K{text}")
    sys.stderr.flush()
