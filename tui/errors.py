"""What can go wrong between a person and the supervisor, on one page.

Errors of robots come from `robotree.vr.errors` and pass through unchanged; here are only those that begin
at the keyboard or in a session script.

    SupervisorError
      UsageError      UnknownVerb · BadLine
      SessionError    BadScript
      ValueRefused    (also ValueError)
      NothingToAsk
"""

from __future__ import annotations


class SupervisorError(Exception):
    """The root: one sentence that says whose fault it is and what to do next."""


class UsageError(SupervisorError):
    """A line that cannot be understood; nothing was done."""


class UnknownVerb(UsageError):
    """The first word is no verb."""

    def __init__(self, verb: str, near: tuple[str, ...]) -> None:
        """Name the word and the verbs that look like it."""
        self.verb, self.near = verb, near
        hint = f"did you mean {' or '.join(near)}?" if near else "`robotree help` shows all verbs"
        super().__init__(f"no verb {verb!r}; {hint}")


class BadLine(UsageError):
    """The verb is right, the rest of the line is not."""

    def __init__(self, reason: str, usage: str) -> None:
        """Say what is wrong and how the line should look."""
        self.reason, self.usage = reason, usage
        super().__init__(f"{reason}; usage: {usage}" if usage else reason)


class SessionError(SupervisorError):
    """A session script that cannot be played."""


class BadScript(SessionError):
    """A line of the script cannot be understood; nothing was played."""

    def __init__(self, path: str, number: int, reason: str) -> None:
        """Point at the line, counted from 1."""
        self.path, self.number, self.reason = path, number, reason
        super().__init__(f"{path}, line {number}: {reason}")


class ValueRefused(SupervisorError, ValueError):
    """A typed value that does not fit its field; the sentence stands beside the field."""

    def __init__(self, field: str, reason: str) -> None:
        """Name the field and say what would be right."""
        self.field, self.reason = field, reason
        super().__init__(f"{field}: {reason}")


class NothingToAsk(SupervisorError):
    """Nobody is there: no lookup service and no agent in this realm."""

    def __init__(self, realm: str) -> None:
        """Name the realm and how to fill it."""
        self.realm = realm
        super().__init__(f"nobody is in realm {realm!r}; start something first, for example `robotree demo`")
