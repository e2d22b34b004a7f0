"""The panel of a page, as its author lays it out: `NAME.panel.yaml` beside `NAME.py`. Pure.

    title: Patrol
    parts:
      - text: Goes from place to place, and comes back.
      - reading: battery
        label: Battery
      - bar: battery
        from: 0
        to: 100
      - plot: speed
        seconds: 30
      - picture: cell.wrist
        mark: [x, y]
      - button: patrol
        label: Begin
        arguments: {rounds: 3}
        confirm: Is the way free?
      - form: patrol

It names commands and readings of its own robot alone, so it can do no more than a person who has the robot in
front of her; the pictures that it shows are those that its page may see. There is no expression in it, and no
word of it is carried out. What it says is checked against this schema, and then against the robot: `expect`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import msgspec

from robotree.vr.base import written
from robotree.vr.base.arguments import check_arguments
from robotree.vr.base.description import RobotDescription
from robotree.vr.base.errors import BadPanel, BrokenScript, VrError
from robotree.vr.base.permissions import Permissions
from robotree.vr.base.written import Entries, Items, Mark, Word, Written

LARGEST = 32_000
"""[bytes] of a panel."""
MOST = 40
"""Parts of a panel."""
LONGEST = 200
"""Characters of a text."""
LONGEST_PLOT = 600.0
"""[s] that a plot shows."""


class PanelPart(msgspec.Struct, frozen=True, tag=True):
    """One line of a panel, or one widget."""


class TextPart(PanelPart, frozen=True):
    """Words."""

    text: str


class ReadingPart(PanelPart, frozen=True):
    """A reading as a figure."""

    reading: str
    label: str = ""


class BarPart(PanelPart, frozen=True):
    """A reading as a bar."""

    reading: str
    low: float
    high: float
    label: str = ""


class PlotPart(PanelPart, frozen=True):
    """A reading over time."""

    reading: str
    seconds: float = 30.0
    label: str = ""


class PicturePart(PanelPart, frozen=True):
    """The picture of a camera, with a mark on it."""

    view: str
    camera: str
    mark: tuple[str, ...] = ()
    """Two readings: where the mark is, as shares of the width from the left and of the height from above."""


class ButtonPart(PanelPart, frozen=True):
    """A command with the arguments that stand here."""

    command: str
    label: str = ""
    arguments: dict[str, Any] = {}
    confirm: str = ""
    """The question that is asked before; empty: none."""


class FormPart(PanelPart, frozen=True):
    """A command with fields for its arguments, as the generated form has them."""

    command: str


AnyPart = TextPart | ReadingPart | BarPart | PlotPart | PicturePart | ButtonPart | FormPart


class Panel(msgspec.Struct, frozen=True):
    """See the module."""

    title: str
    parts: tuple[AnyPart, ...]


_KEYS: Mapping[str, tuple[str, ...]] = {
    "text": ("text",),
    "reading": ("reading", "label"),
    "bar": ("bar", "from", "to", "label"),
    "plot": ("plot", "seconds", "label"),
    "picture": ("picture", "mark"),
    "button": ("button", "label", "arguments", "confirm"),
    "form": ("form",),
}
"""The keys of each part, by the first one."""


def read_panel(data: bytes, path: str) -> Panel:
    """Read a panel.

    Args:
        data: of its file.
        path: of the file, for messages.

    Raises:
        BadPanel: it is too large, or something in it is unknown or wrong; says where.
    """
    if len(data) > LARGEST:
        raise BadPanel(path=path, reason=f"it has {len(data)} bytes, and {LARGEST} are allowed")
    try:
        found = written.read(data.decode(), path)
        if not isinstance(found, Entries):
            raise Mark(path, 1, 1).error("write `title: …` and `parts:`")
        return _panel(found)
    except UnicodeDecodeError:
        raise BadPanel(path=path, reason="it is not UTF-8 text") from None
    except BrokenScript as error:
        where = f"line {error.data['line']}, column {error.data['column']}"
        raise BadPanel(path=path, reason=f"{where}: {error.data['reason']}") from None


def _panel(found: Entries) -> Panel:
    found.expect(("title", "parts"), "a panel")
    parts = found.get("parts")
    if not isinstance(parts, Items) or not parts.items:
        raise found.mark.error("it has no list `parts:`")
    if len(parts.items) > MOST:
        raise parts.mark.error(f"it has {len(parts.items)} parts, and {MOST} are allowed")
    title = found.get("title")
    return Panel(_text(title) if title is not None else "", tuple(map(_part, parts.items)))


def _part(found: Written) -> AnyPart:
    if not isinstance(found, Entries) or not found.entries:
        raise found.mark.error(f"a part begins with one of {', '.join(_KEYS)}")
    sort = found.entries[0][0]
    if sort.text not in _KEYS:
        hint = written.suggestion(sort.text, _KEYS)
        raise sort.mark.error(f"there is no part {sort.text!r}{hint}; there are: {', '.join(_KEYS)}")
    found.expect(_KEYS[sort.text], f"a {sort.text}")
    return _MAKERS[sort.text](found, _text(found.entries[0][1]))


def _bar(found: Entries, what: str) -> BarPart:
    low, high = _number(found, "from", 0.0), _number(found, "to", 1.0)
    if not low < high:
        raise found.mark.error(f"the bar goes from {low:g} to {high:g}: `to` is the larger one")
    return BarPart(what, low, high, _optional(found, "label"))


def _plot(found: Entries, what: str) -> PlotPart:
    seconds = _number(found, "seconds", 30.0)
    if not 1.0 <= seconds <= LONGEST_PLOT:
        raise found.mark.error(f"a plot shows 1 to {LONGEST_PLOT:g} seconds")
    return PlotPart(what, seconds, _optional(found, "label"))


def _picture(found: Entries, what: str) -> PicturePart:
    view, dot, camera = what.partition(".")
    if not dot or not view or not camera:
        raise found.mark.error(f"{what!r} is no picture; write VIEW.CAMERA")
    mark = found.get("mark")
    if mark is None:
        return PicturePart(view, camera)
    if not isinstance(mark, Items) or len(mark.items) != 2:
        raise mark.mark.error("a mark is two readings: [across, down]")
    return PicturePart(view, camera, tuple(_text(one) for one in mark.items))


def _arguments(found: Entries) -> dict[str, Any]:
    given = found.get("arguments")
    if given is None:
        return {}
    if not isinstance(given, Entries):
        raise given.mark.error("arguments are written {name: value}")
    return {name.text: written.value_of(_word(value)) for name, value in given}


def _word(found: Written) -> Word:
    if not isinstance(found, Word):
        raise found.mark.error("a single value belongs here")
    return found


def _text(found: Written) -> str:
    word = _word(found)
    if not word.text or len(word.text) > LONGEST:
        raise word.mark.error(f"a text of 1 to {LONGEST} characters belongs here")
    return word.text


def _optional(found: Entries, name: str) -> str:
    value = found.get(name)
    return "" if value is None else _text(value)


def _number(found: Entries, name: str, otherwise: float) -> float:
    value = found.get(name)
    if value is None:
        return otherwise
    number = written.value_of(_word(value))
    if isinstance(number, bool) or not isinstance(number, int | float) or not math.isfinite(number):
        raise value.mark.error(f"{name} is a number")
    return float(number)


_MAKERS: Mapping[str, Callable[[Entries, str], AnyPart]] = {
    "text": lambda _, what: TextPart(what),
    "reading": lambda found, what: ReadingPart(what, _optional(found, "label")),
    "bar": _bar,
    "plot": _plot,
    "picture": _picture,
    "button": lambda found, what: ButtonPart(
        what, _optional(found, "label"), _arguments(found), _optional(found, "confirm")
    ),
    "form": lambda _, what: FormPart(what),
}


def expect(panel: Panel, robot: RobotDescription, permissions: Permissions | None, path: str) -> None:
    """Refuse a panel that shows or asks for something that its robot does not have, or may not see.

    Args:
        panel: that was read.
        robot: as it describes itself.
        permissions: of its page; None: it is not limited.
        path: of the panel, for messages.

    Raises:
        BadPanel: says what.
    """
    for part in panel.parts:
        reason = _misfit(part, robot, permissions)
        if reason:
            raise BadPanel(path=path, reason=reason)


def _misfit(part: AnyPart, robot: RobotDescription, permissions: Permissions | None) -> str:
    """Return what is wrong with a part for this robot; empty: nothing."""
    match part:
        case ButtonPart(command=name) | FormPart(command=name):
            command = robot.command(name)
            if command is None:
                return f"{robot.kind} has no command {name!r}"
            if isinstance(part, ButtonPart) and command.available:
                try:
                    check_arguments(command, part.arguments, robot=robot.name)
                except VrError as error:
                    return str(error)
        case PicturePart(view=view, camera=camera):
            if permissions is not None and not permissions.may_see(view, camera):
                return f"the manifest of its page does not permit the stream {view}.{camera}"
        case _:
            pass
    return ""
