"""The command `robotree`: reads one line, and starts what it asks for.

What a verb starts says its line in the registry (`line/actions`). Everything heavy is imported where it is
needed, so that help comes at once.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from itertools import takewhile
from typing import NoReturn

from robotree.tui import exit_codes
from robotree.tui.errors import Interrupted
from robotree.tui.line import grammar, manual
from robotree.tui.line.actions import BY_VERB
from robotree.tui.line.grammar import Line
from robotree.tui.line.surface import Surface
from robotree.tui.processes.realm import only_looking
from robotree.tui.terminal import (
    answer,
    answering,
    complain,
    forget_the_reader,
    put,
)

START = 0.5
"""[s] that Python takes at most to start."""


def program(order: str = "") -> NoReturn:
    """Run the command line of this process and end the process.

    Args:
        order: id of the order to stop that has been sent already for this line; empty: none has.

    Where nothing else runs in it, Python does not take apart what it has loaded: that takes as long as a list
    of robots. All that was written has been flushed (`terminal.put`).
    """
    code = main(order=order)
    threads = sys.modules.get("threading")  # not loaded: there is only this one
    if threads is None or threads.active_count() == 1:
        os._exit(code)
    sys.exit(code)


def main(words: Sequence[str] | None = None, *, order: str = "") -> int:
    """Run one command line.

    Args:
        words: without the program's name; None: those of this process.
        order: see `program`.

    Returns:
        The exit code; see `exit_codes`.
    """
    # what this process has computed so far is the start of Python: the line was given before that
    began = time.monotonic() - (min(time.process_time(), START) if words is None else 0.0)
    given = list(sys.argv[1:] if words is None else words)
    with answering(as_json="--json" in takewhile(lambda word: word != "--", given)) as got:
        code = _answered(given, began, order)
        if got.as_json and not got.given and code == exit_codes.DONE:
            put("null")
        return code


def _answered(given: list[str], began: float, order: str) -> int:
    try:
        return _obey(given, began, order)
    except KeyboardInterrupt:
        complain(Interrupted())
        return exit_codes.INTERRUPTED
    except BrokenPipeError:
        # The reader of our output left (`robotree ls | head -1`): nothing to say, nobody to say it to.
        forget_the_reader()
        return exit_codes.DONE
    except Exception as error:
        if not exit_codes.ours(error):
            raise  # a mistake of ours: its traceback is wanted
        complain(error)
        return exit_codes.code_of(error)


def _obey(given: list[str], began: float, order: str) -> int:
    before, rest = grammar.leading(given, manual.EVERYWHERE)
    surface = manual.shell(readonly=only_looking(given="--readonly" in given))
    plain = [word for word in rest if not word.startswith("-")]
    if "--version" in before or rest[:1] == ["-V"]:
        return _version()
    if rest[:1] == ["help"]:
        return _help(plain[1:], surface)
    if {"--help", "-h"} & {*before, *rest}:
        return _help(plain, surface)
    words = [*before, *rest] if rest else ["supervise", *before]
    line = surface.parse(words)._replace(given=began, order=order)
    if needs := BY_VERB[line.verb].needs:
        from robotree.tui.line.installed import require

        require(line.verb, *needs)
    try:
        return _start(line)
    except ImportError as error:  # what only some lines of a verb need
        from robotree.tui.line.installed import lacking

        raise lacking(line.verb, error) or error from None


def _help(words: Sequence[str], surface: Surface) -> int:
    """Print the help of all verbs, of those with this first word, or of one."""
    family = manual.family(words[0], surface) if len(words) == 1 else ""
    if words and not family:
        verb = surface.verb_of(words)
        answer(manual.page(verb), lambda: manual.structure(BY_VERB[verb]))
    else:
        begins = f"{words[0]} " if words else ""
        found = [action for action in surface.actions if f"{action.verb} ".startswith(begins)]
        answer(family or manual.overview(surface), lambda: [manual.structure(one) for one in found])
    return exit_codes.DONE


def _version() -> int:
    from importlib.metadata import PackageNotFoundError, version

    with suppress(PackageNotFoundError):
        found = version("robotree")
        answer(f"robotree {found}", lambda: {"robotree": found})
    return exit_codes.DONE


def _start(line: Line) -> int:
    """Start what the line asks for, in this process, and return its exit code."""
    from robotree.tui.line.carrying import program_of
    from robotree.tui.processes.realm import chosen

    realm = chosen(line.text("--realm"))
    came = program_of(line.verb)(line, realm)
    if isinstance(came, int):
        return came
    from robotree.tui.processes.ending import to_the_end

    return to_the_end(came)
