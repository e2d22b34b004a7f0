"""Frames between the screen and the process of a panel: MessagePack arrays behind their length. Pure."""

from __future__ import annotations

from typing import Any, Literal

import msgspec

from robotree.vr.base.description import RobotDescription
from robotree.vr.isolation.pipe import HEAD

LARGEST = 1024 * 1024
"""[bytes] of a frame from a panel."""

BOLD, DIM, ITALIC, UNDERLINE, REVERSE, STRIKE = 1, 2, 4, 8, 16, 32
"""What a span may be beside its colours."""
NO_COLOUR = -1

Span = tuple[str, int, int, int]
"""Text; its colour and that behind it, 0xRRGGBB or `NO_COLOUR`; what it is beside that."""


class PanelFrame(msgspec.Struct, frozen=True, array_like=True, tag=True):
    """Something that one side tells the other one."""


class BeginPanel(PanelFrame, frozen=True):
    """The first frame to a process."""

    source: str
    path: str
    files: dict[str, bytes]
    """That belong to the page, by path."""
    robot: RobotDescription
    width: int
    """[cells]"""
    height: int
    """[cells]"""
    dark: bool


class SeeReadings(PanelFrame, frozen=True):
    """What the robot reads, and how it is."""

    values: dict[str, float]
    units: dict[str, str]
    status: str


class PressKey(PanelFrame, frozen=True):
    """A key was pressed while the panel had the focus; named as Textual names keys."""

    key: str
    character: str | None


class UseMouse(PanelFrame, frozen=True):
    """The mouse was used inside the panel."""

    what: Literal["down", "up", "scroll_up", "scroll_down"]
    x: int
    """[cells] from the left."""
    y: int
    """[cells] from above."""
    button: int


class ChangeSize(PanelFrame, frozen=True):
    """The region has another size."""

    width: int
    height: int


class CallDone(PanelFrame, frozen=True):
    """How a command has ended that the panel asked for."""

    number: int
    value: Any
    refusal: str
    """Why not; empty: it was carried out."""


class PictureSeen(PanelFrame, frozen=True):
    """The picture for which the panel asked."""

    number: int
    jpeg: bytes
    refusal: str
    """Why there is none; empty: there is."""


class PanelUp(PanelFrame, frozen=True):
    """The panel is there."""

    title: str
    lacks: list[str]
    """What the kernel of this machine does not limit."""


class DrawnLines(PanelFrame, frozen=True):
    """Lines of the region that look otherwise now, by their number from above."""

    lines: dict[int, list[Span]]


class AskCommand(PanelFrame, frozen=True):
    """The panel asks for a command of its robot. Answered by `CallDone`."""

    number: int
    command: str
    arguments: dict[str, Any]


class AskPicture(PanelFrame, frozen=True):
    """The panel asks for a picture of a camera. Answered by `PictureSeen`."""

    number: int
    view: str
    camera: str
    width: int
    """[px]"""
    height: int
    """[px]"""


class PanelFailed(PanelFrame, frozen=True):
    """There is no panel."""

    reason: str


class PanelAlive(PanelFrame, frozen=True):
    """A sign of life."""


ToPanel = BeginPanel | SeeReadings | PressKey | UseMouse | ChangeSize | CallDone | PictureSeen
FromPanel = PanelUp | DrawnLines | AskCommand | AskPicture | PanelFailed | PanelAlive

_encode = msgspec.msgpack.Encoder().encode
to_panel: msgspec.msgpack.Decoder[ToPanel] = msgspec.msgpack.Decoder(ToPanel)
from_panel: msgspec.msgpack.Decoder[FromPanel] = msgspec.msgpack.Decoder(FromPanel)


def packed(frame: PanelFrame) -> bytes:
    """Return a frame behind its length."""
    body = _encode(frame)
    return HEAD.pack(len(body)) + body
