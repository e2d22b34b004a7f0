"""Small values inside a line: durations, dotted paths, assignments, `FILE.py:Class`, comparisons.

Pure. Each reader refuses with `ValueRefused` in one sentence.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import TYPE_CHECKING, Literal

from robotree.tui.errors import ValueRefused

if TYPE_CHECKING:
    from robotree.vr.base.description import Placement
    from robotree.vr.base.permissions import Isolation

PLACE_MARK = "@"
"""Begins the name of a place among the arguments of a command."""

Scalar = float | int | bool | str

SLOWEST, FASTEST = 0.1, 10.0
"""How fast a simulated world may go, in seconds of it in a second."""

LONGEST_NUMBER = 18
"""[digits]: of a whole number."""
_SECONDS = {"": 1.0, "s": 1.0, "ms": 1e-3, "min": 60.0, "m": 60.0, "h": 3600.0, "d": 86400.0}
_DURATION = re.compile(r"(\d+(?:\.\d+)?|\.\d+)\s*(ms|min|m|s|h|d)?")
_INTEGER = re.compile(r"[+-]?\d{1,18}")
_SIZE = re.compile(r"(0*[1-9]\d{0,5})x(0*[1-9]\d{0,5})")


def duration(text: str) -> float:
    """Read `5s`, `500ms`, `2min`, `1.5` as seconds.

    Raises:
        ValueRefused: it is no duration.
    """
    found = _DURATION.fullmatch(text.strip())
    if not found:
        raise ValueRefused("TIME", f"{text!r} is no duration; write for example 5s, 500ms or 2min")
    return float(found[1]) * _SECONDS[found[2] or ""]


def factor(text: str) -> float:
    """Read how many times as fast as real time, from 0.1 to 10.

    Raises:
        ValueRefused: it is no such number.
    """
    number = scalar(text)
    if isinstance(number, bool | str) or not SLOWEST <= number <= FASTEST:
        raise ValueRefused("FACTOR", f"{text!r} must be a number from {SLOWEST:g} to {FASTEST:g}, e.g. 4")
    return float(number)


def dotted(text: str, what: str) -> tuple[str, str]:
    """Read `PARENT.SLOT` or `ROBOT.COMMAND`.

    Raises:
        ValueRefused: it has no dot, or nothing before or after it.
    """
    left, dot, right = text.partition(".")
    if not (left and dot and right):
        raise ValueRefused(what, f"{text!r} must have the form {what}")
    return left, right


def assignment(text: str) -> tuple[str, str]:
    """Read `name=value`; the value stays text, for the robot knows its type and its units.

    Raises:
        ValueRefused: there is no `=`, or no name before it.
    """
    name, sign, value = text.partition("=")
    if not (sign and name.isidentifier()):
        raise ValueRefused(
            "PARAMETER=VALUE", f"{text!r} must have the form name=value, e.g. x=0.4 or x='40 cm'"
        )
    return name, value


def assignments(texts: Iterable[str]) -> dict[str, str]:
    """Read several `name=value`.

    Raises:
        ValueRefused: one is none, or two are about the same name.
    """
    found: dict[str, str] = {}
    for name, value in map(assignment, texts):
        if name in found:
            raise ValueRefused("PARAMETER=VALUE", f"{name} is given twice; say once which value is meant")
        found[name] = value
    return found


def arguments(texts: Iterable[str]) -> None:
    """Refuse arguments of a command that are neither `name=value` nor `@PLACE`.

    Raises:
        ValueRefused: one is none, or two are about the same name.
    """
    assignments(text for text in texts if not place(text))


def place(text: str) -> str:
    """Read `@PLACE`; empty: that is none."""
    name = text.removeprefix(PLACE_MARK)
    return name if text.startswith(PLACE_MARK) and "=" not in name else ""


def scalar(text: str) -> Scalar:
    """Read a number, `true`, `false`, or else text."""
    if text in {"true", "false"}:
        return text == "true"
    if _INTEGER.fullmatch(text):
        return int(text)
    try:
        number = float(text)
    except ValueError:
        return text
    return number if math.isfinite(number) and "_" not in text else text


def placement(text: str) -> Placement:
    """Read how a robot is moved.

    Raises:
        ValueRefused: there is no such placement.
    """
    from robotree.vr.base.description import PLACEMENTS

    for one in PLACEMENTS:
        if one == text:
            return one
    raise ValueRefused("PLACEMENT", f"{text!r} is none; it is one of: {', '.join(PLACEMENTS)}")


def whole(what: str, text: str, least: int, most: float, refusal: str) -> int:
    """Read a whole number without a sign.

    Args:
        what: the word for it in the usage.
        text: as it was typed.
        least: that there may be.
        most: that there may be.
        refusal: what is said behind a text that is no such number.

    Raises:
        ValueRefused: it is no such number.
    """
    if not (text.isdecimal() and len(text) <= LONGEST_NUMBER and least <= int(text) <= most):
        raise ValueRefused(what, f"{text!r} {refusal}")
    return int(text)


def ranged(what: str, text: str, least: float, most: float, refusal: str) -> float:
    """Read a number from `least` to `most`; the same otherwise.

    Raises:
        ValueRefused: it is no such number.
    """
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not least <= number <= most:
        raise ValueRefused(what, f"{text!r} {refusal}")
    return number


def number_of(word: str, text: str) -> int | None:
    """Read how many there may be; None: the word was not given.

    Raises:
        ValueRefused: it is no number above 0.
    """
    return whole(word, text, 1, math.inf, "is no number above 0") if text else None


def isolation(text: str) -> Isolation | Literal[""]:
    """Read a level of isolation; empty: none was given.

    Raises:
        ValueRefused: there is no such level.
    """
    from robotree.vr.base.permissions import LEVELS

    for level in LEVELS:
        if level == text:
            return level
    if text:
        raise ValueRefused("LEVEL", f"{text!r} is no level of isolation; it is one of: {', '.join(LEVELS)}")
    return ""


def source(text: str) -> tuple[str, str]:
    """Read `FILE.py` or `FILE.py:Class` as path and class name (empty: the only one in the file)."""
    path, colon, wanted = text.rpartition(":")
    if path == "sha256":  # the hash of a page
        return text, ""
    return (path, wanted) if colon and path and wanted.isidentifier() else (text, "")


def size(text: str) -> tuple[int, int]:
    """Read `640x360` as width and height [px]; a view makes of it the nearest picture that it can render.

    Raises:
        ValueRefused: it is no size.
    """
    found = _SIZE.fullmatch(text)
    if not found:
        raise ValueRefused("SIZE", f"{text!r} is no picture size; write for example 640x360")
    return int(found[1]), int(found[2])
