"""The two ends of a command line: results on standard output, everything else on standard error.

Much of what is written comes from afar: names, results, the words of an error. It must not steer the
terminal of whoever reads it, so whatever is no letter goes out by its number.
"""

from __future__ import annotations

import os
import re
import stat
import sys
from collections.abc import Callable
from typing import IO, TYPE_CHECKING

from robotree.tui.errors import sentence

if TYPE_CHECKING:  # help comes without an event loop
    import asyncio

STEERING = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200b\u200e\u200f\u2028-\u202e\u2060-\u2069\ufeff]")
"""Characters that steer a terminal or a reader instead of being seen: C0 and C1 controls (every escape
sequence begins with one), invisible ones, and those that turn the direction of writing (Unicode annex 9)."""


def harmless(text: str) -> str:
    r"""Return a text in which what steers stands as `\u001b`; so JSON stays JSON and says the same.

    Line ends and tabulators stay: they are layout.
    """
    return STEERING.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def one_line(text: str) -> str:
    """Return a text without line ends: who tells one event cannot make it look like two."""
    return " ".join(text.split("\n")) if "\n" in text else text


def put(text: str) -> None:
    """Write a result, at once: the reader may be a pipe that waits for it.

    Raises:
        OSError: it cannot be written; it names standard output, and what follows is written nowhere.
    """
    try:
        sys.stdout.write(f"{harmless(text)}\n")
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        forget_the_reader()
        raise OSError(error.errno, error.strerror, "standard output") from error


def note(text: str) -> None:
    """Write something that is not a result; to nobody, where the terminal has gone."""
    try:
        sys.stderr.write(f"{harmless(text)}\n")
        sys.stderr.flush()
    except OSError:
        forget_the_reader(sys.stderr)


def complain(error: Exception | str) -> None:
    """Write why something was not done, in its one sentence."""
    note(f"robotree: {one_line(error if isinstance(error, str) else sentence(error))}")


def over(text: str) -> None:
    """Write over the present line of the screen, without ending it; empty: take the line away."""
    sys.stderr.write(f"\r\x1b[K{harmless(one_line(text))}")
    sys.stderr.flush()


def clear() -> None:
    """Take everything off the terminal that standard output is."""
    sys.stdout.write("\x1b[H\x1b[J")


def no_screen() -> str:
    """Say why no full screen can be shown here, behind the word *terminal*; empty: it can.

    Keys come from standard input, and Textual draws on standard error; who has sent standard output
    elsewhere wants a result there.
    """
    names = ("standard input", "standard output", "standard error")
    for name, stream in zip(names, (sys.stdin, sys.stdout, sys.stderr), strict=True):
        if not stream.isatty():
            return f"{name} is none"
    return "this one cannot place text (TERM=dumb)" if os.environ.get("TERM") == "dumb" else ""


def forget_the_reader(stream: IO[str] | None = None) -> None:
    """Write what goes to a stream nowhere from now on: Python would complain at its end, or try again.

    Args:
        stream: a standard one; None: standard output.
    """
    os.dup2(os.open(os.devnull, os.O_WRONLY), (stream or sys.stdout).fileno())


def until_the_reader_leaves(
    loop: asyncio.AbstractEventLoop, leave: Callable[[], object]
) -> Callable[[], bool]:
    """Call back when nobody reads standard output any more, should it be a pipe.

    A pipe without a reader is an error condition, and an event loop reports those as readable.

    Args:
        loop: that runs now.
        leave: called once, on the loop.

    Returns:
        Whether that has happened.
    """
    left = list[bool]()
    try:
        out = sys.stdout.fileno()
        is_pipe = stat.S_ISFIFO(os.fstat(out).st_mode)
    except OSError:
        return lambda: False  # it is no file at all

    def gone() -> None:
        loop.remove_reader(out)
        left.append(True)
        leave()

    if is_pipe:
        loop.add_reader(out, gone)
    return lambda: bool(left)
