"""The judge of what comes from a panel that is a program. Pure.

A panel can do what a person can do who has its robot in front of her, and only when she has pressed a key or
clicked there: it asks for commands of its own robot, with arguments that fit. What no panel does, ends it.
"""

from __future__ import annotations

from robotree.tui.panels.frames import LARGEST, AskCommand, AskPicture, DrawnLines, FromPanel
from robotree.vr.base.arguments import check_arguments
from robotree.vr.base.description import RobotDescription
from robotree.vr.base.errors import VrError
from robotree.vr.base.permissions import Permissions
from robotree.vr.isolation.judge import Misbehaved

FRAMES, BURST = 100.0, 400.0
"""Frames a second that a panel may send for long, and at once."""
BYTES, BYTES_BURST = 2e6, 8e6
"""[bytes/s] for long, and [bytes] at once."""
PER_KEY = 3
"""Commands for which a panel may ask after a key or click."""
MEANT = 10.0
"""[s] after a key or click in which a panel may ask for a command."""
MOST_OPEN = 8
"""Commands and pictures that a panel waits for at the same time."""
SPANS = 1000
"""Spans of a line."""


class PanelJudge:
    """Judges the frames of one panel."""

    def __init__(self, robot: RobotDescription, permissions: Permissions | None, now: float) -> None:
        """Begin.

        Args:
            robot: whose panel it is.
            permissions: of its page; None: it is not limited.
            now: [s]
        """
        self.robot, self.permissions = robot, permissions
        self.open: set[int] = set()
        """Numbers of what it waits for."""
        self._last = now
        self._frames, self._bytes = BURST, BYTES_BURST
        self._allowed = 0
        self._touched = float("-inf")

    def touched(self, now: float) -> None:
        """Take note that a person has pressed a key or clicked in the panel."""
        self._touched, self._allowed = now, PER_KEY

    def expect_size(self, size: int) -> None:
        """Refuse a frame that is too large.

        Raises:
            Misbehaved: it is.
        """
        if size > LARGEST:
            raise Misbehaved(f"it sent {size} bytes at once")

    def expect_pace(self, size: int, now: float) -> None:
        """Refuse a frame that comes too soon after the others.

        Args:
            size: [bytes] of it.
            now: [s]

        Raises:
            Misbehaved: it floods the screen.
        """
        passed, self._last = max(now - self._last, 0.0), now
        self._frames = min(BURST, self._frames + passed * FRAMES) - 1
        self._bytes = min(BYTES_BURST, self._bytes + passed * BYTES) - size
        if self._frames < 0:
            raise Misbehaved(f"it sent more than {FRAMES:.0f} frames a second")
        if self._bytes < 0:
            raise Misbehaved(f"it sent more than {BYTES / 1e6:.0f} MB a second")

    def refusal(self, frame: FromPanel, now: float) -> str:
        """Return why a panel does not get what it asks for; empty: it does.

        Raises:
            Misbehaved: no panel does that.
        """
        match frame:
            case DrawnLines(lines=lines):
                if any(row < 0 or len(spans) > SPANS for row, spans in lines.items()):
                    raise Misbehaved("it drew lines that no screen has")
            case AskCommand():
                return self._judged(frame, now)
            case AskPicture():
                return self._looked(frame)
            case _:
                pass
        return ""

    def _looked(self, frame: AskPicture) -> str:
        self._expect_open(frame.number)
        if self.permissions is not None and not self.permissions.may_see(frame.view, frame.camera):
            return f"the manifest of its page does not permit the stream {frame.view}.{frame.camera}"[:200]
        self.open.add(frame.number)
        return ""

    def _expect_open(self, number: int) -> None:
        if number in self.open:
            raise Misbehaved("it asked twice under one number")
        if len(self.open) >= MOST_OPEN:
            raise Misbehaved(f"it asked for more than {MOST_OPEN} things at the same time")

    def _judged(self, frame: AskCommand, now: float) -> str:
        command = self.robot.command(frame.command)
        if command is None:
            raise Misbehaved(f"it asked for {frame.command[:60]!r}, which {self.robot.name} does not have")
        self._expect_open(frame.number)
        if now - self._touched > MEANT or not self._allowed:
            return f"a panel asks for {frame.command} after a key or click alone, {PER_KEY} times at most"
        try:
            check_arguments(command, frame.arguments, robot=self.robot.name)
        except VrError as error:
            return str(error)
        self._allowed -= 1
        self.open.add(frame.number)
        return ""
