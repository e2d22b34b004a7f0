"""The exit codes of the command line. Pure."""

from __future__ import annotations

import sys

from robotree.tui.errors import (
    BadScript,
    NothingToAsk,
    OldList,
    SomeHang,
    SomeSilent,
    UsageError,
    ValueRefused,
)

DONE = 0
REFUSED = 1
"""A robot refused or failed, a session's expectation did not hold, a program could not start."""
USAGE = 2
"""The line was not understood; nothing was done."""
NOBODY = 3
"""Nobody answers: the agent has ended, the network is cut, the realm is empty, or no lookup service runs."""
INTERRUPTED = 130
"""Ctrl-C, as shells count it."""


def ours(error: Exception) -> bool:
    """Whether an error is one of robotree's own, or of the system: one sentence that a person can use."""
    return isinstance(error, OSError) or type(error).__module__.startswith("robotree.")


def code_of(error: Exception) -> int:
    """Return the exit code for an error that ended a verb."""
    if isinstance(error, UsageError | ValueRefused | BadScript) or _about_an_address(error):
        return USAGE
    if isinstance(error, NothingToAsk | OldList | SomeHang | SomeSilent) or _unanswered(error):
        return NOBODY
    from robotree.vr.base.errors import (  # a mistyped verb must not wait for the agents
        Hanging,
        TransportError,
    )

    return NOBODY if isinstance(error, Hanging | TransportError) else REFUSED


def _about_an_address(error: Exception) -> bool:
    """Whether an address was not understood, also where a room says so in a sentence of its own."""
    wire = sys.modules.get("robotree.protocol.errors")  # not loaded: no error comes from there
    return wire is not None and isinstance(error, wire.BadUrl) | isinstance(error.__cause__, wire.BadUrl)


def _unanswered(error: Exception) -> bool:
    """Whether nobody listens at an address, or speaks there."""
    wire = sys.modules.get("robotree.protocol.errors")
    conform = sys.modules.get("robotree.protocol.tools.conform")
    return (wire is not None and isinstance(error, wire.LinkUnanswered)) or (
        conform is not None and isinstance(error, conform.NotHeard)
    )
