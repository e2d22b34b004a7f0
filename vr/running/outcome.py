"""How a command ended, as a reply that can travel."""

from __future__ import annotations

import logging

from robotree.vr.author.context import CommandContext
from robotree.vr.base.errors import (
    BadArgument,
    CommandError,
    CommandFailed,
    Failed,
    NoSuchCommand,
    VrError,
    words_of,
)
from robotree.vr.base.requests import Raised
from robotree.vr.running.own_errors import own_class_of, travelling
from robotree.vr.running.page_trace import PageLine, page_lines, trace_of

_log = logging.getLogger(__name__)


def raised(robot: str, context: CommandContext, error: BaseException, *, source: str = "") -> Raised:
    """Pack the error of a command that did not succeed, with the trace of its page.

    Args:
        robot: its name.
        context: of the command.
        error: errors of robots go on as they are, all others are the author's.
        source: path of the author's file, to name the line.
    """
    label, lines = f"{robot}.{context.command}", page_lines(error, source)
    trace = trace_of(label, error, source)
    known = error if isinstance(error, VrError) else None
    begins_here = known is None or (isinstance(known, CommandError) and _is_the_authors(known))
    if known is None:
        where = f" ({lines[-1].place})" if lines else ""
        known = CommandFailed(robot=robot, command=context.command, detail=words_of(error) + where)
    elif isinstance(known, (BadArgument, NoSuchCommand)) and lines and not known.trace:
        known = _refused_by_a_child(known, lines[-1])
    if isinstance(known, Failed):
        known.data["values"] = {name: travelling(value) for name, value in known.data["values"].items()}
    if isinstance(known, CommandError):
        known.fill_in(robot, context.command)
    if begins_here:
        _log.warning("%s", "\n".join([str(known), *trace]))
    known.trace, known.own_class = trace, own_class_of(error) or known.own_class
    return Raised.of(known)


def _is_the_authors(error: CommandError) -> bool:
    return "" in (error.data.get("robot"), error.data.get("command"))


def _refused_by_a_child(error: BadArgument | NoSuchCommand, line: PageLine) -> VrError:
    """Return the refusal of a call with the line of the page that made it; an author's own stays as it is."""
    if _is_the_authors(error):
        return error
    last = "reason" if isinstance(error, BadArgument) else "known"
    return type(error)(**error.data | {last: f"{error.data[last]} ({line.place})"})
