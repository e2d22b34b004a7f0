"""Whether the values of a line can be meant, before anybody is asked. Pure.

A value is judged by the name of its blank in the usage: a NAME must be one that an agent can have, a TIME
must be a duration. So each verb refuses the same mistake in the same words, on every surface, before a dialog
opens and before a session moves anything.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from robotree.tui.line import values
from robotree.tui.line.grammar import Line


def name(text: str) -> None:
    """Refuse what no agent can be called, with the name of its site before it or without.

    Raises:
        BadName: it cannot be a name.
    """
    from robotree.vr.base.address import parted  # help must not wait for the agents

    parted(text)


def new_name(text: str) -> None:
    """Refuse what nobody can be called who is made here.

    Raises:
        BadName: it cannot be a name.
    """
    from robotree.vr.base.address import check_name

    check_name(text)


def _path(what: str) -> Callable[[str], None]:
    def check(text: str) -> None:
        name(values.dotted(text, what)[0])

    return check


CHECKS: Mapping[str, Callable[[str], object]] = {
    "NAME": name,
    "GROUP": new_name,
    "ROBOT": name,
    "CHILD": name,
    "HOST": name,
    "VIEW": name,
    "PARENT.SLOT": _path("PARENT.SLOT"),
    "ROBOT.COMMAND": _path("ROBOT.COMMAND"),
    "ROBOT.READING": _path("ROBOT.READING"),
    "TIME": values.duration,
    "SIZE": values.size,
    "FACTOR": values.factor,
}
"""By name of the blank."""

MAKES = frozenset(
    {"create", "directory", "host", "lookup", "new", "proxy", "realm invite", "space serve", "view"}
)
"""Verbs that make what NAME names: here, so without a site."""


WHERE = "where"
"""The word before what a chosen child must be, instead of the names of children."""


def check(line: Line, options: Mapping[str, str]) -> None:
    """Refuse a line with a value that cannot be meant.

    Args:
        line: understood by the grammar.
        options: name of the value by option without its dashes, as in `Shape.options`.

    Raises:
        ValueRefused: a value has not the form that it must have.
        BadName: a name cannot be one.
    """
    for blank, value in line.values.items():
        kind = options.get(blank[2:], "") if blank.startswith("--") else blank
        if kind in CHECKS and not isinstance(value, bool):
            judge = new_name if kind == "NAME" and line.verb in MAKES else CHECKS[kind]
            texts = (value,) if isinstance(value, str) else value
            for text in () if kind == "CHILD" and texts[:1] == (WHERE,) else texts:
                judge(text)
    for blank in ("PLACE|COORDINATE=VALUE", "COORDINATE=VALUE"):
        values.arguments(line.many(blank))
    judge_arguments = values.arguments if "ROBOT.COMMAND" in line.values else values.assignments
    judge_arguments(line.many("PARAMETER=VALUE"))
