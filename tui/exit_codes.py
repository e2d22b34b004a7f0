"""What the command line answers to the shell that started it. Pure."""

from __future__ import annotations

from robotree.tui.errors import BadScript, NothingToAsk, OldList, SomeHang, UsageError, ValueRefused

DONE = 0
REFUSED = 1
"""A robot refused or failed, a session's expectation did not hold, a program could not start."""
USAGE = 2
"""The line was not understood; nothing was done."""
NOBODY = 3
"""Nobody answers: the agent has ended, the network is cut, the realm is empty, or no lookup service lives."""
INTERRUPTED = 130
"""Ctrl-C, as shells count it."""


def ours(error: Exception) -> bool:
    """Whether an error is one of robotree's own, or of the system: one sentence that a person can use."""
    return isinstance(error, OSError) or type(error).__module__.startswith("robotree.")


def code_of(error: Exception) -> int:
    """Return the exit code for an error that ended a verb."""
    from robotree.protocol.errors import BadUrl
    from robotree.vr.errors import Hanging, TransportError

    if isinstance(error, UsageError | ValueRefused | BadScript | BadUrl):
        return USAGE
    if isinstance(error.__cause__, BadUrl):  # a room's own sentence about an address
        return USAGE
    if isinstance(error, NothingToAsk | OldList | SomeHang | Hanging | TransportError):
        return NOBODY
    return REFUSED
