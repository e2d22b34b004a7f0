"""Errors between a person and the supervisor, on one page.

Errors of robots come from `robotree.vr.base.errors` and pass through unchanged; here are only those that
begin at the keyboard or in a session script.

    SupervisorError
      UsageError      UnknownVerb · NotHere · BadLine · NotForRobots · NeedsTerminal · BadKeymap · BadTheme
                      NoSuchLanguage
                      BadRealmFile
      SessionError    BadScript · BadRecordedRealm
      ValueRefused    (also ValueError)
      NothingToAsk · OldList · SomeHang · NotInstalled · DemoRuns · StateInUse · MemberFailed · Interrupted
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

EVERYWHERE = "robotree stop --everywhere"
"""The line that stops all robots of all realms of this user."""

SHOWN = 3
"""Robots of another realm, and other realms, that an error names."""


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


class NotHere(UsageError):
    """A verb that exists, and not where it was asked for."""

    def __init__(self, verb: str, reason: str) -> None:
        """Name the verb and where it can be used."""
        self.verb = verb
        super().__init__(reason)


class BadLine(UsageError):
    """The verb is right, the rest of the line is not."""

    def __init__(self, reason: str, usage: str) -> None:
        """Say what is wrong and how the line should look."""
        self.reason, self.usage = reason, usage
        super().__init__(f"{reason}; usage: {usage}" if usage else reason)


class NotForRobots(UsageError):
    """A verb that starts a program or turns a page, where only those that ask robots can be carried out."""

    def __init__(self, verb: str) -> None:
        """Name the verb and where it belongs."""
        self.verb = verb
        super().__init__(f"{verb} asks no robot; `robotree help` shows where it can be used")


class NeedsTerminal(UsageError):
    """The full screen was asked for where there is none."""

    def __init__(self, without: str) -> None:
        """Name what the terminal lacks, and what works without it."""
        super().__init__(
            f"the full screen needs a terminal, and {without}; use verbs, for example `robotree ls`"
        )


class BadFile(UsageError):
    """A file of the operator cannot be used; nothing was started."""

    def __init__(self, path: str, reason: str) -> None:
        """Name the file and what is wrong in it."""
        self.path, self.reason = path, reason
        super().__init__(f"{path}: {reason}")


class BadKeymap(BadFile):
    """It is that of the keys."""


class BadTheme(BadFile):
    """It is one of colours."""


class NoSuchLanguage(UsageError):
    """The screen has no words in this language."""

    def __init__(self, code: str, known: Sequence[str]) -> None:
        """Name what was asked for, and what there is."""
        self.code = code
        super().__init__(f"there is no language {code!r}; there are {', '.join(known)}")


class BadRealmFile(UsageError):
    """The file of a realm cannot be used; nothing was changed."""

    def __init__(self, path: str, number: int, reason: str) -> None:
        """Name the file, the line, counted from 1 (0: none), and what is wrong there."""
        self.path, self.number, self.reason = path, number, reason
        super().__init__(f"{path}, line {number}: {reason}" if number else f"{path}: {reason}")


class SessionError(SupervisorError):
    """A session script that cannot be played."""


class BadScript(SessionError):
    """Lines of the script cannot be understood; nothing was played."""

    def __init__(self, path: str, mistakes: Sequence[tuple[int, str]]) -> None:
        """Keep all mistakes: numbers of lines, counted from 1, and what is wrong there."""
        self.path, self.mistakes = path, tuple(mistakes)
        super().__init__("\n".join(f"{path}, line {number}: {reason}" for number, reason in mistakes))

    @property
    def number(self) -> int:
        """Number of the first line that cannot be understood."""
        return self.mistakes[0][0]


class NotForDrills(SupervisorError):
    """A process that takes no part in a drill."""

    def __init__(self, name: str, reason: str) -> None:
        """Name the agent, and say why as a clause."""
        super().__init__(f"{name} takes no part in a drill: {reason}")


class BadRecordedRealm(SessionError):
    """A recording of a realm that cannot be written or read."""

    def __init__(self, path: str, reason: str) -> None:
        """Name the file, and say what is wrong with it as a clause: `is …`."""
        self.path = path
        super().__init__(f"the recording {path} {reason}")


class BadComposition(SupervisorError):
    """Steps that cannot be meant, or cannot be read; one sentence."""

    step: Any = None
    """The innermost step that cannot be meant; None: it is none of the steps."""


class ValueRefused(SupervisorError, ValueError):
    """A typed value that does not fit its field; the sentence stands beside the field."""

    def __init__(self, field: str, reason: str) -> None:
        """Name the field and the values that it accepts."""
        self.field, self.reason = field, reason
        super().__init__(f"{field}: {reason}")


class NothingToAsk(SupervisorError):
    """Nobody is there: no lookup service and no agent in this realm."""

    def __init__(
        self,
        realm: str,
        elsewhere: Mapping[str, Sequence[str]] = MappingProxyType({}),
        *,
        stopping: bool = False,
    ) -> None:
        """Name the realm and how to fill it, or the robots elsewhere and how each is reached.

        Args:
            realm: that is empty; "": all realms are.
            elsewhere: robots of other realms of this user, by what leads to them.
            stopping: whether a protective stop was asked for, which may be meant for those.
        """
        self.realm, self.elsewhere = realm, dict(elsewhere)
        hint = "; start something first, for example `robotree demo`"
        if elsewhere:
            found = [f"{_some(robots)} ({how})" for how, robots in elsewhere.items()]
            hint = f", but elsewhere there are {_some(found, 'realms')}"
            hint += f"; `{EVERYWHERE}` stops them all" if stopping else ""
        super().__init__(f"nobody is in realm {realm!r}{hint}" if realm else f"nobody is in any realm{hint}")


def _some(names: Sequence[str], what: str = "") -> str:
    """Return names, of many only the first ones."""
    rest = f" and {len(names) - SHOWN} more {what}".rstrip() if len(names) > SHOWN else ""
    return ", ".join(names[:SHOWN]) + rest


class OldList(SupervisorError):
    """A list was asked for while no lookup service runs: what follows is what is known without one."""

    def __init__(self) -> None:
        """Say what is wrong with the list."""
        super().__init__(
            "no lookup service answers; this list may be old; start one with `robotree lookup lookup-1`"
        )


class SomeHang(SupervisorError):
    """Some robots are in processes that do not answer: what is shown of them may be out of date."""

    def __init__(self, hanging: Sequence[tuple[str, str, str]]) -> None:
        """Keep name, place and remedy of each."""
        self.hanging = tuple(hanging)
        sentence = "; ".join(f"{name} hangs in {where}: {remedy}" for name, where, remedy in hanging)
        super().__init__(f"not all answer, and those may still move: {sentence}")


class SomeFailed(SupervisorError):
    """Some members of a group have not done what all were told to do; the others have."""

    def __init__(self, verb: str, group: str, count: int, failed: Sequence[tuple[str, str]]) -> None:
        """Keep name and reason of each that has not."""
        self.failed = tuple(failed)
        reasons = "; ".join(f"{name}: {reason}" for name, reason in failed)
        super().__init__(f"{verb}: {len(failed)} of {count} robots of group {group} did not do it: {reasons}")


class NotInstalled(SupervisorError):
    """A verb needs what is no part of robotree's core, and is not on this machine; nothing was started."""

    def __init__(self, verb: str, thing: str, remedy: str) -> None:
        """Name the verb, what is missing, and the command that installs it."""
        self.verb, self.thing, self.remedy = verb, thing, remedy
        super().__init__(f"`robotree {verb}` needs {thing}; install it: `{remedy}`")


