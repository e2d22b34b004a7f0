"""`robotree wire …`: record, inspect, replay and measure what crosses the wire; no agents are needed.

Each verb is a module of its own, of the name of its second word, imported when it is asked for. Here is only
what opens, reads and prints; what is computed is computed in `robotree.protocol`.
"""

from __future__ import annotations

from importlib import import_module
from typing import Protocol, cast

from robotree.tui.line.grammar import Line


class Verb(Protocol):
    """The functions that the module of a verb offers."""

    def run(self, line: Line) -> int:
        """Do what the line says and return the exit code."""
        ...


def start(line: Line) -> int:
    """Carry out one line whose verb begins with `wire`.

    Returns:
        The exit code.
    """
    name = line.verb.partition(" ")[2]
    return cast("Verb", import_module(f"robotree.tui.wire.{name}")).run(line)
