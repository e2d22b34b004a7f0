"""The two ends of a command line: results on standard output, everything else on standard error.

Much of what is written comes from afar: names, results, the words of an error. It must not steer the
terminal of the reader, so every character that is no letter is written as its number.
"""

from __future__ import annotations

import os
import re
import stat
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from typing import IO, TYPE_CHECKING, Any

from robotree.tui.errors import BadScript, SupervisorError, sentence

if TYPE_CHECKING:  # help comes without an event loop
    import asyncio

STEERING = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200b\u200e\u200f\u2028-\u202e\u2060-\u2069\ufeff]")
"""Characters that steer a terminal or a reader instead of being seen: C0 and C1 controls (every escape
sequence begins with one), invisible ones, and those that turn the direction of writing (Unicode annex 9)."""


class Answer:
    """The output of one command line on standard output."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self.as_json = False
        """Plain data was asked for: then it gets one JSON value, whatever happens, or a stream of them."""
        self.given = False
        """Whether anything has been written to it."""


_answer = Answer()
"""The answer of this process: results come from any thread."""


@contextmanager
def answering(*, as_json: bool) -> Generator[Answer]:
    """Have what is put and complained inside the block be the answer of one command line."""
    before = _answer.as_json, _answer.given
    _answer.as_json, _answer.given = as_json, False
    try:
        yield _answer
    finally:
        _answer.as_json, _answer.given = before


def harmless(text: str) -> str:
    r"""Return a text in which what steers stands as `\u001b`; so JSON stays JSON and says the same.

    Line ends and tabulators stay: they are layout.
    """
    return STEERING.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def one_line(text: str) -> str:
    """Return a text without line ends: one event cannot be made to look like two."""
    return " ".join(text.split("\n")) if "\n" in text else text


def put(text: str) -> None:
    """Write a result, at once: the reader may be a pipe that waits for it.

    Raises:
        OSError: it cannot be written; it names standard output, and what follows is written nowhere.
    """
    _answer.given = True
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


def aside(text: str) -> None:
    """Write what goes on, for people: beside the result, or on standard error where that is plain data."""
    (note if _answer.as_json else put)(text)


def put_data(thing: Any) -> None:
    """Write a result as one JSON value on one line; errors as those of `put`."""
    import json  # help comes without it

    put(json.dumps(thing, ensure_ascii=False))


def answer(text: str, data: Callable[[], Any]) -> None:
    """Write a result: its text, or what it is as plain data where that was asked for."""
    if _answer.as_json:
        put_data(data())
    else:
        put(text)


MISTAKES = 10
"""Of a script that a person is told at once."""


def complain(error: Exception | str) -> None:
    """Write why something was not done, in its one sentence.

    Where plain data was asked for it is an object, on standard error as everything that is no result; and on
    standard output, too, if that has got nothing yet: a program that reads one value there gets one. A person
    who sees both on one terminal sees it once.
    """
    known = SupervisorError(error) if isinstance(error, str) else error
    if not _answer.as_json:
        lines = sentence(known).split("\n") if isinstance(known, BadScript) else [sentence(known)]
        for line in lines[:MISTAKES]:
            note(f"robotree: {one_line(line)}")
        if more := len(lines[MISTAKES:]):
            note(f"robotree: {more} more mistakes; is it a session script? --json has all")
        return
    import json

    data, missing = error_data(known), not _answer.given
    if missing:
        put_data(data)
    if not (missing and sys.stdout.isatty() and sys.stderr.isatty()):
        note(json.dumps(data, ensure_ascii=False))


def error_data(error: Exception) -> dict[str, Any]:
    """Return an error as plain data: its name, its sentence, and all mistakes of a script."""
    data: dict[str, Any] = {"error": type(error).__name__, "message": sentence(error)}
    if isinstance(error, BadScript):
        data["mistakes"] = [{"line": number, "message": reason} for number, reason in error.mistakes]
    return data


def over(text: str) -> None:
    """Write over the present line of the screen, without ending it; empty: take the line away."""
    sys.stderr.write(f"\r\x1b[K{harmless(one_line(text))}")
    sys.stderr.flush()


def clear() -> None:
    """Take everything off the terminal that standard output is."""
    sys.stdout.write("\x1b[H\x1b[J")


async def typed() -> bytes:
    """Wait for something on standard input; empty: it has ended."""
    import asyncio

    loop, there = asyncio.get_running_loop(), asyncio.Event()
    try:
        loop.add_reader(sys.stdin.fileno(), there.set)
    except PermissionError:  # a file is always ready
        return os.read(sys.stdin.fileno(), 65_536)
    try:
        await there.wait()
    finally:
        loop.remove_reader(sys.stdin.fileno())
    with suppress(OSError):
        return os.read(sys.stdin.fileno(), 65_536)
    return b""


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