class SomeSilent(SupervisorError):
    """Agents run that have not answered: a list of those that did is not complete."""

    def __init__(self, silent: Sequence[tuple[str, str, str]]) -> None:
        """Keep name, place and remedy of each."""
        self.silent = tuple(silent)
        sentence = "; ".join(f"{name} in {where}: {remedy}" for name, where, remedy in silent)
        super().__init__(f"not all answer, so this list is not complete: {sentence}")


class DemoRuns(SupervisorError):
    """The demo's names are taken in this realm."""

    def __init__(self, realm: str, taken: Sequence[str]) -> None:
        """Name the realm and who is there."""
        self.realm, self.taken = realm, tuple(taken)
        super().__init__(
            f"a demo already runs in realm {realm!r} ({', '.join(taken)}); look at it with `robotree`, "
            "or start another one with --realm NAME"
        )


class CannotRestart(SupervisorError):
    """A process is not started again."""

    def __init__(self, name: str, reason: str) -> None:
        """Say which agent's, and why not."""
        self.name, self.reason = name, reason
        super().__init__(f"{name} is not started again: {reason}")


class AlarmsUnusable(SupervisorError):
    """The alarms of a realm cannot be read or kept."""

    def __init__(self, path: str, reason: str) -> None:
        """Say which file, and why."""
        self.path, self.reason = path, reason
        super().__init__(f"{path} cannot be used ({reason}): mend it, or delete it and set the alarms again")


class NoSuchAlarm(SupervisorError):
    """No alarm is set for this reading."""

    def __init__(self, name: str, known: Iterable[str]) -> None:
        """Name the reading, and those that have alarms."""
        self.name = name
        super().__init__(f"{name} has no alarm; {', '.join(sorted(known)) or 'none'} has")


class StateInUse(SupervisorError):
    """A controller that runs keeps this file of leases."""

    def __init__(self, path: str) -> None:
        """Name the file."""
        self.path = path
        super().__init__(
            f"a controller that runs keeps its leases in {path}; end it, or give this one another address "
            "and another --state FILE"
        )


class NoPlaceForState(SupervisorError):
    """The folder in which a space would keep its entries cannot be made."""

    def __init__(self) -> None:
        """Say what to give instead."""
        super().__init__(
            "the folder of the realm's state cannot be made; set $XDG_STATE_HOME, or name a file with --store"
        )


class MemberFailed(SupervisorError):
    """A process of a crew ended, or did not report that it is ready. Its last output is the message."""

    def __init__(self, words: Sequence[str], reason: str, last_words: str) -> None:
        """Keep the command, the reason and the last lines of its standard error."""
        self.words, self.reason, self.last_words = tuple(words), reason, last_words
        super().__init__(last_words or f"`robotree {' '.join(words)}` {reason}")


class Interrupted(SupervisorError):
    """A person, or the system, ended what was going on."""

    def __init__(self) -> None:
        """Say so."""
        super().__init__("interrupted")


def sentence(error: Exception) -> str:
    """Return the text of an error for people: one of the operating system names the file, not its number."""
    if isinstance(error, OSError) and error.strerror:
        what = f"{error.filename!s}: " if error.filename is not None else ""
        return f"{what}{error.strerror[:1].lower()}{error.strerror[1:]}"
    return str(error)
