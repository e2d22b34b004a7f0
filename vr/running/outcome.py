"""How a command ended, as a reply that can travel."""

from __future__ import annotations

import inspect
import logging
import traceback
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin

import msgspec

from robotree.vr.context import CommandContext
from robotree.vr.errors import CommandFailed, VrError
from robotree.vr.requests import Raised, Returned
from robotree.vr.running.naming import authors_file
from robotree.vr.running.trace import trace, words_of
from robotree.vr.units import shorten

_log = logging.getLogger(__name__)


def to_plain(value: Any) -> Any:
    """Return a command's result as plain values.

    Args:
        value: None, number, text, a Struct or dataclass of such, or what a child returned.

    Raises:
        TypeError: it cannot travel.
    """
    try:
        plain = msgspec.to_builtins(value, enc_hook=_scalar)
        msgspec.msgpack.encode(plain)
    except (TypeError, ValueError, OverflowError, RecursionError) as error:
        raise TypeError(f"the result cannot travel: {error}") from None
    return plain


def check_result(value: Any, declared: Any, *, robot: str, command: str) -> Any:
    """Return a result as plain values, if it is what its command's signature promises.

    Args:
        value: what the author's code returned.
        declared: the annotation of its result; `Any`: whatever can travel.
        robot: its name.
        command: its name.

    Raises:
        CommandFailed: it is of another type; names both.
        TypeError: it cannot travel.
    """
    plain = to_plain(value)
    if declared is not Any:
        try:
            msgspec.convert(plain, declared, strict=True)
        except msgspec.ValidationError as error:
            got = shorten(value)
            bare = get_args(declared)[0] if get_origin(declared) is Annotated else declared
            promised = "nothing" if bare is type(None) else inspect.formatannotation(bare)
            detail = f"it promises {promised} but returned {got}: {error}"
            raise CommandFailed(robot=robot, command=command, detail=detail) from None
    return plain


def _scalar(value: Any) -> Any:
    item = getattr(value, "item", None)  # numpy's numbers
    if item is None:
        raise TypeError(f"{type(value).__name__} is neither number, text, dataclass nor Struct")
    return item()


def returned(context: CommandContext, value: Any) -> Returned:
    """Pack the result of a command that succeeded."""
    return Returned(key=context.key, value=value)


def failed(robot: str, context: CommandContext, error: BaseException, *, source: str = "") -> Raised:
    """Pack the error of a command that did not.

    Args:
        robot: its name.
        context: of the command.
        error: errors of robots go on as they are, all others are the author's.
        source: path of the author's file, to name the line.
    """
    if isinstance(error, VrError):
        return Raised.of(error)
    _log.warning("%s.%s failed\n%s", robot, context.command, trace(error))
    detail = words_of(error) + _where(error, source)
    return Raised.of(CommandFailed(robot=robot, command=context.command, detail=detail))


def _where(error: BaseException, source: str) -> str:
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == source]
    return f" ({Path(authors_file(source)).name}, line {lines[-1]})" if lines else ""
